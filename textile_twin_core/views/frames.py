"""Which samples are drawn as pictures: so many a second at most, however the samples come in blocks."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray


class Frames:
    """Chooses samples at a limited rate [Hz]."""

    def __init__(self, rate_hz: float) -> None:
        self._period_s, self._next_s = 1.0 / rate_hz, -math.inf

    def of(self, time_s: FloatArray) -> IntArray:
        """Places of those to draw in the next block of times (n,), increasing [s]."""
        chosen = []
        for k, now in enumerate(time_s.tolist()):
            if now >= self._next_s:
                chosen.append(k)
                self._next_s = now + self._period_s
        return np.array(chosen, dtype=np.int64)
