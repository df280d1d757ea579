"""Ripple coefficients estimated apart from the state (Friedland 1969), by recursive least squares.

The coefficients c are constant: a filter that takes them as c0 estimates x where c would give x + V (c - c0). The
sensitivity V (3, .) goes through the same updates as the state, and an innovation changes by `regressor` . (c - c0).
The least squares are in square-root form (Carlson 1973).
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled


@compiled
def set_sensitivity(sensitivity: FloatArray, basis: FloatArray, lowest: float, rate: float, width: int) -> None:
    """Sensitivity (3, .) of the state of a clock initialised at the shaft's angle and turning at `rate` [rad/s]."""
    for i in range(width):
        frequency = lowest * (i // 2 + 1) * rate
        sensitivity[0, i] = -frequency * frequency * basis[i]
        sensitivity[1, i] = frequency * (-basis[i + 1] if i % 2 == 0 else basis[i - 1])
        sensitivity[2, i] = basis[i]


@partial(compiled, apart=True)
def propagate_sensitivity(
    sensitivity: FloatArray, step: float, basis: FloatArray, regressor: FloatArray, width: int
) -> None:
    """Time update of a sensitivity (3, .) over `step` [s]; sets `regressor` (.), that of the innovation.

    The measured clock angle has the sensitivity `basis` (.).
    """
    half = 0.5 * step * step
    for i in range(width):
        acceleration, rate = sensitivity[0, i], sensitivity[1, i]
        sensitivity[1, i] = rate + step * acceleration
        sensitivity[2, i] += step * rate + half * acceleration
        regressor[i] = basis[i] - sensitivity[2, i]


@partial(compiled, apart=True)
def predict_ripple(
    ripple: FloatArray, factor: FloatArray, basis: FloatArray, regressor: FloatArray, projected: FloatArray, width: int
) -> tuple[float, float]:
    """The ripple in a measurement, and what its uncertainty adds to the innovation's variance.

    Row j of `factor` (., .) is column j of the covariance factor L; sets `projected` (.) = L' regressor.
    """
    reading, variance, count = 0.0, 0.0, np.uint64(width)
    for j in range(count):
        reading += basis[j] * ripple[j]
        total = 0.0
        for i in range(j, count):
            total += factor[j, i] * regressor[i]
        projected[j] = total
        variance += total * total
    return reading, variance


@partial(compiled, apart=True)
def correct_sensitivity(
    sensitivity: FloatArray, regressor: FloatArray, gain0: float, gain1: float, gain2: float, width: int
) -> None:
    """Measurement update of a sensitivity, by the gains of the state's."""
    for i in range(width):
        sensitivity[0, i] += gain0 * regressor[i]
        sensitivity[1, i] += gain1 * regressor[i]
        sensitivity[2, i] += gain2 * regressor[i]


@partial(compiled, apart=True)
def update_coefficients(
    ripple: FloatArray, factor: FloatArray, projected: FloatArray, innovation: float, noise: float,
    sensitivity: FloatArray, part: FloatArray, change: FloatArray, width: int,
) -> tuple[float, float, float]:  # fmt: skip
    """Measurement update of the coefficients; returns how acceleration, rate and angle of the clock change with them.

    `noise` is the innovation's variance without that of the coefficients; `part` (2, .), `change` (.) are scratch.
    """
    total, count, last = noise, np.uint64(width), np.uint64(width - 1)
    for back in range(count):
        j = last - back
        part[0, j] = total
        total += projected[j] * projected[j]
        part[1, j] = total
    for i in range(count):
        inverse = 1.0 / math.sqrt(part[0, i] * part[1, i])
        part[0, i], part[1, i] = part[0, i] * inverse, projected[i] * inverse
        change[i] = 0.0
    for back in range(count):
        j = last - back
        keep, mix, seen = part[0, j], part[1, j], projected[j]
        for i in range(j, count):
            old = factor[j, i]
            factor[j, i] = keep * old - mix * change[i]
            change[i] += old * seen
    acceleration = rate = angle = 0.0
    for i in range(width):
        change[i] *= -innovation / total
        ripple[i] += change[i]
        acceleration += sensitivity[0, i] * change[i]
        rate += sensitivity[1, i] * change[i]
        angle += sensitivity[2, i] * change[i]
    return acceleration, rate, angle
