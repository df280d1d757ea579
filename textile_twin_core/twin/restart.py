"""Detection of a restarted recording, as distinct from late samples."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

BACK_NS: Final = 1_000_000_000
"""Least backward step of stamps that were set back."""
BACK_S: Final = 1.0
_SAMPLES = 10


class RestartWatch:
    """Detector of stamps that were set back, as when a recording or a simulation restarts.

    Time was set back if ten stamps in a row, each newer than the one before, are more than a second behind the
    newest one. Stamps are integers [ns] or floats [s].
    `count` is the number of restarts.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Clear the stamps and the count."""
        self.count = 0
        self._newest: int | float | None = None
        self._previous: int | float = 0
        self._behind = 0

    def restarted(self, stamp: int | float) -> bool:
        """Add the next stamp; return true if it shows that time was set back."""
        newest = self._newest
        if stamp != stamp:  # NaN, which the estimator rejects
            return False
        if newest is None or stamp > newest - (BACK_S if isinstance(stamp, float) else BACK_NS):
            self._newest = stamp if newest is None else max(newest, stamp)
            self._behind = 0
            return False
        self._behind = self._behind + 1 if self._behind and stamp > self._previous else 1
        self._previous = stamp
        if self._behind < _SAMPLES:
            return False
        self._newest, self._behind = stamp, 0
        self.count += 1
        return True

    def restarts(self, stamps: npt.NDArray[Any]) -> list[int]:
        """Add stamps (n,); return the places of those that show that time was set back."""
        whole = stamps.dtype.kind in "iu"
        if stamps.ndim != 1 or stamps.size == 0 or not (whole or stamps.dtype.kind == "f"):
            return []
        stamps = stamps.astype(np.int64 if whole else np.float64, copy=False)
        newest = np.fmax.accumulate(stamps)
        if self._newest is not None:
            newest = np.fmax(newest, self._newest)
        if newest[-1] == newest[-1] and not np.any(stamps <= newest - (BACK_NS if whole else BACK_S)):
            self._newest, self._behind = newest[-1].item(), 0
            return []
        return [place for place, stamp in enumerate(stamps.tolist()) if self.restarted(stamp)]
