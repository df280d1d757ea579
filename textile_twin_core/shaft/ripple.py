"""Coefficients of ripple, apart from the state: what a filter's state owes to them, and what they are found to be.

Friedland's (1969) separation: the coefficients c do not change, and so a filter that takes them as known has the state
x + V (c - c0), where V, the sensitivity, goes through the same gains as the state. An innovation is foreseen to change
by `regressor` . (c - c0): recursive least squares on it find c, in square-root form (Carlson 1973).
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled


@compiled
def set_sensitivity(sensitivity: FloatArray, basis: FloatArray, lowest: float, rate: float, width: int) -> None:
    """What the state of a clock that stands where the shaft is, turning at `rate` [rad/s], owes to the coefficients."""
    for i in range(width):
        turning = lowest * (i // 2 + 1) * rate
        sensitivity[0, i] = -turning * turning * basis[i]
        sensitivity[1, i] = turning * (-basis[i + 1] if i % 2 == 0 else basis[i - 1])
        sensitivity[2, i] = basis[i]


@partial(compiled, apart=True)
def propagate_sensitivity(
    sensitivity: FloatArray, step: float, basis: FloatArray, regressor: FloatArray, width: int
) -> None:
    """Move a sensitivity (3, .) on by `step` [s]; `regressor` (.) becomes what an innovation feels of the coefficients.

    A reading of the angle itself owes `basis` (.) to them.
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
    """The ripple in a reading, and the variance that its uncertainty gives the innovation.

    `factor` (., .) has rows j of columns j of L; `projected` (.) becomes what the innovation sees of each.
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
    """Correct a sensitivity by the gains that corrected the state."""
    for i in range(width):
        sensitivity[0, i] += gain0 * regressor[i]
        sensitivity[1, i] += gain1 * regressor[i]
        sensitivity[2, i] += gain2 * regressor[i]


@partial(compiled, apart=True)
def update_coefficients(
    ripple: FloatArray, factor: FloatArray, projected: FloatArray, innovation: float, noise: float,
    sensitivity: FloatArray, part: FloatArray, change: FloatArray, width: int,
) -> tuple[float, float, float]:  # fmt: skip
    """Correct the coefficients by an innovation of variance `noise` beside `projected`; by how much the state follows.

    `part` (2, .) and `change` (.) are room to work in.
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
        keep, mix, by = part[0, j], part[1, j], projected[j]
        for i in range(j, count):
            old = factor[j, i]
            factor[j, i] = keep * old - mix * change[i]
            change[i] += old * by
    by0 = by1 = by2 = 0.0
    for i in range(width):
        change[i] *= -innovation / total
        ripple[i] += change[i]
        by0 += sensitivity[0, i] * change[i]
        by1 += sensitivity[1, i] * change[i]
        by2 += sensitivity[2, i] * change[i]
    return by0, by1, by2


@compiled
def dot(sensitivity: FloatArray, change: FloatArray, width: int) -> float:
    """By how much what has this sensitivity (.) changes with the coefficients."""
    total = 0.0
    for i in range(width):
        total += sensitivity[i] * change[i]
    return total
