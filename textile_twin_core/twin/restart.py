"""Tells a recording played once more from samples that merely come late."""

from __future__ import annotations

_BACK_NS = 1_000_000_000
_SAMPLES = 10


class RestartWatch:
    """Watches stamps: when ten in a row, each newer than the one before, are all more than a second behind the newest
    one, then time has been set back (a recording begins again, a simulation restarts), and they are not late samples.
    `count` tells how often.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the stamps."""
        self.count = 0
        self._newest_ns: int | None = None
        self._previous_ns = 0
        self._behind = 0

    def restarted(self, stamp_ns: int) -> bool:
        """Take the next stamp; True where it shows that time has been set back."""
        if self._newest_ns is None or stamp_ns > self._newest_ns - _BACK_NS:
            self._newest_ns = stamp_ns if self._newest_ns is None else max(self._newest_ns, stamp_ns)
            self._behind = 0
            return False
        self._behind = self._behind + 1 if self._behind and stamp_ns > self._previous_ns else 1
        self._previous_ns = stamp_ns
        if self._behind < _SAMPLES:
            return False
        self._newest_ns, self._behind = stamp_ns, 0
        self.count += 1
        return True
