"""Pitch errors of a toothed wheel: given, or learnt from the residuals of a smoothed motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.shaft.turns import TURN

MAX_ERROR = 0.3  # part of the pitch; a median residual beyond it is no pitch error
FORGETTING = 0.01  # part of an error forgotten at each lesson, so that what only looks like one fades


class ToothWheel:
    """Nominal angles of a wheel's edges, corrected by each tooth's pitch error.

    Whatever repeats every turn can be the wheel's or the motion's, see `residual_orders`.

    Args:
        teeth: number of teeth in a turn, missing ones counted.
        zero_rad: angle of tooth 0.
        known: (teeth,) pitch errors [rad]; None: learnt.
    """

    def __init__(self, teeth: int, zero_rad: float, known: Sequence[float] | None) -> None:
        self._pitch, self._zero = TURN / teeth, zero_rad
        self.learning = known is None
        self.errors_rad: FloatArray = np.zeros(teeth) if known is None else np.asarray(known, dtype=np.float64)

    def _tooth(self, angles: FloatArray) -> IntArray:
        place = np.rint((np.nan_to_num(angles, posinf=0.0, neginf=0.0) - self._zero) / self._pitch)
        return np.asarray(place % self.errors_rad.size, dtype=np.int64)

    def corrected(self, angles: FloatArray) -> FloatArray:
        """Shaft angles (n,) [rad] at edges of these nominal angles (n,)."""
        return angles + self.errors_rad[self._tooth(angles)]

    def learn(self, readings: FloatArray, residuals: FloatArray) -> FloatArray:
        """Correct each tooth's error by the median residual of its readings, less that of all.

        Residuals of outliers belong in it, too: a tooth may stand so wrong that all of its readings were rejected.

        Args:
            readings: (n,) corrected readings [rad], one at least.
            residuals: (n,) readings less the smoothed angles [rad].

        Returns:
            (n,) by how much each reading is to be corrected further [rad].
        """
        tooth = self._tooth(readings)
        order = np.argsort(tooth)
        of_tooth = np.split(residuals[order], np.searchsorted(tooth[order], np.arange(1, self.errors_rad.size)))
        found = np.array([np.median(values) if values.size else 0.0 for values in of_tooth]) - np.median(residuals)
        found[np.abs(found) > MAX_ERROR * self._pitch] = 0.0
        change = -FORGETTING * self.errors_rad - found
        self.errors_rad = self.errors_rad + change
        return np.asarray(change[tooth])
