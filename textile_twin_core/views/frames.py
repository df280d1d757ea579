"""Choice of the samples that are drawn as pictures, at a limited rate and independent of the block size."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray


class Frames:
    """Selector of samples at a limited rate [Hz]."""

    def __init__(self, rate_hz: float) -> None:
        self._period_s, self._next_s = 1.0 / rate_hz, -math.inf

    def of(self, time_s: FloatArray) -> IntArray:
        """Return the indices of the samples to draw in the next block of increasing times (n,) [s]."""
        chosen = []
        for k, now in enumerate(time_s.tolist()):
            if now >= self._next_s:
                chosen.append(k)
                self._next_s = now + self._period_s
        return np.array(chosen, dtype=np.int64)
