"""Progress messages of a search: front, share of the work done, and limits that no design meets."""

from __future__ import annotations

import math
from collections.abc import Sequence

from textile_twin_core.explore.labels import label
from textile_twin_core.explore.packing import Arrays, plain
from textile_twin_core.explore.search import LimitTally, SearchProgress, Task


def progress_message(progress: SearchProgress, task: Task, running: bool, took: float = 0.0) -> bytes:
    """Build the message of the progress of a search.

    Args:
        progress: Progress of the search.
        task: Task of the search.
        running: True while the search continues.
        took: Time so far [s].
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
        "failing": "" if progress.front else failing_text(progress.tallies),
    }
    return Arrays().packed(head)


def failing_text(tallies: Sequence[LimitTally]) -> str:
    """Name the limits that no design meets, with the nearest value; if each is met by some, the one met by the
    fewest.
    """
    failing = [one for one in tallies if not one.designs]
    if failing:
        return "; ".join(f"none has {_limit_text(one)}{_nearest_text(one)}" for one in failing)
    if not tallies:
        return ""
    fewest = min(tallies, key=lambda one: one.designs)
    return f"{fewest.designs} have {_limit_text(fewest)}, and none of these meets the other limits"


def _limit_text(one: LimitTally) -> str:
    words, limit = label(one.limit.number), one.limit
    sense = "at least" if limit.at_least else "at most"
    return f"{words.text} {sense} {limit.value * words.factor:.4g} {words.unit}".rstrip()


def _nearest_text(one: LimitTally) -> str:
    words = label(one.limit.number)
    if not math.isfinite(one.nearest):
        return ", which has no value for any design"
    return f" (the nearest has {one.nearest * words.factor:.4g})"
