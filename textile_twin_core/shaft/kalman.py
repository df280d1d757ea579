"""Square-root Kalman filters of angle, speed and acceleration, side by side in lanes: a covariance stays positive.

Each lane of `filters` (see `status`) holds acceleration, rate and angle of its clock, and the lower triangular factor L
of their covariance P = L L' in that order, in which moving on in time keeps the triangle. Lanes are counted without a
sign: a place that might be negative would be looked at in each lane, and none of them would go side by side in vectors.
"""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.compiling import compiled
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.status import Record

FREEDOM = 6.0
"""Of Student's t for the innovations: delays of an operating system have tails, and one reading far off says little."""
ROBUST = 9.0
"""A normalised innovation squared above this widens its own reading until it is this."""
HALF_JERK = math.sqrt(1.0 / 12.0)
LAST_JERK = math.sqrt(1.0 / 720.0)
"""The factor of white jerk's covariance (see `time_update`) is sqrt(q h) times (1, h/2, h^2/6), (0, HALF_JERK h,
HALF_JERK h^2/2) and (0, 0, LAST_JERK h^2), in the order acceleration, rate, angle."""


@compiled
def time_update(filters: Record, strength: float, step: float, first: int, end: int) -> None:
    """Time update of lanes first .. end - 1 by `step` [s] at constant acceleration, with white jerk.

    Its covariance over a step h is q [[h^5/20, h^4/8, h^3/6], [., h^3/3, h^2/2], [., ., h]] for angle, rate,
    acceleration (Bar-Shalom, Li and Kirubarajan 2001, 6.2.3), with sqrt(q h) = weakness strength; rotations fold its
    factor into the lane's.
    """
    x = filters.clock
    acceleration, rate, angle = x[lanes.ACCELERATION], x[lanes.RATE], x[lanes.ANGLE]
    l00, l10, l20 = x[lanes.L00], x[lanes.L10], x[lanes.L20]
    l11, l21, l22 = x[lanes.L11], x[lanes.L21], x[lanes.L22]
    jerk_strength = filters.jerk_strength
    half = 0.5 * step * step
    for m in range(np.uint64(first), np.uint64(end)):
        angle[m] += step * rate[m] + half * acceleration[m]
        rate[m] += step * acceleration[m]
        f00, f11 = l00[m], l11[m]
        f10 = l10[m] + step * f00
        f20 = l20[m] + step * l10[m] + half * f00
        f21 = l21[m] + step * f11
        root = jerk_strength[m] * strength
        a1, a2 = root * step * 0.5, root * half / 3.0
        b1, b2 = root * step * HALF_JERK, root * half * HALF_JERK
        length = math.sqrt(f00 * f00 + root * root)
        inverse = 1.0 / length
        c, s = f00 * inverse, root * inverse
        left1, left2 = c * a1 - s * f10, c * a2 - s * f20
        l00[m] = length
        l10[m] = c * f10 + s * a1
        l20[m] = c * f20 + s * a2
        length = math.sqrt(f11 * f11 + left1 * left1 + b1 * b1)
        pivot = f11 + length
        part = (pivot * f21 + left1 * left2 + b1 * b2) / (length * pivot)
        l11[m] = length
        l21[m] = part * pivot - f21
        left2 -= part * left1
        left3, last = b2 - part * b1, root * step * step * LAST_JERK
        l22[m] = math.sqrt(l22[m] * l22[m] + left2 * left2 + left3 * left3 + last * last)


@compiled
def innovate(filters: Record, reading: float, noise: float, first: int, end: int) -> None:
    """Innovations of a reading in lanes first .. end - 1, and their likelihoods but for a constant.

    `ripple_reading` and `ripple_variance` (.) are what ripple adds to the reading, and to the innovation's variance.
    """
    x, projected, ripple_reading, ripple_variance, scale = (
        filters.clock,
        filters.projected,
        filters.ripple_reading,
        filters.ripple_variance,
        filters.scale,
    )
    angle, l20, l21, l22 = x[lanes.ANGLE], x[lanes.L20], x[lanes.L21], x[lanes.L22]
    projected0, projected1, projected2, noise_variance = (
        projected[0],
        projected[1],
        projected[2],
        filters.noise_variance,
    )
    innovation, prior_variance, likelihood = filters.innovation, filters.prior_variance, filters.likelihood
    for m in range(np.uint64(first), np.uint64(end)):
        p0, p1, p2 = l20[m], l21[m], l22[m]
        projected0[m], projected1[m], projected2[m] = p0, p1, p2
        off = reading + ripple_reading[m] - angle[m]
        by = ripple_variance[m] + p0 * p0 + p1 * p1 + p2 * p2
        squared = off * off / scale[m]
        rest = 1.0 + squared / (FREEDOM * (noise + by))
        innovation[m], prior_variance[m] = off, by
        wide = squared / ROBUST - by
        noise_variance[m] = wide if wide > noise else noise
        likelihood[m] = 1.0 / (rest * rest * rest * math.sqrt(rest * scale[m] * (noise + by)))


@compiled
def measurement_update(filters: Record, first: int, end: int) -> None:
    """Measurement update of lanes first .. end - 1 (Carlson 1973), from the last column to the first.

    `projected` (3, .) is L' h, what the reading sees of each column. The gains of the three states are written down.
    """
    x = filters.clock
    acceleration, rate, angle = x[lanes.ACCELERATION], x[lanes.RATE], x[lanes.ANGLE]
    l00, l10, l20 = x[lanes.L00], x[lanes.L10], x[lanes.L20]
    l11, l21, l22 = x[lanes.L11], x[lanes.L21], x[lanes.L22]
    projected, gain, noise_variance, innovation = (
        filters.projected,
        filters.gain,
        filters.noise_variance,
        filters.innovation,
    )
    for m in range(np.uint64(first), np.uint64(end)):
        p0, p1, p2 = projected[0, m], projected[1, m], projected[2, m]
        before = noise_variance[m]
        total = before + p2 * p2
        keep = before / math.sqrt(before * total)
        g2 = l22[m] * p2
        l22[m] *= keep
        before, total = total, total + p1 * p1
        part = 1.0 / math.sqrt(before * total)
        keep, mix = before * part, p1 * part
        f11, f21 = l11[m], l21[m]
        l11[m] = keep * f11
        l21[m] = keep * f21 - mix * g2
        g1 = f11 * p1
        g2 += f21 * p1
        before, total = total, total + p0 * p0
        part = 1.0 / math.sqrt(before * total)
        keep, mix = before * part, p0 * part
        f00, f10, f20 = l00[m], l10[m], l20[m]
        l00[m] = keep * f00
        l10[m] = keep * f10 - mix * g1
        l20[m] = keep * f20 - mix * g2
        trust = 1.0 / total
        k0, k1, k2, off = f00 * p0 * trust, (g1 + f10 * p0) * trust, (g2 + f20 * p0) * trust, innovation[m]
        gain[0, m], gain[1, m], gain[2, m] = k0, k1, k2
        acceleration[m] += k0 * off
        rate[m] += k1 * off
        angle[m] += k2 * off
