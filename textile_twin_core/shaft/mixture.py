"""The estimated state: mean and covariance of the mixture of all filters with a sizeable probability."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.bank import set_basis_at
from textile_twin_core.shaft.clock import add_products, add_spread, gradient, shaft_state, wave
from textile_twin_core.shaft.status import Record

MINOR = 0.05  # filters of less than this part of the greatest probability do not enter the mixture


@compiled_in_place
def combine(status: Record, row: Record) -> None:
    """Set angle, speed and acceleration of the status, and the row's speed, acceleration and covariance (9,)."""
    top = 0.0
    for f in range(lanes.FAMILIES):
        share = status.mode_probability[f] * status.probability[status.best[f]]
        if share > top:
            top, status.leading = share, f
    leading, moments = status.leading, status.moments
    best, about = status.best[leading], status.angle
    set_basis_at(status, about, status.waves[leading])
    g = wave(status.ripple[:, best], status.shaft_second[leading], status.waves[leading], status.lowest, status.basis)
    clock = status.clock[:, best]
    about, status.speed, status.acceleration = shaft_state(
        clock[lanes.ANGLE], clock[lanes.RATE], clock[lanes.ACCELERATION], about, g, status.slopes
    )
    moments[:] = 0.0
    row.covariance[:] = 0.0
    for f in range(lanes.FAMILIES):
        if status.mode_probability[f] >= MINOR * top:
            _add_moments(status, f, about, top, row.covariance)
    mean = moments[1] / moments[0], moments[2] / moments[0], moments[3] / moments[0]
    for place in range(9):
        row.covariance[place] /= moments[0]
    add_products(mean, -1.0, row.covariance)
    status.angle = about + mean[0]
    status.speed = row.speed = status.speed + mean[1]
    status.acceleration = row.acceleration = status.acceleration + mean[2]


@compiled_in_place
def _add_moments(status: Record, f: int, about: float, top: float, products: FloatArray) -> None:
    """Add a family's filters to the moments about the best filter's state, which avoids cancellation.

    `moments` (4,): total probability, weighted deviations of angle, speed, acceleration; `products` (9,): second
    moments.
    """
    waves, moments, slopes = status.waves[f], status.moments, status.slopes
    set_basis_at(status, about, waves)
    for m in range(lanes.FIRST[f], lanes.END[f]):
        weight = status.mode_probability[f] * status.probability[m]
        if weight < MINOR * top:
            continue
        g = wave(status.ripple[:, m], status.shaft_second[f], waves, status.lowest, status.basis)
        clock = status.clock[:, m]
        angle, rate, acceleration = clock[lanes.ANGLE], clock[lanes.RATE], clock[lanes.ACCELERATION]
        theta, omega, alpha = shaft_state(angle, rate, acceleration, about, g, slopes)
        scale = weight * status.scale[m]
        add_spread(clock, slopes, scale, products)
        d0, d1, d2 = theta - about, omega - status.speed, alpha - status.acceleration
        moments[0] += weight
        moments[1] += weight * d0
        moments[2] += weight * d1
        moments[3] += weight * d2
        add_products((d0, d1, d2), weight, products)
        if waves > 0:
            add_ripple_covariance(status, waves, m, scale, products)


@compiled_in_place
def add_ripple_covariance(status: Record, waves: int, m: int, scale: float, covariance: FloatArray) -> None:
    """Add scale times the shaft's covariance (9,) due to lane m's uncertain ripple, at the basis and slopes."""
    width, basis, sensitivity, factor = 2 * waves, status.basis, status.sensitivity, status.factor
    jacobian = status.ripple_jacobian
    for i in range(width):
        order = status.lowest * (i // 2 + 1)
        value, slope = basis[i], order * (-basis[i + 1] if i % 2 == 0 else basis[i - 1])
        jacobian[0, i], jacobian[1, i], jacobian[2, i] = gradient(
            sensitivity[2, i, m], sensitivity[1, i, m], sensitivity[0, i, m], value, slope, -order * order * value,
            status.slopes,
        )  # fmt: skip
    for j in range(np.uint64(width)):
        s0 = s1 = s2 = 0.0
        for i in range(j, np.uint64(width)):
            s0 += factor[j, i, m] * jacobian[0, i]
            s1 += factor[j, i, m] * jacobian[1, i]
            s2 += factor[j, i, m] * jacobian[2, i]
        add_products((s0, s1, s2), scale, covariance)
