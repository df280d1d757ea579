"""Ripple as a function of the angle: a clock phi = theta + g(theta) that runs evenly while the shaft's speed ripples.

g = g1 + g2, g1 linear in the coefficients. For a relative speed ripple h, to first order -dg/dtheta, an even clock
needs 1 / (1 + h) = 1 + g', hence g2' = g1'^2 less its mean.
"""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import layout
from textile_twin_core.shaft.constants import LEAST_SLOPE
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
