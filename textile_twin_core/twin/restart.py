"""Detection of a restarted recording, as distinct from late samples."""

from __future__ import annotations

_BACK_NS = 1_000_000_000
_SAMPLES = 10


class RestartWatch:
    """Detector of stamps that were set back, as when a recording or a simulation restarts.

    Time was set back if ten stamps in a row, each newer than the one before, are more than a second behind the
    newest one.
    `count` is the number of restarts.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Clear the stamps and the count."""
        self.count = 0
        self._newest_ns: int | None = None
        self._previous_ns = 0
        self._behind = 0

    def restarted(self, stamp_ns: int) -> bool:
        """Add the next stamp; return true if it shows that time was set back."""
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
