"""One filter there and back: the modified Bryson-Frazier smoother (Bierman 1973), with the ripple beside it.

There, a filter to which the ripple is known goes in lane CHAIN of `filters`; each step leaves the state x behind, the
factor L of its covariance P = L L', the gain and the innovation. Back goes the adjoint a, of covariance A: all readings
considered the state is x - P a. Its covariance is L (I + L' M L)^-1 L', positive by its form, with M what the later
readings tell by themselves (Fraser and Potter 1969). What a state owes to the ripple goes both ways along with it (see
`ripple`).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.bank import WIDE, stand_at
from textile_twin_core.shaft.clock import add_spread, set_second, shaft_state, wave
from textile_twin_core.shaft.kinematics import HALF_JERK, LAST_JERK, correct, move_on
from textile_twin_core.shaft.mixture import owe
from textile_twin_core.shaft.ripple import absorb, along, feel, set_sensitivity
from textile_twin_core.shaft.status import Record

FAR: Final = 49.0
"""Square of how far a reading is off, over its variance, from which it and the motion do not belong together."""
STEP: Final = np.dtype(
    [
        ("clock", np.float64, (9,)),
        ("gain", np.float64, (2,)),
        ("surprise", np.float64),
        ("trust", np.float64),
        ("own_trust", np.float64),
        ("keep", np.float64),
        ("felt", np.float64, (lanes.WIDEST,)),
        ("sensitivity", np.float64, (3, lanes.WIDEST)),
    ]
)
"""What a step leaves behind. After its reading: state and factor of the clock, gain; innovation over its variance, the
inverse of this and of the reading's own, 0 where there was none; what is kept of the angle; how much the innovation
felt of the ripple, and the state's sensitivity to it."""
BACK: Final = np.dtype(
    [
        ("adjoint", np.float64, (3,)),
        ("certainty", np.float64, (3, 3)),
        ("information", np.float64, (3, 3)),
        ("felt", np.float64, (3, lanes.WIDEST)),
        ("factor", np.float64, (3, 3)),
        ("root", np.float64, (3, 3)),
        ("room", np.float64, (3, 3)),
    ]
)
"""On the way back: a, A, M, how much a feels of the ripple; and room to work in."""


@compiled
def know_ripple(filters: Record, status: Record, lane: int) -> None:
    """Let the chain know its family's ripple as it stands in a lane of the filter's; its state follows the change."""
    family, change, root = filters.lead, filters.change, math.sqrt(status.scale[lane])
    width = 2 * lanes.WAVES[family]
    for i in range(width):
        change[i] = status.ripple[lane, i] - filters.ripple[lanes.CHAIN, i]
        filters.ripple[lanes.CHAIN, i] = status.ripple[lane, i]
        for j in range(i + 1):
            filters.factor[lanes.CHAIN, j, i] = status.factor[lane, j, i] * root
    set_second(filters.ripple[lanes.CHAIN], lanes.WAVES[family], filters.lowest, filters.second[family])
    for row in range(3):
        filters.clock[row, lanes.CHAIN] += along(filters.sensitivity[lanes.CHAIN, row], change, width)


@compiled
def wave_at(filters: Record, theta: float) -> tuple[float, float, float, float]:
    """The chain's g at an angle, what a reading of the shaft lacks of its clock, and its derivatives."""
    ripple, second, waves = filters.ripple[lanes.CHAIN], filters.second[filters.lead], lanes.WAVES[filters.lead]
    stand_at(filters, theta, waves)
    return wave(ripple, second, waves, filters.lowest, filters.basis)


@compiled
def stand(filters: Record) -> None:
    """Put the chain where the shaft is: `filters.start` (9,), its state and the factor of its covariance."""
    m, start, clock, width = lanes.CHAIN, filters.start, filters.clock, 2 * lanes.WAVES[filters.lead]
    omega, alpha, g = start[lanes.RATE], start[lanes.ACCELERATION], wave_at(filters, start[lanes.ANGLE])
    for row in range(9):
        clock[row, m] = start[row]
    clock[lanes.ANGLE, m] += g[0]
    clock[lanes.RATE, m] = omega * (1.0 + g[1])
    clock[lanes.ACCELERATION, m] = alpha * (1.0 + g[1]) + omega * omega * g[2]
    set_sensitivity(filters.sensitivity[m], filters.basis, filters.lowest, omega, width)


