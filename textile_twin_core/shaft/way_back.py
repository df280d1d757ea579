"""The way back of the chain: the adjoint, and what it makes of each state.

Back goes the adjoint a, of covariance A: all readings considered the state is x - P a (Bierman 1973). Its covariance is
(P^-1 + M)^-1, with M what the later readings tell by themselves (Fraser and Potter 1969). M goes back as its triangular
factor: a long rest tells the angle so much better than the rates that M itself would lose these to rounding.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.chain import wave_at
from textile_twin_core.shaft.clock import add_spread, shaft_state
from textile_twin_core.shaft.kinematics import HALF_JERK, LAST_JERK
from textile_twin_core.shaft.lacked_orders import add_again
from textile_twin_core.shaft.mixture import owe
from textile_twin_core.shaft.status import Record

BACK: Final = np.dtype(
    [
        ("adjoint", np.float64, (3,)),
        ("certainty", np.float64, (3, 3)),
        ("information", np.float64, (3, 3)),
        ("felt", np.float64, (3, lanes.WIDEST)),
        ("factor", np.float64, (3, 3)),
        ("direction", np.float64, (3,)),
        ("room", np.float64, (3, 3)),
    ]
)
"""On the way back: a, A, the lower triangular factor of M in the order angle, rate, acceleration, how much a feels of
the ripple; and room to work in."""


@compiled
def turn_round(back: Record) -> None:
    """Begin the way back: at the last step the filter knows all."""
    for i in range(3):
        back.adjoint[i] = 0.0
        for w in range(lanes.WIDEST):
            back.felt[i, w] = 0.0
        for j in range(3):
            back.certainty[i, j] = back.information[i, j] = 0.0


@compiled
def step_back(
    back: Record, at: Record, stand: Record, step: float, intensity: float, jerk: FloatArray, width: int, owing: bool
) -> None:
    """From after the reading of a step to after that of the step before; `owing`: with what states are told from.

    `jerk` (2,) becomes what the step's white jerk, of unit variance beforehand, turned out to be: its mean squared, and
    how much of its variance the readings took away (of 3 degrees of freedom both).
    """
    a, x, felt, k0, k1 = back.adjoint, back.certainty, back.felt, at.gain[0], at.gain[1]
    a[2] = at.keep * a[2] - k0 * a[0] - k1 * a[1] - at.surprise
    for i in range(3):
        x[i, 2] = at.keep * x[i, 2] - k0 * x[i, 0] - k1 * x[i, 1]
    for j in range(2):
        x[2, j] = x[j, 2]
    x[2, 2] = at.keep * x[2, 2] - k0 * x[0, 2] - k1 * x[1, 2] + at.trust
    unit, half = intensity * step, 0.5 * step * step
    jerk[0] = unit * _jerk(step, a[0] * a[0], a[0] * a[1], a[0] * a[2], a[1] * a[1], a[1] * a[2], a[2] * a[2])
    jerk[1] = min(max(unit * _jerk(step, x[0, 0], x[0, 1], x[0, 2], x[1, 1], x[1, 2], x[2, 2]), 0.0), 3.0)
    a[0] += step * a[1] + half * a[2]
    a[1] += step * a[2]
    _undo_motion(x, step)
    if owing:
        _inform(back, math.sqrt(at.own_trust), step, math.sqrt(unit))
    for w in range(width if owing else 0):
        f0, f1, f2 = felt[0, w], felt[1, w], felt[2, w]
        f2 = at.keep * f2 - k0 * f0 - k1 * f1 - at.trust * stand.felt[w]
        felt[0, w], felt[1, w], felt[2, w] = f0 + step * f1 + half * f2, f1 + step * f2, f2


@compiled
def _undo_motion(x: FloatArray, step: float) -> None:
    """F' X F, with F the motion over a step, and alike on both sides: what differs would not fade."""
    half = 0.5 * step * step
    for j in range(3):
        x[0, j] += step * x[1, j] + half * x[2, j]
        x[1, j] += step * x[2, j]
    for i in range(3):
        x[i, 0] += step * x[i, 1] + half * x[i, 2]
        x[i, 1] += step * x[i, 2]
    x[1, 0], x[2, 0], x[2, 1] = x[0, 1], x[0, 2], x[1, 2]


