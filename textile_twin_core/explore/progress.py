"""What the page is sent of a search: its front, how far it is, and which limits keep it from finding a design."""

from __future__ import annotations

import math
from collections.abc import Sequence

from textile_twin_core.explore.labels import label
from textile_twin_core.explore.packing import Arrays, plain
from textile_twin_core.explore.search import LimitKept, SearchProgress, Task


def progress_message(progress: SearchProgress, task: Task, running: bool, took: float = 0.0) -> bytes:
    """The message of a search's progress.

    Args:
        progress: how far it is.
        task: what is searched for.
        running: whether it goes on.
        took: seconds so far.
    """
    shown = list(dict.fromkeys([g.number for g in task.goals] + [k.number for k in task.limits]))
    front = [[one.numbers[name] * label(name).factor for name in shown] for one in progress.front]
    head = {
        "type": "front",
        "running": running,
        "numbers": [{"text": label(name).text, "unit": label(name).unit} for name in shown],
        "front": plain(front),
        "designs": progress.designs,
        "per_second": progress.designs_per_second,
        "share": progress.share,
        "took": took,
        "complete": progress.complete,
        "failing": "" if progress.front else failing_text(progress.kept),
    }
    return Arrays().packed(head)


def failing_text(kept: Sequence[LimitKept]) -> str:
    """Which limits no design keeps, with the nearest value; where each is kept by some, the one that fewest keep."""
    failing = [one for one in kept if not one.designs]
    if failing:
        return "; ".join(f"none has {_limit_text(one)}{_nearest_text(one)}" for one in failing)
    if not kept:
        return ""
    fewest = min(kept, key=lambda one: one.designs)
    return f"{fewest.designs} have {_limit_text(fewest)}, and none of these keeps the other limits"


def _limit_text(one: LimitKept) -> str:
    words, limit = label(one.limit.number), one.limit
    sense = "at least" if limit.at_least else "at most"
    return f"{words.text} {sense} {limit.value * words.factor:.4g} {words.unit}".rstrip()


def _nearest_text(one: LimitKept) -> str:
    words = label(one.limit.number)
    if not math.isfinite(one.nearest):
        return ", which none has a value of"
    return f" (the nearest has {one.nearest * words.factor:.4g})"
