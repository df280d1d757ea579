"""The state that a bank tells: mean and covariance of the mixture of all filters that count."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.bank import set_basis_at
from textile_twin_core.shaft.clock import add_products, add_spread, gradient, shaft_state, wave
from textile_twin_core.shaft.status import Record

MINOR = 0.05
"""Filters of less than this part of the heaviest one's weight do not enter the mixture."""


@compiled
def combine(status: Record, row: Record) -> None:
    """Set the status's angle, speed, acceleration; those and their covariance into a row of the table."""
    top = 0.0
    for f in range(lanes.FAMILIES):
        share = status.mode_probability[f] * status.probability[status.best[f]]
        if share > top:
            top, status.leading = share, f
    leading, moments = status.leading, status.moments
    best, about = status.best[leading], status.angle
    set_basis_at(status, about, lanes.WAVES[leading])
    g = wave(status.ripple[best], status.second[leading], lanes.WAVES[leading], status.lowest, status.basis)
    clock = status.clock[:, best]
    about, status.speed, status.acceleration = shaft_state(
        clock[lanes.ANGLE], clock[lanes.RATE], clock[lanes.ACCELERATION], about, g, status.slopes
    )
    moments[:] = 0.0
    status.products[:] = 0.0
    for f in range(lanes.FAMILIES):
        if status.mode_probability[f] >= MINOR * top:
            _add_filters(status, f, about, top)
    for p in range(3):
        moments[1 + p] /= moments[0]
    place = 0
    for p in range(3):
        for q in range(p, 3):
            value = status.products[place] / moments[0] - moments[1 + p] * moments[1 + q]
            row.covariance[3 * p + q] = row.covariance[3 * q + p] = value
            place += 1
    status.angle = about + moments[1]
    status.speed = row.speed = status.speed + moments[2]
    status.acceleration = row.acceleration = status.acceleration + moments[3]


@compiled
def _add_filters(status: Record, f: int, about: float, top: float) -> None:
    """Add a family's filters to the moments about the best one's angle, speed and acceleration: else all would cancel.

    They are the weight and the weighted sums of the three (4,), and those of 00, 01, 02, 11, 12, 22 of their products.
    """
    waves, moments, slopes = lanes.WAVES[f], status.moments, status.slopes
    set_basis_at(status, about, waves)
    for m in range(lanes.FIRST[f], lanes.END[f]):
        mode_probability = status.mode_probability[f] * status.probability[m]
        if mode_probability < MINOR * top:
            continue
        g = wave(status.ripple[m], status.second[f], waves, status.lowest, status.basis)
        clock = status.clock[:, m]
        angle, rate, acceleration = clock[lanes.ANGLE], clock[lanes.RATE], clock[lanes.ACCELERATION]
        theta, omega, alpha = shaft_state(angle, rate, acceleration, about, g, slopes)
        scale, covariance = mode_probability * status.scale[m], status.products
        add_spread(clock[lanes.L20], clock[lanes.L10], clock[lanes.L00], slopes, scale, covariance)
        add_spread(clock[lanes.L21], clock[lanes.L11], 0.0, slopes, scale, covariance)
        add_spread(clock[lanes.L22], 0.0, 0.0, slopes, scale, covariance)
        d0, d1, d2 = theta - about, omega - status.speed, alpha - status.acceleration
        moments[0] += mode_probability
        moments[1] += mode_probability * d0
        moments[2] += mode_probability * d1
        moments[3] += mode_probability * d2
        add_products(d0, d1, d2, mode_probability, covariance)
        if waves > 0:
            set_ripple_covariance(status, waves, status.sensitivity[m], status.factor[m])
            for place in range(6):
                covariance[place] += scale * status.covariance_part[place]


@compiled
def set_ripple_covariance(status: Record, waves: int, sensitivity: FloatArray, factor: FloatArray) -> None:
    """Covariance (6 of `covariance_part`) that uncertain ripple gives the shaft's state, where basis and slopes stand.

    `sensitivity` (3, .) is that of the clock, `factor` (., .) that of the coefficients.
    """
    width, ripple_jacobian, basis, ripple_variance = (
        2 * waves,
        status.ripple_jacobian,
        status.basis,
        status.covariance_part,
    )
    for i in range(width):
        order = status.lowest * (i // 2 + 1)
        value, slope = basis[i], order * (-basis[i + 1] if i % 2 == 0 else basis[i - 1])
        ripple_jacobian[0, i], ripple_jacobian[1, i], ripple_jacobian[2, i] = gradient(
            sensitivity[2, i], sensitivity[1, i], sensitivity[0, i], value, slope, -order * order * value, status.slopes
        )
    for place in range(6):
        ripple_variance[place] = 0.0
    for j in range(np.uint64(width)):
        s0 = s1 = s2 = 0.0
        for i in range(j, np.uint64(width)):
            s0 += factor[j, i] * ripple_jacobian[0, i]
            s1 += factor[j, i] * ripple_jacobian[1, i]
            s2 += factor[j, i] * ripple_jacobian[2, i]
        add_products(s0, s1, s2, 1.0, ripple_variance)
