"""Coefficients of ripple, apart from the state: what a filter's state owes to them, and what they are found to be.

Friedland's (1969) separation: the coefficients c do not change, and so a filter that takes them as known has the state
x + V (c - c0), where V, the sensitivity, goes through the same gains as the state. An innovation is foreseen to change
by `felt` . (c - c0): recursive least squares on it find c, in square-root form (Carlson 1973).
"""

from __future__ import annotations

import math
from functools import partial

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled


@partial(compiled, apart=True)
def feel(
    sensitivity: FloatArray, ripple: FloatArray, factor: FloatArray, step: float, row: int, regressor: FloatArray,
    felt: FloatArray, width: int,
) -> tuple[float, float]:  # fmt: skip
    """Move a sensitivity (3, .) on by `step` [s] and foresee a reading of the state's `row`.

    `regressor` (.) is what the reading itself owes to the coefficients; `felt` (.) becomes what the innovation feels of
    them; `factor` (., .) has rows j of columns j of L. Returns the ripple in the reading, and the variance that its
    uncertainty gives the innovation.
    """
    half = 0.5 * step * step
    for i in range(width):
        acceleration, rate = sensitivity[0, i], sensitivity[1, i]
        sensitivity[1, i] = rate + step * acceleration
        sensitivity[2, i] += step * rate + half * acceleration
        felt[i] = regressor[i] - sensitivity[row, i]
    told = spread = 0.0
    for j in range(width):
        told += regressor[j] * ripple[j]
        seen = 0.0
        for i in range(j, width):
            seen += factor[j, i] * felt[i]
        spread += seen * seen
    return told, spread


@partial(compiled, apart=True)
def absorb(
    sensitivity: FloatArray, felt: FloatArray, gain0: float, gain1: float, gain2: float, width: int
) -> None:  # fmt: skip
    """Correct a sensitivity by the gains that corrected the state."""
    for i in range(width):
        sensitivity[0, i] += gain0 * felt[i]
        sensitivity[1, i] += gain1 * felt[i]
        sensitivity[2, i] += gain2 * felt[i]


@partial(compiled, apart=True)
def learn(
    ripple: FloatArray, factor: FloatArray, felt: FloatArray, innovation: float, noise: float, change: FloatArray,
    width: int,
) -> None:  # fmt: skip
    """Correct the coefficients by an innovation of variance `noise`; `change` (.) becomes by how much."""
    total = noise
    for i in range(width):
        change[i] = 0.0
    for back in range(width):
        j = width - 1 - back
        seen = 0.0
        for i in range(j, width):
            seen += factor[j, i] * felt[i]
        more = total + seen * seen
        part = 1.0 / math.sqrt(total * more)
        keep, mix = total * part, seen * part
        total = more
        for i in range(j, width):
            old = factor[j, i]
            factor[j, i] = keep * old - mix * change[i]
            change[i] += old * seen
    for i in range(width):
        change[i] *= -innovation / total
        ripple[i] += change[i]


@partial(compiled, apart=True)
def shift(sensitivity: FloatArray, change: FloatArray, width: int) -> tuple[float, float, float]:
    """By how much a state's three rows change with the coefficients."""
    acceleration = rate = angle = 0.0
    for i in range(width):
        acceleration += sensitivity[0, i] * change[i]
        rate += sensitivity[1, i] * change[i]
        angle += sensitivity[2, i] * change[i]
    return acceleration, rate, angle
