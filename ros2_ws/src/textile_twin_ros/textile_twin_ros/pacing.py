"""Real time without drift: every moment is reckoned from the start, not from the one before."""

from __future__ import annotations

import threading
import time


class Pace:
    """Waits until moments of a recorded or simulated time, played at a rate.

    Args:
        stop: set to end all waiting.
        rate: seconds of played time per second.
    """

    def __init__(self, stop: threading.Event, rate: float = 1.0) -> None:
        self._stop = stop
        self._rate = rate
        self.start()

    def start(self) -> None:
        """Begin at played time 0 now."""
        self._real_s = time.monotonic()
        self._played_s = 0.0

    def set_rate(self, rate: float) -> None:
        """Go on at another rate from here."""
        now = time.monotonic()
        self._played_s += (now - self._real_s) * self._rate
        self._real_s = now
        self._rate = rate

    def wait_until(self, played_s: float) -> bool:
        """Wait until this many seconds of played time have passed since the start; False when told to stop."""
        remaining = (played_s - self._played_s) / self._rate - (time.monotonic() - self._real_s)
        if remaining > 0.0:
            return not self._stop.wait(remaining)
        return not self._stop.is_set()
