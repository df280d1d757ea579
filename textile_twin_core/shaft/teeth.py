"""Pitch errors of a toothed wheel: each tooth's own, learnt from what the filter finds it off by, turn after turn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.shaft.status import NOISE, OFF, READING
from textile_twin_core.shaft.turns import TURN

LEAST_GAIN = 0.05
"""Part of a tooth's offset that is believed however often it was seen: wheels do not change, filters settle."""
FIRST_TURNS = 2
"""Turns before the first lesson: the motion is found first."""
FARTHEST = 0.3
"""Part of the pitch beyond which a reading is an outlier, no pitch error."""


class ToothWheel:
    """Nominal angles of edges, corrected by what each tooth is known to be off by.

    Whatever repeats every turn in the readings can be the wheel's or the motion's: of this the filter's ripple takes
    the low orders that it has evidence for, the wheel takes the rest.

    Args:
        teeth: in a turn, missing ones counted.
        known: pitch errors [rad] as told; None: learn them.
    """

    def __init__(self, teeth: int, known: Sequence[float] | None) -> None:
        self._pitch = TURN / teeth
        self._learning = known is None
        self.errors_rad: FloatArray = np.zeros(teeth) if known is None else np.asarray(known, dtype=np.float64)
        self._seen = np.zeros(teeth)
        self._taken = 0

    @property
    def wanted(self) -> int:
        """Samples until the next lesson."""
        turn = self.errors_rad.size
        return turn - self._taken % turn

    def _number(self, angles: FloatArray) -> IntArray:
        tooth = np.rint(np.nan_to_num(angles, posinf=0.0, neginf=0.0) / self._pitch) % self.errors_rad.size
        return np.asarray(tooth, dtype=np.int64)

    def corrected(self, angles: FloatArray) -> FloatArray:
        """Shaft angles [rad] at edges of these nominal angles (n,)."""
        return angles + self.errors_rad[self._number(angles)]

    def learn(self, samples: int, table: FloatArray) -> None:
        """Take a lesson after `samples` more samples, which gave these rows of the table."""
        self._taken += samples
        if self._learning and self._taken > FIRST_TURNS * self.errors_rad.size:
            self.believe(table[:, READING], -table[:, OFF], table[:, NOISE] > 0.0, LEAST_GAIN)

    def believe(self, readings: FloatArray, off: FloatArray, good: np.ndarray, least_gain: float) -> None:
        """Move each tooth's error by part of the mean of what its readings (n,) were found off by [rad]."""
        good = good & (np.abs(off) < FARTHEST * self._pitch)
        tooth = self._number(readings[good])
        count = np.bincount(tooth, minlength=self._seen.size)
        total = np.bincount(tooth, off[good], minlength=self._seen.size)
        met = count > 0
        self._seen += met
        gain = np.maximum(1.0 / np.maximum(self._seen, 1.0), least_gain)
        self.errors_rad = self.errors_rad + np.where(met, gain * total / np.maximum(count, 1), 0.0)
