"""Ripple by angle, as a clock phi = theta + g(theta) that runs evenly while the shaft's speed ripples.

g = sum(a_k cos(k theta) + b_k sin(k theta)) + g2. The coefficients a_k, b_k are states of the filter and enter a
reading
linearly: theta = phi - g. With the speed's ripple h = -dg/dtheta to first order, an even clock wants
1 / (1 + h) = 1 + g', so that g2' = g1'^2 less its mean: few orders of h then are few coefficients.
"""

from __future__ import annotations

import math

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled


@compiled
def set_basis(theta: float, lowest: float, basis: FloatArray) -> None:
    """cos and sin of theta times lowest, 2 lowest, 3 lowest ..., alternating, by the addition theorem."""
    c, s = math.cos(lowest * theta), math.sin(lowest * theta)
    ck, sk = c, s
    for k in range(basis.size // 2):
        basis[2 * k] = ck
        basis[2 * k + 1] = sk
        ck, sk = ck * c - sk * s, sk * c + ck * s


@compiled
def set_second(mean: FloatArray, m: int, lowest: float, second: FloatArray) -> None:
    """Coefficients of g2 from the ripple (first rows) of model m: g1' = sum(p cos + q sin) squared and integrated."""
    second[:] = 0.0
    for i in range(1, second.size // 4 + 1):
        pi, qi = lowest * i * mean[2 * i - 1, m], -lowest * i * mean[2 * i - 2, m]
        for j in range(1, second.size // 4 + 1):
            pj, qj = lowest * j * mean[2 * j - 1, m], -lowest * j * mean[2 * j - 2, m]
            up, down = i + j, i - j
            second[2 * up - 1] += 0.5 * (pi * pj - qi * qj) / (lowest * up)
            second[2 * up - 2] -= 0.5 * (pi * qj + qi * pj) / (lowest * up)
            if down > 0:
                second[2 * down - 1] += (pi * pj + qi * qj) / (lowest * down)
                second[2 * down - 2] -= (qi * pj - pi * qj) / (lowest * down)


@compiled
def known_part(second: FloatArray, basis: FloatArray) -> float:
    """g2 at the angle of the basis."""
    g = 0.0
    for k in range(second.size):
        g += second[k] * basis[k]
    return g


@compiled
def wave(mean: FloatArray, m: int, lowest: float, basis: FloatArray, second: FloatArray, out: FloatArray) -> None:
    """g of model m and its first three derivatives by theta, at the angle of the basis, into `out` (4,)."""
    g0 = g1 = g2 = g3 = 0.0
    for k in range(second.size // 2):
        order = lowest * (k + 1)
        a, b = second[2 * k], second[2 * k + 1]
        if 4 * k < second.size:
            a += mean[2 * k, m]
            b += mean[2 * k + 1, m]
        p = a * basis[2 * k] + b * basis[2 * k + 1]
        q = order * (b * basis[2 * k] - a * basis[2 * k + 1])
        g0 += p
        g1 += q
        g2 -= order * order * p
        g3 -= order * order * q
    out[0], out[1], out[2], out[3] = g0, g1, g2, g3


@compiled
def angle_of(
    mean: FloatArray, m: int, lowest: float, basis: FloatArray, second: FloatArray, guess: float, out: FloatArray
) -> float:
    """The angle at which the clock of model m stands, near `guess`: two Newton steps."""
    clock = mean[mean.shape[0] - 1, m]
    if second.size == 0:
        return float(clock)
    theta = guess
    for _ in range(2):
        set_basis(theta, lowest, basis)
        wave(mean, m, lowest, basis, second, out)
        theta += (clock - theta - out[0]) / max(1.0 + out[1], 0.3)
    return theta


@compiled
def observe(
    mean: FloatArray,
    factor: FloatArray,
    m: int,
    lowest: float,
    basis: FloatArray,
    second: FloatArray,
    theta: float,
    out: FloatArray,
    state: FloatArray,
    gradient: FloatArray,
) -> None:
    """The shaft's state of model m near `theta`, where the basis stands: angle, speed, acceleration into `state` (3,).

    One Newton step from `theta`: the models differ from each other by little. `gradient` (3, n) becomes J L, whose
    product with its transpose is the covariance of the state.
    """
    states = mean.shape[0]
    angle = states - 1
    wave(mean, m, lowest, basis, second, out)
    shift = (mean[angle, m] - theta - out[0]) / max(1.0 + out[1], 0.3)
    slope, bend, twist = out[1] + shift * out[2], out[2] + shift * out[3], out[3]
    even = 1.0 / max(1.0 + slope, 0.3)
    omega = mean[angle - 1, m] * even
    alpha = (mean[angle - 2, m] - omega * omega * bend) * even
    state[0], state[1], state[2] = theta + shift, omega, alpha
    for j in range(states):
        d0 = d1 = d2 = 0.0
        for k in range(j // 2, (states - 3) // 2):
            order = lowest * (k + 1)
            a = factor[j, 2 * k, m] if 2 * k >= j else 0.0
            b = factor[j, 2 * k + 1, m]
            p = basis[2 * k] * a + basis[2 * k + 1] * b
            d0 += p
            d1 += order * (basis[2 * k] * b - basis[2 * k + 1] * a)
            d2 -= order * order * p
        acc = factor[j, angle - 2, m] if j <= angle - 2 else 0.0
        rate = factor[j, angle - 1, m] if j <= angle - 1 else 0.0
        by0 = (factor[j, angle, m] - d0) * even
        d1 += bend * by0
        d2 += twist * by0
        by1 = (rate - omega * d1) * even
        gradient[0, j] = by0
        gradient[1, j] = by1
        gradient[2, j] = (acc - alpha * d1 - 2.0 * omega * bend * by1 - omega * omega * d2) * even