@compiled
def _inform(back: Record, root_trust: float, step: float, root: float) -> None:
    """Take M to before a reading, and to before the white jerk of a step, a column of its factor after the other."""
    m, b = back.information, back.direction
    b[0], b[1], b[2] = root_trust, 0.0, 0.0
    for column in range(3):
        length = math.hypot(m[column, column], b[column])
        if length > 0.0:
            c, s = m[column, column] / length, b[column] / length
            for i in range(column, 3):
                old = m[i, column]
                m[i, column], b[i] = c * old + s * b[i], c * b[i] - s * old
    for column in range(3):
        b[0] = root * step * step * (1.0 / 6.0 if column == 0 else 0.5 * HALF_JERK if column == 1 else LAST_JERK)
        b[1] = root * step * (0.5 if column == 0 else HALF_JERK if column == 1 else 0.0)
        b[2] = root if column == 0 else 0.0
        _correct(m, b, back.room)
    half = 0.5 * step * step
    for column in range(3):
        m[2, column] += step * m[1, column] + half * m[0, column]
        m[1, column] += step * m[0, column]


@compiled
def _correct(factor: FloatArray, seen: FloatArray, room: FloatArray) -> None:
    """(S^-1 + d d')^-1 for S of a lower triangular factor and a direction d, `seen` (3,) (Carlson 1973)."""
    total, change = 1.0, room[0]
    change[:] = 0.0
    for back in range(3):
        j = 2 - back
        p = 0.0
        for i in range(j, 3):
            p += factor[i, j] * seen[i]
        before, total = total, total + p * p
        part = 1.0 / math.sqrt(before * total)
        for i in range(j, 3):
            old = factor[i, j]
            factor[i, j] = part * (before * old - p * change[i])
            change[i] += p * old


@compiled
def _jerk(h: float, x00: float, x01: float, x02: float, x11: float, x12: float, x22: float) -> float:
    """Trace of a symmetric matrix times white jerk's covariance over a step h, of unit intensity and over h."""
    return x00 + h * (x01 + h * ((x02 + x11) / 3.0 + h * (0.25 * x12 + 0.05 * h * x22)))


@compiled
def tell(filters: Record, back: Record, stand: Record, row: Record) -> None:
    """Angle (as `phase`), speed, acceleration and covariance after a step, all readings considered."""
    a, felt, waves, owed = back.adjoint, back.felt, lanes.WAVES[filters.lead], filters.sensitivity[lanes.CHAIN]
    g, clock, factor, spread = wave_at(filters, row.theta), stand.clock, back.factor, filters.common_part
    factor[0, 0], factor[1, 0], factor[2, 0] = clock[lanes.L00], clock[lanes.L10], clock[lanes.L20]
    factor[1, 1], factor[2, 1], factor[2, 2] = clock[lanes.L11], clock[lanes.L21], clock[lanes.L22]
    x0, x1, x2 = _corrected(factor, a[0], a[1], a[2], clock)
    row.phase, row.speed, row.acceleration = shaft_state(x2, x1, x0, row.theta, g, filters.slopes)
    for w in range(2 * waves):
        owed[0, w], owed[1, w], owed[2, w] = _corrected(
            factor, felt[0, w], felt[1, w], felt[2, w], stand.sensitivity[:, w]
        )
    owe(filters, waves, owed, filters.factor[lanes.CHAIN])
    for j in range(3):
        for i in range(3):
            back.direction[i] = back.information[2 - i, j]
        _correct(factor, back.direction, back.room)
    for j in range(3):
        add_spread(factor[2, j], factor[1, j], factor[0, j], filters.slopes, 1.0, spread)
    place = 0
    for p in range(3):
        for q in range(p, 3):
            row.covariance[3 * p + q] = row.covariance[3 * q + p] = spread[place]
            place += 1
    add_again(row)


@compiled
def _corrected(factor: FloatArray, a0: float, a1: float, a2: float, x: FloatArray) -> tuple[float, float, float]:
    """x - L L' a."""
    s0 = factor[0, 0] * a0 + factor[1, 0] * a1 + factor[2, 0] * a2
    s1, s2 = factor[1, 1] * a1 + factor[2, 1] * a2, factor[2, 2] * a2
    x2 = x[2] - factor[2, 0] * s0 - factor[2, 1] * s1 - factor[2, 2] * s2
    return x[0] - factor[0, 0] * s0, x[1] - factor[1, 0] * s0 - factor[1, 1] * s1, x2
