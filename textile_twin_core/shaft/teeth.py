"""Pitch errors of a toothed wheel: each tooth's own, given, or found from what a smoothed motion says of its edges."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.shaft.turns import TURN

FARTHEST = 0.3
"""Part of the pitch beyond which there is no pitch error."""
OUTLYING = 4.5
"""Median deviations from a tooth's median, 3 standard deviations, beyond which its reading is an outlier."""
FADING = 0.01
"""Part of an error that is forgotten at each lesson: what nothing tells from motion fades."""


class ToothWheel:
    """Nominal angles of edges, corrected by what each tooth is known to be off by.

    Whatever repeats every turn in the readings can be the wheel's or the motion's: of this the model's ripple takes
    the low orders that it has evidence for, the wheel takes the rest.

    Args:
        teeth: in a turn, missing ones counted.
        zero_rad: angle of tooth 0.
        known: pitch errors [rad] as told; None: not known.
    """

    def __init__(self, teeth: int, zero_rad: float, known: Sequence[float] | None) -> None:
        self._pitch, self._zero = TURN / teeth, zero_rad
        self.learning = known is None
        self.errors_rad: FloatArray = np.zeros(teeth) if known is None else np.asarray(known, dtype=np.float64)

    def _number(self, angles: FloatArray) -> IntArray:
        place = np.rint((np.nan_to_num(angles, posinf=0.0, neginf=0.0) - self._zero) / self._pitch)
        return np.asarray(place % self.errors_rad.size, dtype=np.int64)

    def corrected(self, angles: FloatArray) -> FloatArray:
        """Shaft angles [rad] at edges of these nominal angles (n,)."""
        return angles + self.errors_rad[self._number(angles)]

    def learn(self, readings: FloatArray, off: FloatArray) -> FloatArray:
        """Move each tooth's error against the mean of what its corrected readings (n,) were off by [rad].

        Also of readings that were set aside: a tooth may stand so wrong that all of its own were. What is far from a
        tooth's median counts as an outlier. Returns by how much each reading is to be corrected further.
        """
        before = self.errors_rad
        tooth = self._number(readings)
        order = np.argsort(tooth, kind="stable")
        place = np.searchsorted(tooth[order], np.arange(before.size + 1))
        mean = np.array([_middle(off[order[first:end]]) for first, end in pairwise(place)])
        mean = np.where(np.abs(mean - np.median(off)) < FARTHEST * self._pitch, mean - np.median(off), 0.0)
        self.errors_rad = (1.0 - FADING) * before - mean
        return np.asarray((self.errors_rad - before)[tooth])


def _middle(values: FloatArray) -> float:
    """Mean without outliers; 0 of nothing."""
    if not values.size:
        return 0.0
    off = np.abs(values - np.median(values))
    return float(np.mean(values[off <= OUTLYING * np.median(off)]))
