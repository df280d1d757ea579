"""Ripple of the speed: a clock phi = theta + g(theta) that runs evenly while the shaft's speed ripples.

g = g1 + g2, g1 linear in the coefficients. For a relative speed ripple h, to first order -dg/dtheta, an even clock
needs 1 / (1 + h) = 1 + g', hence g2' = g1'^2 less its mean.

The coefficients are estimated apart from the state (Friedland 1969), by square-root least squares (Carlson 1973).
`sensitivity` is the derivative of the state by the coefficients, `regressor` that of the innovation. The last axis of
arrays is the filter: functions process filters first .. stop - 1.
"""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import layout
from textile_twin_core.shaft.constants import LEAST_SLOPE
from textile_twin_core.shaft.layout import of_arrays
from textile_twin_core.shaft.status import Bank, Wave


@compiled_in_place
def set_basis_at(wave: Wave, theta: float, waves: int) -> None:
    """Set `basis` to cos and sin of lowest, 2 lowest .. 2 waves lowest times theta, alternating, unless it is so."""
    if waves == 0 or (wave.basis_at == theta and wave.basis_waves >= waves):
        return
    wave.basis_at, wave.basis_waves = theta, float(waves)
    c, s = math.cos(wave.lowest * theta), math.sin(wave.lowest * theta)
    ck, sk = c, s
    for k in range(2 * waves):
        wave.basis[2 * k] = ck
        wave.basis[2 * k + 1] = sk
        ck, sk = ck * c - sk * s, sk * c + ck * s


@compiled_in_place
def set_second(ripple: FloatArray, waves: int, lowest: float, second: FloatArray) -> None:
    """Compute the coefficients of g2 from those of g1: g1' = sum(p cos + q sin), squared and integrated."""
    second[: 4 * waves] = 0.0
    for i in range(1, waves + 1):
        pi, qi = lowest * i * ripple[2 * i - 1], -lowest * i * ripple[2 * i - 2]
        for j in range(1, waves + 1):
            pj, qj = lowest * j * ripple[2 * j - 1], -lowest * j * ripple[2 * j - 2]
            up, down = i + j, i - j
            second[2 * up - 1] += 0.5 * (pi * pj - qi * qj) / (lowest * up)
            second[2 * up - 2] -= 0.5 * (pi * qj + qi * pj) / (lowest * up)
            if down > 0:
                second[2 * down - 1] += (pi * pj + qi * qj) / (lowest * down)
                second[2 * down - 2] -= (qi * pj - pi * qj) / (lowest * down)


@compiled_in_place
def dot(a: FloatArray, b: FloatArray, size: int) -> float:
    """Scalar product of the first `size` elements."""
    total = 0.0
    for k in range(size):
        total += a[k] * b[k]
    return total


@compiled_in_place
def copy_numbers(source: FloatArray, target: FloatArray) -> None:
    """Copy (n,) numbers."""
    for i in range(source.size):
        target[i] = source[i]


@compiled_in_place
def wave_at(bank: Bank, f: int, m: int, second: FloatArray, theta: float) -> tuple[float, float, float, float]:
    """Return g and its first three derivatives at an angle: ripple of filter m of model f, plus `second` (., .)."""
    ripple, waves, basis, lowest = bank.filters.ripple[:, m], bank.models.waves[f], bank.wave.basis, bank.wave.lowest
    set_basis_at(bank.wave, theta, waves)
    g0 = g1 = g2 = g3 = 0.0
    for k in range(2 * waves):
        order = lowest * (k + 1)
        a, b = second[f, 2 * k], second[f, 2 * k + 1]
        if k < waves:
            a += ripple[2 * k]
            b += ripple[2 * k + 1]
        p = a * basis[2 * k] + b * basis[2 * k + 1]
        q = order * (b * basis[2 * k] - a * basis[2 * k + 1])
        g0 += p
        g1 += q
        g2 -= order * order * p
        g3 -= order * order * q
    return g0, g1, g2, g3