@compiled
def stand_on(filters: Record, row: Record) -> None:
    """Put the chain where the filter told that the shaft was at a row."""
    start, by = filters.start, row.covariance
    start[lanes.ANGLE], start[lanes.RATE], start[lanes.ACCELERATION] = row.theta, row.speed, row.acceleration
    start[lanes.L00] = math.sqrt(by[8])
    start[lanes.L10], start[lanes.L20] = by[5] / start[lanes.L00], by[2] / start[lanes.L00]
    start[lanes.L11] = math.sqrt(max(by[4] - start[lanes.L10] ** 2, 1e-9 * by[4]))
    start[lanes.L21] = (by[1] - start[lanes.L10] * start[lanes.L20]) / start[lanes.L11]
    start[lanes.L22] = math.sqrt(max(by[0] - start[lanes.L20] ** 2 - start[lanes.L21] ** 2, 1e-9 * by[0]))
    stand(filters)


@compiled
def write_down(filters: Record, at: Record) -> None:
    """Write down where the chain stands."""
    for row in range(9):
        at.clock[row] = filters.clock[row, lanes.CHAIN]
    for row in range(3):
        for i in range(2 * lanes.WAVES[filters.lead]):
            at.sensitivity[row, i] = filters.sensitivity[lanes.CHAIN, row, i]


@compiled
def stand_as(filters: Record, at: Record) -> None:
    """Put the chain where it stood when that was written down."""
    for row in range(9):
        filters.clock[row, lanes.CHAIN] = at.clock[row]
    for row in range(3):
        for i in range(2 * lanes.WAVES[filters.lead]):
            filters.sensitivity[lanes.CHAIN, row, i] = at.sensitivity[row, i]


@compiled
def step_there(filters: Record, at: Record, row: Record, intensity: float, owing: bool) -> None:
    """Move on and take a row's reading of the clock; `owing`: with what the state owes to the ripple."""
    m, clock, seen, gain, width = lanes.CHAIN, filters.clock, filters.seen, filters.gain, 2 * lanes.WAVES[filters.lead]
    move_on(filters, math.sqrt(intensity * row.step), row.step, m, m + 1)
    if owing:
        stand_at(filters, row.theta, lanes.WAVES[filters.lead])
        feel(filters.sensitivity[m], row.step, lanes.ANGLE, filters.basis, at.felt, width)
    at.surprise = at.trust = at.own_trust = at.gain[0] = at.gain[1] = 0.0
    at.keep = 1.0
    if row.noise > 0.0:
        off = row.clock - clock[lanes.ANGLE, m]
        seen[0, m], seen[1, m], seen[2, m] = clock[lanes.L20, m], clock[lanes.L21, m], clock[lanes.L22, m]
        spread = clock[lanes.L20, m] ** 2 + clock[lanes.L21, m] ** 2 + clock[lanes.L22, m] ** 2
        filters.innovation[m] = off
        filters.own_noise[m] = max(row.noise, off * off / WIDE - spread)
        correct(filters, m, m + 1)
        at.gain[0], at.gain[1] = gain[0, m], gain[1, m]
        at.trust = 1.0 / (filters.own_noise[m] + spread)
        at.own_trust = 1.0 / filters.own_noise[m]
        at.keep, at.surprise = filters.own_noise[m] * at.trust, off * at.trust
        if owing:
            absorb(filters.sensitivity[m], at.felt, gain[0, m], gain[1, m], gain[2, m], width)
    if owing:
        write_down(filters, at)


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
    back: Record, at: Record, step: float, intensity: float, jerk: FloatArray, width: int, owing: bool
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
    jerk[1] = max(unit * _jerk(step, x[0, 0], x[0, 1], x[0, 2], x[1, 1], x[1, 2], x[2, 2]), 0.0)
    a[0] += step * a[1] + half * a[2]
    a[1] += step * a[2]
    _undo_motion(x, step)
    if owing:
        _inform(back.information, at.own_trust, step, math.sqrt(unit))
    for w in range(width if owing else 0):
        f0, f1, f2 = felt[0, w], felt[1, w], felt[2, w]
        f2 = at.keep * f2 - k0 * f0 - k1 * f1 - at.trust * at.felt[w]
        felt[0, w], felt[1, w], felt[2, w] = f0 + step * f1 + half * f2, f1 + step * f2, f2


@compiled
def _undo_motion(x: FloatArray, step: float) -> None:
    """F' X F, with F the motion over a step."""
    half = 0.5 * step * step
    for j in range(3):
        x[0, j] += step * x[1, j] + half * x[2, j]
        x[1, j] += step * x[2, j]
    for i in range(3):
        x[i, 0] += step * x[i, 1] + half * x[i, 2]
        x[i, 1] += step * x[i, 2]


