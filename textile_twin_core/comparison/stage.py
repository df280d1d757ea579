"""Progress reports of long work."""

from __future__ import annotations

from collections.abc import Callable

Begin = Callable[[str, float], object]
"""Called at the beginning of each stage with its name and the share of all work at which it ends."""


def unheard(_what: str, _until: float) -> None:
    """Ignore the stage, for work without a progress display."""