@compiled_in_place
def shaft_state(bank: Bank, f: int, m: int, clock: FloatArray, theta: float) -> tuple[float, float, float]:
    """Return the shaft's angle, speed and acceleration from its clock (9,) and a filter's ripple, by one Newton step.

    The step starts from `theta`. Sets `slopes` for `gradient`.
    """
    g, slopes = wave_at(bank, f, m, bank.models.shaft_second, theta), bank.wave.slopes
    shift = (clock[layout.ANGLE] - theta - g[0]) / max(1.0 + g[1], LEAST_SLOPE)
    slope, bend = g[1] + shift * g[2], g[2] + shift * g[3]
    even = 1.0 / max(1.0 + slope, LEAST_SLOPE)
    omega = clock[layout.RATE] * even
    alpha = (clock[layout.ACCELERATION] - omega * omega * bend) * even
    slopes[0], slopes[1], slopes[2], slopes[3], slopes[4] = even, omega, alpha, bend, g[3]
    return theta + shift, omega, alpha


@compiled_in_place
def gradient(
    clock: float, rate: float, acceleration: float, d0: float, d1: float, d2: float, slopes: FloatArray
) -> tuple[float, float, float]:
    """Return changes of the shaft's angle, speed, acceleration by those of the clock and of g, g', g'' (d0, d1, d2)."""
    even, omega, alpha, bend = slopes[0], slopes[1], slopes[2], slopes[3]
    by0 = (clock - d0) * even
    by1 = (rate - omega * (d1 + bend * by0)) * even
    by2 = acceleration - alpha * (d1 + bend * by0) - 2.0 * omega * bend * by1 - omega * omega * (d2 + slopes[4] * by0)
    return by0, by1, by2 * even


@compiled_in_place
def add_spread(clock: FloatArray, slopes: FloatArray, scale: float, covariance: FloatArray) -> None:
    """Add to the shaft's covariance (9,) `scale` times the contribution of the factor in a clock (9,)."""
    column = gradient(clock[layout.L20], clock[layout.L10], clock[layout.L00], 0.0, 0.0, 0.0, slopes)
    add_products(column, scale, covariance)
    add_products(gradient(clock[layout.L21], clock[layout.L11], 0.0, 0.0, 0.0, 0.0, slopes), scale, covariance)
    add_products(gradient(clock[layout.L22], 0.0, 0.0, 0.0, 0.0, 0.0, slopes), scale, covariance)


@compiled_in_place
def add_products(d: tuple[float, float, float], scale: float, covariance: FloatArray) -> None:
    """Add `scale` times the products of three numbers to a covariance (9,), row by row."""
    for p in range(3):
        for q in range(3):
            covariance[3 * p + q] += scale * d[p] * d[q]


@compiled_in_place
def add_ripple_covariance(bank: Bank, waves: int, m: int, scale: float, covariance: FloatArray) -> None:
    """Add `scale` times the shaft's covariance (9,) by filter m's uncertain ripple, at the current basis and slopes."""
    width, wave, sensitivity, factor = 2 * waves, bank.wave, bank.filters.sensitivity, bank.filters.factor
    basis, jacobian = wave.basis, wave.jacobian
    for i in range(width):
        order = wave.lowest * (i // 2 + 1)
        value, slope = basis[i], order * (-basis[i + 1] if i % 2 == 0 else basis[i - 1])
        jacobian[0, i], jacobian[1, i], jacobian[2, i] = gradient(
            sensitivity[2, i, m], sensitivity[1, i, m], sensitivity[0, i, m], value, slope, -order * order * value,
            wave.slopes,
        )  # fmt: skip
    for j in range(np.uint64(width)):
        s0 = s1 = s2 = 0.0
        for i in range(j, np.uint64(width)):
            s0 += factor[j, i, m] * jacobian[0, i]
            s1 += factor[j, i, m] * jacobian[1, i]
            s2 += factor[j, i, m] * jacobian[2, i]
        add_products((s0, s1, s2), scale, covariance)


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
