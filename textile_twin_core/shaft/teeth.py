"""Pitch errors of a toothed wheel: configured, or estimated from the residuals of a smoothed motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.shaft.turns import TURN

MAX_ERROR = 0.3  # part of the pitch; a larger median residual is no pitch error
FORGETTING = 0.01  # decay of an error at each pass, so that a spurious error fades


class ToothWheel:
    """Nominal angles of a wheel's edges, corrected by each tooth's pitch error.

    An error that repeats every turn can belong to the wheel or to the motion, see `residual_orders`.

    Args:
        teeth: number of teeth in a turn, missing ones counted.
        zero_rad: angle of tooth 0.
        known: (teeth,) pitch errors [rad]; None: estimated.
    """

    def __init__(self, teeth: int, zero_rad: float, known: Sequence[float] | None) -> None:
        self._pitch, self._zero = TURN / teeth, zero_rad
        self.learning = known is None
        self.errors_rad: FloatArray = np.zeros(teeth) if known is None else np.asarray(known, dtype=np.float64)

    def _tooth(self, angles: FloatArray) -> IntArray:
        place = np.rint((np.nan_to_num(angles, posinf=0.0, neginf=0.0) - self._zero) / self._pitch)
        return np.asarray(place % self.errors_rad.size, dtype=np.int64)

    def corrected(self, angles: FloatArray) -> FloatArray:
        """Return the shaft angles (n,) [rad] at edges of these nominal angles (n,)."""
        return angles + self.errors_rad[self._tooth(angles)]

    def learn(self, readings: FloatArray, residuals: FloatArray) -> FloatArray:
        """Correct each tooth's error by the median residual of its readings, relative to the median of all.

        Residuals of outliers count as well: a tooth may stand so wrong that all of its readings were rejected.

        Args:
            readings: (n,) corrected readings [rad], at least one.
            residuals: (n,) readings less the smoothed angles [rad].

        Returns:
            (n,) further correction of each reading [rad].
        """
        tooth = self._tooth(readings)
        order = np.argsort(tooth)
        of_tooth = np.split(residuals[order], np.searchsorted(tooth[order], np.arange(1, self.errors_rad.size)))
        found = np.array([np.median(values) if values.size else 0.0 for values in of_tooth]) - np.median(residuals)
        found[np.abs(found) > MAX_ERROR * self._pitch] = 0.0
        change = -FORGETTING * self.errors_rad - found
        self.errors_rad = self.errors_rad + change
        return np.asarray(change[tooth])
