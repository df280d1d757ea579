"""Periodic error of an encoder whose disc or coupling runs out: once and twice per turn of the encoder.

    reading = q + e(q),   e(q) = c1 cos q + s1 sin q + c2 cos 2q + s2 sin 2q

q is the true angle of the encoder: the reading of an encoder without this error, zero included. The inverse is solved
by Newton's method on d = q - reading. The number of steps follows from the amplitudes, so each reading has the same
result in a block of any size. tests/machines/test_eccentricity.py compares with mpmath and with Kepler's equation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.errors import MachineError

MOST_SLOPE = 0.5
"""Largest sum of amplitude times order: beyond it, the declaration is no run-out of an encoder."""
_EXACT_RAD = 1e-17


@dataclass(frozen=True)
class Eccentricity:
    """Error of an encoder's readings over its own angle.

    Attributes:
        pairs: cosine and sine coefficient [rad] of once per turn, and of twice per turn where there is a second pair.

    Raises:
        MachineError: more than two pairs, or amplitudes that are not finite or too large.
    """

    pairs: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        if len(self.pairs) > 2:
            raise MachineError(
                f"encoder: eccentricity_rad has {len(self.pairs)} pairs; give one or two: once and twice a turn"
            )
        if not self._slope() < MOST_SLOPE:  # true for nan, too
            raise MachineError(
                f"encoder: eccentricity_rad must be finite and small in radians: times its order below {MOST_SLOPE}"
            )

    @property
    def largest_rad(self) -> float:
        """Bound of |e| [rad]."""
        return math.fsum(math.hypot(*pair) for pair in self.pairs)

    def _slope(self) -> float:
        """Return a bound of |e'|."""
        return math.fsum(order * math.hypot(*pair) for order, pair in enumerate(self.pairs, 1))

    @cached_property
    def _coefficients(self) -> FloatArray:
        return np.array(self.pairs, dtype=np.float64).reshape(-1, 2)

    @cached_property
    def _steps(self) -> int:
        """Return the number of Newton steps after which the inverse is exact to rounding."""
        curvature = math.fsum(order**2 * math.hypot(*pair) for order, pair in enumerate(self.pairs, 1))
        factor = curvature / (2.0 * (1.0 - self._slope()))
        error, steps = self.largest_rad, 0
        while error > _EXACT_RAD:
            error, steps = min(factor * error, 0.5) * error, steps + 1
        return steps

    def error(self, angle_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Evaluate e and its derivative e' at true angles (n,) of the encoder."""
        value, slope = np.zeros_like(angle_rad), np.zeros_like(angle_rad)
        with np.errstate(invalid="ignore"):  # readings that are not finite stay so
            for order, (c, s) in enumerate(self.pairs, 1):
                cos, sin = np.cos(order * angle_rad), np.sin(order * angle_rad)
                value += c * cos + s * sin
                slope += order * (s * cos - c * sin)
        return value, slope

    def true_angle(self, reading_rad: FloatArray) -> FloatArray:
        """Correct readings (n,), wrapped or not, to true angles of the encoder [rad]."""
        readings = np.ascontiguousarray(reading_rad).reshape(-1)
        out = np.empty_like(readings)
        _true_angles(readings, self._coefficients, self._steps, out)
        return out.reshape(reading_rad.shape)

    def one_true_angle(self, reading_rad: float) -> float:
        """Correct one reading as `true_angle` does."""
        one = np.array((reading_rad,))
        _true_angles(one, self._coefficients, self._steps, one)
        return float(one.item())

    def slope_at(self, angle: float) -> float:
        """Return the slope of the readings over the true angle, at one true angle [rad]."""
        slope = 1.0
        for order, (c, s) in enumerate(self.pairs, 1):
            slope += order * (s * math.cos(order * angle) - c * math.sin(order * angle))
        return slope

    def reading(self, angle_rad: FloatArray) -> FloatArray:
        """Return the readings (n,) at true angles of the encoder [rad]."""
        return angle_rad + self.error(angle_rad)[0]


@compiled_in_place
def _true_angles(readings: FloatArray, coefficients: FloatArray, steps: int, out: FloatArray) -> None:
    """Solve q + e(q) = reading for each reading; NaN where it is not finite."""
    for i in range(readings.size):
        reading = readings[i]
        if not np.isfinite(reading):
            out[i] = np.nan
            continue
        shift = 0.0
        for _ in range(steps):
            gap, slope = shift, 1.0
            for k in range(coefficients.shape[0]):
                order = k + 1.0
                angle = order * (reading + shift)
                cos, sin = math.cos(angle), math.sin(angle)
                gap += coefficients[k, 0] * cos + coefficients[k, 1] * sin
                slope += order * (coefficients[k, 1] * cos - coefficients[k, 0] * sin)
            shift -= gap / slope
        out[i] = reading + shift