@compiled
def _inform(x: FloatArray, trust: float, step: float, root: float) -> None:
    """Take M to before a reading, and to before the white jerk of a step, a column of its factor after the other."""
    x[2, 2] += trust
    for column in range(3):
        b0 = root if column == 0 else 0.0
        b1 = root * step * (0.5 if column == 0 else HALF_JERK if column == 1 else 0.0)
        b2 = root * step * step * (1.0 / 6.0 if column == 0 else 0.5 * HALF_JERK if column == 1 else LAST_JERK)
        v0 = x[0, 0] * b0 + x[0, 1] * b1 + x[0, 2] * b2
        v1 = x[1, 0] * b0 + x[1, 1] * b1 + x[1, 2] * b2
        v2 = x[2, 0] * b0 + x[2, 1] * b1 + x[2, 2] * b2
        part = 1.0 / (1.0 + b0 * v0 + b1 * v1 + b2 * v2)
        for i in range(3):
            left = part * (v0 if i == 0 else v1 if i == 1 else v2)
            x[i, 0] -= left * v0
            x[i, 1] -= left * v1
            x[i, 2] -= left * v2
    _undo_motion(x, step)


@compiled
def _jerk(h: float, x00: float, x01: float, x02: float, x11: float, x12: float, x22: float) -> float:
    """Trace of a symmetric matrix times white jerk's covariance over a step h, of unit intensity and over h."""
    return x00 + h * (x01 + h * ((x02 + x11) / 3.0 + h * (0.25 * x12 + 0.05 * h * x22)))


@compiled
def tell(filters: Record, back: Record, at: Record, row: Record) -> None:
    """Angle (as `phase`), speed, acceleration and covariance after a step, all readings considered."""
    a, felt, waves, owed = back.adjoint, back.felt, lanes.WAVES[filters.lead], filters.sensitivity[lanes.CHAIN]
    g, clock, factor, spread = wave_at(filters, row.theta), at.clock, back.factor, filters.common_part
    factor[0, 0], factor[1, 0], factor[2, 0] = clock[lanes.L00], clock[lanes.L10], clock[lanes.L20]
    factor[1, 1], factor[2, 1], factor[2, 2] = clock[lanes.L11], clock[lanes.L21], clock[lanes.L22]
    x0, x1, x2 = _corrected(factor, a[0], a[1], a[2], clock)
    row.phase, row.speed, row.acceleration = shaft_state(x2, x1, x0, row.theta, g, filters.slopes)
    for w in range(2 * waves):
        owed[0, w], owed[1, w], owed[2, w] = _corrected(
            factor, felt[0, w], felt[1, w], felt[2, w], at.sensitivity[:, w]
        )
    owe(filters, waves, owed, filters.factor[lanes.CHAIN])
    _set_columns(factor, back.information, back.root, back.room)
    for j in range(3):
        add_spread(back.room[2, j], back.room[1, j], back.room[0, j], filters.slopes, 1.0, spread)
    place = 0
    for p in range(3):
        for q in range(p, 3):
            row.covariance[3 * p + q] = row.covariance[3 * q + p] = spread[place]
            place += 1


@compiled
def _corrected(factor: FloatArray, a0: float, a1: float, a2: float, x: FloatArray) -> tuple[float, float, float]:
    """x - L L' a."""
    s0 = factor[0, 0] * a0 + factor[1, 0] * a1 + factor[2, 0] * a2
    s1, s2 = factor[1, 1] * a1 + factor[2, 1] * a2, factor[2, 2] * a2
    x2 = x[2] - factor[2, 0] * s0 - factor[2, 1] * s1 - factor[2, 2] * s2
    return x[0] - factor[0, 0] * s0, x[1] - factor[1, 0] * s0 - factor[1, 1] * s1, x2


@compiled
def _set_columns(factor: FloatArray, information: FloatArray, root: FloatArray, columns: FloatArray) -> None:
    """L R^-T, with R R' = I + L' M L (Cholesky): a factor of the smoothed covariance."""
    for i in range(3):
        for j in range(3):
            columns[i, j] = 0.0
            for k in range(j, 3):
                columns[i, j] += information[i, k] * factor[k, j]
    for j in range(3):
        for i in range(j, 3):
            root[i, j] = 1.0 if i == j else 0.0
            for k in range(i, 3):
                root[i, j] += factor[k, i] * columns[k, j]
            for k in range(j):
                root[i, j] -= root[i, k] * root[j, k]
        root[j, j] = math.sqrt(max(root[j, j], 1.0))
        for i in range(j + 1, 3):
            root[i, j] /= root[j, j]
    for i in range(3):
        for j in range(3):
            columns[i, j] = factor[i, j] if j <= i else 0.0
            for k in range(j):
                columns[i, j] -= root[j, k] * columns[i, k]
            columns[i, j] /= root[j, j]
