"""Pitch errors of a toothed wheel: each tooth's own, learnt from what the filter finds it off by, turn after turn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.shaft.turns import TURN

LEAST_GAIN = 0.05
"""Part of a tooth's offset that is believed however often it was seen: wheels do not change, filters settle."""
LEAK = 0.01
"""Part of an error that is forgotten at each lesson: what nothing tells from motion fades."""
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
        self.learning = known is None
        self.errors_rad: FloatArray = np.zeros(teeth) if known is None else np.asarray(known, dtype=np.float64)
        self._seen = np.zeros(teeth)
        self._taken = 0
        self._heard: list[FloatArray] = []

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

    def learn(self, heard: FloatArray) -> None:
        """Take a lesson from samples (n, 2): corrected readings, and how far they were off what was expected [rad]."""
        self._taken += len(heard)
        self._heard.append(heard[~np.isnan(heard[:, 0])])
        if self._taken % self.errors_rad.size == 0 and self._heard:
            if self.learning and self._taken > FIRST_TURNS * self.errors_rad.size:
                turn = np.concatenate(self._heard)
                self.believe(turn[:, 0], turn[:, 1])
            self._heard = []

    def believe(self, readings: FloatArray, off: FloatArray) -> None:
        """Move each tooth's error against the mean of what its readings (n,) were off by [rad]."""
        off = off - np.median(off)
        good = np.abs(off) < FARTHEST * self._pitch
        tooth = self._number(readings[good])
        count = np.bincount(tooth, minlength=self._seen.size)
        total = np.bincount(tooth, off[good], minlength=self._seen.size)
        met = count > 0
        self._seen += met
        gain = np.maximum(1.0 / (self._seen + 2.0), LEAST_GAIN)
        lesson = np.where(met, gain * total / np.maximum(count, 1), 0.0)
        self.errors_rad = (1.0 - LEAK) * self.errors_rad - lesson

    def refine(self, readings: FloatArray, off: FloatArray, used: np.ndarray) -> FloatArray:
        """Believe in full what corrected readings (n,) were off by; by how much that corrects each further."""
        before = self.errors_rad
        self._seen[:] = 0.0
        self.believe(readings[used], off[used])
        return np.asarray((self.errors_rad - before)[self._number(readings)])
