"""The state that a bank tells: mean and covariance of the mixture of all filters that count."""

from __future__ import annotations

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.shaft.bank import stand_at
from textile_twin_core.shaft.clock import angle_of, gradient, shaft_state, wave
from textile_twin_core.shaft.status import ACCELERATION, COVARIANCE, END, FAMILIES, FIRST, SPEED, WAVES, Record

MINOR = 0.05
"""Filters of less than this part of the heaviest one's weight do not enter the mixture."""


@compiled
def mix(status: Record, row: FloatArray) -> None:
    """Set the status's angle, speed, acceleration; those and their covariance into a row of the table."""
    top = 0.0
    for f in range(FAMILIES):
        share = status.weight[f] * status.probability[status.best[f]]
        if share > top:
            top, status.lead = share, f
    lead, moments = status.lead, status.moments
    best = status.best[lead]
    about = angle_of(
        status.clock_angle[best], status.ripple[best], status.second[lead], WAVES[lead], status.lowest, status.angle,
        status.basis,
    )  # fmt: skip
    status.basis_waves = 0.0
    for place in range(10):
        moments[place] = 0.0
    for f in range(FAMILIES):
        if status.weight[f] >= MINOR * top:
            _blend(status, f, about, top)
    for p in range(3):
        moments[1 + p] /= moments[0]
    place = 4
    for p in range(3):
        for q in range(p, 3):
            value = moments[place] / moments[0] - moments[1 + p] * moments[1 + q]
            row[COVARIANCE + 3 * p + q] = row[COVARIANCE + 3 * q + p] = value
            place += 1
    status.angle = about + moments[1]
    status.speed = row[SPEED] = status.speed + moments[2]
    status.acceleration = row[ACCELERATION] = status.acceleration + moments[3]


@compiled
def _blend(status: Record, f: int, about: float, top: float) -> None:
    """Add a family's filters to moments (10,) about an angle and the speed and acceleration of before.

    They are the weight; the weighted sums of the three; and of 00, 01, 02, 11, 12, 22 of their products.
    """
    waves, moments, slopes = WAVES[f], status.moments, status.slopes
    stand_at(status, about, waves)
    for m in range(FIRST[f], END[f]):
        weight = status.weight[f] * status.probability[m]
        if weight < MINOR * top:
            continue
        g = wave(status.ripple[m], status.second[f], waves, status.lowest, status.basis)
        theta, omega, alpha = shaft_state(
            status.clock_angle[m], status.clock_rate[m], status.clock_acceleration[m], about, g, slopes
        )
        a0, a1, a2 = gradient(status.l20[m], status.l10[m], status.l00[m], 0.0, 0.0, 0.0, slopes)
        b0, b1, b2 = gradient(status.l21[m], status.l11[m], 0.0, 0.0, 0.0, 0.0, slopes)
        c0, c1, c2 = gradient(status.l22[m], 0.0, 0.0, 0.0, 0.0, 0.0, slopes)
        scale, common = weight * status.scale[m], status.common_part
        d0, d1, d2 = theta - about, omega - status.speed, alpha - status.acceleration
        moments[0] += weight
        moments[1] += weight * d0
        moments[2] += weight * d1
        moments[3] += weight * d2
        moments[4] += scale * (a0 * a0 + b0 * b0 + c0 * c0) + weight * d0 * d0
        moments[5] += scale * (a0 * a1 + b0 * b1 + c0 * c1) + weight * d0 * d1
        moments[6] += scale * (a0 * a2 + b0 * b2 + c0 * c2) + weight * d0 * d2
        moments[7] += scale * (a1 * a1 + b1 * b1 + c1 * c1) + weight * d1 * d1
        moments[8] += scale * (a1 * a2 + b1 * b2 + c1 * c2) + weight * d1 * d2
        moments[9] += scale * (a2 * a2 + b2 * b2 + c2 * c2) + weight * d2 * d2
        if waves > 0:
            owe(status, waves, status.sensitivity[m], status.factor[m])
            for place in range(6):
                moments[4 + place] += scale * common[place]


@compiled
def owe(status: Record, waves: int, sensitivity: FloatArray, factor: FloatArray) -> None:
    """Covariance (6 of `common_part`) that uncertain ripple gives the shaft's state, where basis and slopes stand.

    `sensitivity` (3, .) is that of the clock, `factor` (., .) that of the coefficients.
    """
    width, owed, basis, common = 2 * waves, status.owed, status.basis, status.common_part
    for i in range(width):
        order = status.lowest * (i // 2 + 1)
        value, slope = basis[i], order * (-basis[i + 1] if i % 2 == 0 else basis[i - 1])
        owed[0, i], owed[1, i], owed[2, i] = gradient(
            sensitivity[2, i], sensitivity[1, i], sensitivity[0, i], value, slope, -order * order * value, status.slopes
        )
    for place in range(6):
        common[place] = 0.0
    for j in range(width):
        s0 = s1 = s2 = 0.0
        for i in range(j, width):
            s0 += factor[j, i] * owed[0, i]
            s1 += factor[j, i] * owed[1, i]
            s2 += factor[j, i] * owed[2, i]
        common[0] += s0 * s0
        common[1] += s0 * s1
        common[2] += s0 * s2
        common[3] += s1 * s1
        common[4] += s1 * s2
        common[5] += s2 * s2
