"""Square-root Kalman filtering of several models side by side: a covariance stays positive by its form.

Each of M models holds the lower triangular factor L of its covariance P = L L', stored as `factor[j, i, m]`: row i of
column j of model m, so that the innermost loops run over the models. The states stand in the order (ripple ...,
acceleration, rate, angle); in this order moving on in time keeps the triangle.
"""

from __future__ import annotations

import math

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled

HALF_JERK = math.sqrt(1.0 / 12.0)
LAST_JERK = math.sqrt(1.0 / 720.0)
"""The factor of white jerk's covariance (see `move_on`) is sqrt(q h) times (1, h/2, h^2/6), (0, HALF_JERK h,
HALF_JERK h^2/2) and (0, 0, LAST_JERK h^2), in the order acceleration, rate, angle."""


@compiled
def move_on(mean: FloatArray, factor: FloatArray, step: float, intensity: FloatArray) -> None:
    """Time update by `step` [s] at constant acceleration, with white jerk of the models' intensities (M,) [rad^2/s^5].

    Its covariance over a step h is q [[h^5/20, h^4/8, h^3/6], [., h^3/3, h^2/2], [., ., h]] for angle, rate,
    acceleration (Bar-Shalom, Li and Kirubarajan 2001, 6.2.3); rotations fold its factor into the states'.
    """
    angle = mean.shape[0] - 1
    rate, acc = angle - 1, angle - 2
    half = 0.5 * step * step
    models = mean.shape[1]
    for m in range(models):
        mean[angle, m] += step * mean[rate, m] + half * mean[acc, m]
        mean[rate, m] += step * mean[acc, m]
    for j in range(acc + 1):
        for m in range(models):
            factor[j, angle, m] += step * factor[j, rate, m] + half * factor[j, acc, m]
            factor[j, rate, m] += step * factor[j, acc, m]
    for m in range(models):
        factor[rate, angle, m] += step * factor[rate, rate, m]
    for m in range(models):
        root = math.sqrt(intensity[m] * step)
        a1, a2 = root * step * 0.5, root * half / 3.0
        b1, b2 = root * step * HALF_JERK, root * half * HALF_JERK
        length = math.sqrt(factor[acc, acc, m] ** 2 + root * root)
        c, s = factor[acc, acc, m] / length, root / length
        left1, left2 = c * a1 - s * factor[acc, rate, m], c * a2 - s * factor[acc, angle, m]
        factor[acc, acc, m] = length
        factor[acc, rate, m] = c * factor[acc, rate, m] + s * a1
        factor[acc, angle, m] = c * factor[acc, angle, m] + s * a2
        length = math.sqrt(factor[rate, rate, m] ** 2 + left1 * left1)
        c, s = factor[rate, rate, m] / length, left1 / length
        left2, across = c * left2 - s * factor[rate, angle, m], c * factor[rate, angle, m] + s * left2
        both = math.sqrt(length * length + b1 * b1)
        c, s = length / both, b1 / both
        factor[rate, rate, m] = both
        factor[rate, angle, m] = c * across + s * b2
        left3, last = c * b2 - s * across, root * step * step * LAST_JERK
        square = factor[angle, angle, m] ** 2 + left2 * left2 + left3 * left3 + last * last
        factor[angle, angle, m] = math.sqrt(square)


@compiled
def foresee(
    mean: FloatArray,
    factor: FloatArray,
    row: int,
    regressor: FloatArray,
    reading: float,
    projected: FloatArray,
    innovation: FloatArray,
    spread: FloatArray,
) -> None:
    """What each model expects of a reading of the state in `row` plus regressor . ripple.

    Sets `projected` (n, M) = L' h, the innovation (M,) and the variance `spread` (M,) that the states give it.
    """
    states, models = mean.shape
    ripple = states - 3
    for m in range(models):
        innovation[m] = reading - mean[row, m]
        spread[m] = 0.0
    for i in range(ripple):
        for m in range(models):
            innovation[m] -= regressor[i] * mean[i, m]
    for j in range(states):
        for m in range(models):
            projected[j, m] = factor[j, row, m] if j <= row else 0.0
        for i in range(j, ripple):
            for m in range(models):
                projected[j, m] += regressor[i] * factor[j, i, m]
        for m in range(models):
            spread[m] += projected[j, m] * projected[j, m]


@compiled
def correct(
    mean: FloatArray,
    factor: FloatArray,
    projected: FloatArray,
    innovation: FloatArray,
    noise: FloatArray,
    gain: FloatArray,
    total: FloatArray,
    keep: FloatArray,
    mix: FloatArray,
) -> None:
    """Measurement update (Carlson 1973), from the last column to the first, which keeps the triangle.

    `noise` (M,) is the reading's variance in each model; `total` (M,) becomes that of the innovation; `gain` (n, M),
    `keep` and `mix` (M,) are room to work in.
    """
    states, models = mean.shape
    for m in range(models):
        total[m] = noise[m]
    for i in range(states):
        for m in range(models):
            gain[i, m] = 0.0
    for back in range(states):
        j = states - 1 - back
        for m in range(models):
            more = total[m] + projected[j, m] * projected[j, m]
            part = 1.0 / math.sqrt(total[m] * more)
            keep[m] = total[m] * part
            mix[m] = projected[j, m] * part
            total[m] = more
        for i in range(j, states):
            for m in range(models):
                old = factor[j, i, m]
                factor[j, i, m] = keep[m] * old - mix[m] * gain[i, m]
                gain[i, m] += old * projected[j, m]
    for m in range(models):
        mix[m] = innovation[m] / total[m]
    for i in range(states):
        for m in range(models):
            mean[i, m] += gain[i, m] * mix[m]
