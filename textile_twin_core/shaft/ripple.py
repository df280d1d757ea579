"""Ripple coefficients estimated apart from the state (Friedland 1969), by square-root least squares (Carlson 1973).

`sensitivity` is the derivative of the state by the coefficients, `regressor` that of the innovation. The last axis of
arrays is the filter: functions process filters first .. stop - 1.
"""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.shaft.layout import of_arrays


@of_arrays
def set_sensitivity(
    sensitivity: FloatArray, basis: FloatArray, lowest: float, rate: float, width: int, first: int, stop: int
) -> None:
    """Set the sensitivity (3, ., .) of a clock initialised at the shaft's angle and turning at `rate` [rad/s]."""
    for i in range(width):
        frequency = lowest * (i // 2 + 1) * rate
        by_angle = frequency * (-basis[i + 1] if i % 2 == 0 else basis[i - 1])
        for m in range(np.uint64(first), np.uint64(stop)):
            sensitivity[0, i, m] = -frequency * frequency * basis[i]
            sensitivity[1, i, m] = by_angle
            sensitivity[2, i, m] = basis[i]


@of_arrays
def predict_ripple(
    sensitivity: FloatArray, ripple: FloatArray, factor: FloatArray, basis: FloatArray, regressor: FloatArray,
    projected: FloatArray, reading: FloatArray, variance: FloatArray, step: float, width: int, first: int, stop: int,
) -> None:  # fmt: skip
    """Time update of the sensitivity over `step` [s], and contribution of the ripple to a reading with the basis.

    Sets `reading` (.), the ripple in the reading, and `variance` (.), the contribution of its uncertainty to the
    innovation's variance. `factor` (., ., .) holds the transposed covariance factor L' of the coefficients, `projected`
    (., .) becomes L' times the `regressor` (., .).
    """
    begin, end, half = np.uint64(first), np.uint64(stop), 0.5 * step * step
    for m in range(begin, end):
        reading[m] = variance[m] = 0.0
    for i in range(np.uint64(width)):
        at = basis[i]
        for m in range(begin, end):
            acceleration, rate = sensitivity[0, i, m], sensitivity[1, i, m]
            angle = sensitivity[2, i, m] + (step * rate + half * acceleration)
            sensitivity[1, i, m] = rate + step * acceleration
            sensitivity[2, i, m] = angle
            regressor[i, m] = at - angle
            projected[i, m] = 0.0
        for j in range(i + np.uint64(1)):  # interleaved sums: a single sum would wait for its last addition
            for m in range(begin, end):
                projected[j, m] += factor[j, i, m] * regressor[i, m]
    for j in range(np.uint64(width)):
        at = basis[j]
        for m in range(begin, end):
            reading[m] += at * ripple[j, m]
            variance[m] += projected[j, m] * projected[j, m]


@of_arrays
def update_ripple(
    sensitivity: FloatArray, ripple: FloatArray, factor: FloatArray, regressor: FloatArray, projected: FloatArray,
    innovation: FloatArray, variance: FloatArray, gain: FloatArray, clock: FloatArray, parts: FloatArray,
    change: FloatArray, width: int, first: int, stop: int,
) -> None:  # fmt: skip
    """Measurement update of sensitivity and coefficients, and the resulting change of the clock's state.

    `variance` (.), the innovation's without that of the coefficients, becomes the whole; `parts` (2, .) and `change`
    (., .) are work space.
    """
    begin, end, count = np.uint64(first), np.uint64(stop), np.uint64(width)
    for back in range(count):
        j = count - np.uint64(1) - back
        for m in range(begin, end):
            before, seen = variance[m], projected[j, m]
            total = before + seen * seen
            inverse = 1.0 / math.sqrt(before * total)
            parts[0, m], parts[1, m] = before * inverse, seen * inverse
            variance[m], change[j, m] = total, 0.0
        for i in range(j, count):
            for m in range(begin, end):
                old = factor[j, i, m]
                factor[j, i, m] = parts[0, m] * old - parts[1, m] * change[i, m]
                change[i, m] += old * projected[j, m]
    for i in range(count):
        for m in range(begin, end):
            step = change[i, m] * (-innovation[m] / variance[m])
            ripple[i, m] += step
            for row in range(3):
                sensitivity[row, i, m] += gain[row, m] * regressor[i, m]
                clock[row, m] += sensitivity[row, i, m] * step
