"""Ripple as a function of the angle: a clock phi = theta + g(theta) that runs evenly while the shaft's speed ripples.

g = g1 + g2 with g1 = sum(a_k cos(k theta) + b_k sin(k theta)), linear in the coefficients. For a relative speed ripple
h, to first order -dg/dtheta, an even clock needs 1 / (1 + h) = 1 + g', hence g2' = g1'^2 less its mean: few orders of h
then take few coefficients.
"""

from __future__ import annotations

import math

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import lanes

LEAST_SLOPE = 0.3  # of a clock over the angle, dphi/dtheta: one that stands still measures nothing


@compiled_in_place
def set_basis(theta: float, lowest: float, size: int, basis: FloatArray) -> None:
    """cos and sin of theta times lowest, 2 lowest, 3 lowest ..., alternating, by the addition theorem."""
    c, s = math.cos(lowest * theta), math.sin(lowest * theta)
    ck, sk = c, s
    for k in range(size // 2):
        basis[2 * k] = ck
        basis[2 * k + 1] = sk
        ck, sk = ck * c - sk * s, sk * c + ck * s


@compiled_in_place
def set_second(ripple: FloatArray, waves: int, lowest: float, second: FloatArray, change: FloatArray) -> None:
    """Coefficients of g2 from those of g1: g1' = sum(p cos + q sin), squared and integrated.

    Adds to `change` (.) how those of g1's own orders change.
    """
    for i in range(2 * waves):
        change[i] -= second[i]
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
    for i in range(2 * waves):
        change[i] += second[i]


@compiled_in_place
def dot(a: FloatArray, b: FloatArray, size: int) -> float:
    """Scalar product of the first so many elements."""
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
def wave(
    ripple: FloatArray, second: FloatArray, waves: int, lowest: float, basis: FloatArray
) -> tuple[float, float, float, float]:
    """g and its first three derivatives by theta at the angle of the basis; `second` (.) is added to g1's `ripple`."""
    g0 = g1 = g2 = g3 = 0.0
    for k in range(2 * waves):
        order = lowest * (k + 1)
        a, b = second[2 * k], second[2 * k + 1]
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
def shaft_state(
    clock: float, rate: float, acceleration: float, theta: float, g: tuple[float, float, float, float], slopes:
    FloatArray,
) -> tuple[float, float, float]:  # fmt: skip
    """Angle, speed and acceleration of the shaft from those of its clock, by a Newton step from `theta`, where `g` is.

    Sets `slopes` (.) for `gradient`.
    """
    shift = (clock - theta - g[0]) / max(1.0 + g[1], LEAST_SLOPE)
    slope, bend = g[1] + shift * g[2], g[2] + shift * g[3]
    even = 1.0 / max(1.0 + slope, LEAST_SLOPE)
    omega = rate * even
    alpha = (acceleration - omega * omega * bend) * even
    slopes[0], slopes[1], slopes[2], slopes[3], slopes[4] = even, omega, alpha, bend, g[3]
    return theta + shift, omega, alpha


@compiled_in_place
def gradient(
    clock: float, rate: float, acceleration: float, d0: float, d1: float, d2: float, slopes: FloatArray
) -> tuple[float, float, float]:
    """Change of the shaft's angle, speed, acceleration for small ones of the clock's and of g, g', g'' (d0, d1, d2)."""
    even, omega, alpha, bend = slopes[0], slopes[1], slopes[2], slopes[3]
    by0 = (clock - d0) * even
    by1 = (rate - omega * (d1 + bend * by0)) * even
    by2 = acceleration - alpha * (d1 + bend * by0) - 2.0 * omega * bend * by1 - omega * omega * (d2 + slopes[4] * by0)
    return by0, by1, by2 * even


@compiled_in_place
def add_spread(clock: FloatArray, slopes: FloatArray, scale: float, covariance: FloatArray) -> None:
    """Add scale times what the factor in a clock (9,) makes of the shaft's covariance (9,)."""
    column = gradient(clock[lanes.L20], clock[lanes.L10], clock[lanes.L00], 0.0, 0.0, 0.0, slopes)
    add_products(column, scale, covariance)
    add_products(gradient(clock[lanes.L21], clock[lanes.L11], 0.0, 0.0, 0.0, 0.0, slopes), scale, covariance)
    add_products(gradient(clock[lanes.L22], 0.0, 0.0, 0.0, 0.0, 0.0, slopes), scale, covariance)


@compiled_in_place
def add_products(d: tuple[float, float, float], scale: float, covariance: FloatArray) -> None:
    """Add scale times the products of three numbers to a covariance (9,), row by row."""
    for p in range(3):
        for q in range(3):
            covariance[3 * p + q] += scale * d[p] * d[q]
