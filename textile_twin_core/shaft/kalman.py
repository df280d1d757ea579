"""Square-root Kalman filters of angle, rate and acceleration, vectorised over filters; covariances stay positive.

Each filter of `filters` (see `status`) holds acceleration, rate and angle of its clock and the lower triangular factor
L of their covariance P = L L' in that order, in which the time update preserves the triangle. Filter indices are
unsigned: the check for negative ones would prevent vectorisation.
"""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.shaft import layout
from textile_twin_core.shaft.constants import FREEDOM, HALF_JERK, LAST_JERK, ROBUST
from textile_twin_core.shaft.status import Filters


@layout.vectorised
def time_update(filters: Filters, strength: float, step: float, first: int, end: int) -> None:
    """Time update of filters first .. end - 1 over `step` [s]: constant acceleration driven by white jerk.

    Process noise of sqrt(q h) = jerk_strength * strength (Bar-Shalom, Li and Kirubarajan 2001, 6.2.3). A Givens
    rotation and a Householder reflection merge its factor with the filter's.
    """
    x = filters.clock
    acceleration, rate, angle = x[layout.ACCELERATION], x[layout.RATE], x[layout.ANGLE]
    l00, l10, l20 = x[layout.L00], x[layout.L10], x[layout.L20]
    l11, l21, l22 = x[layout.L11], x[layout.L21], x[layout.L22]
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


@layout.vectorised
def innovate(filters: Filters, reading: float, noise: float, first: int, end: int) -> None:
    """Set innovations of a measurement in filters first .. end - 1 and their Student-t likelihoods, up to a constant.

    `ripple_reading` and `ripple_variance` (.) are the contributions of the ripple to the measurement and to the
    variance of the innovation.
    """
    x, scale, innovation, likelihood = filters.clock, filters.scale, filters.innovation, filters.likelihood
    angle, l20, l21, l22 = x[layout.ANGLE], x[layout.L20], x[layout.L21], x[layout.L22]
    projected0, projected1, projected2 = filters.projected[0], filters.projected[1], filters.projected[2]
    ripple_reading, ripple_variance = filters.ripple_reading, filters.ripple_variance
    prior_variance, noise_variance = filters.prior_variance, filters.noise_variance
    for m in range(np.uint64(first), np.uint64(end)):
        p0, p1, p2 = l20[m], l21[m], l22[m]
        projected0[m], projected1[m], projected2[m] = p0, p1, p2
        residual = reading + ripple_reading[m] - angle[m]
        prior = ripple_variance[m] + p0 * p0 + p1 * p1 + p2 * p2
        squared = residual * residual / scale[m]
        tail = 1.0 + squared / (FREEDOM * (noise + prior))
        innovation[m], prior_variance[m] = residual, prior
        inflated = squared * (1.0 / ROBUST) - prior
        noise_variance[m] = inflated if inflated > noise else noise
        likelihood[m] = 1.0 / (tail * tail * tail * math.sqrt(tail * scale[m] * (noise + prior)))


@layout.vectorised
def measurement_update(filters: Filters, first: int, end: int) -> None:
    """Measurement update of filters first .. end - 1 (Carlson 1973), from the last column of L to the first.

    `projected` (3, .) is L' h with h the measurement's row; `gain` (3, .) becomes the gains.
    """
    x, projected, gain = filters.clock, filters.projected, filters.gain
    acceleration, rate, angle = x[layout.ACCELERATION], x[layout.RATE], x[layout.ANGLE]
    l00, l10, l20 = x[layout.L00], x[layout.L10], x[layout.L20]
    l11, l21, l22 = x[layout.L11], x[layout.L21], x[layout.L22]
    noise_variance, innovation, clock_variance = filters.noise_variance, filters.innovation, filters.clock_variance
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
        clock_variance[m], inverse = total, 1.0 / total
        k0, k1, k2 = f00 * p0 * inverse, (g1 + f10 * p0) * inverse, (g2 + f20 * p0) * inverse
        gain[0, m], gain[1, m], gain[2, m] = k0, k1, k2
        acceleration[m] += k0 * innovation[m]
        rate[m] += k1 * innovation[m]
        angle[m] += k2 * innovation[m]
