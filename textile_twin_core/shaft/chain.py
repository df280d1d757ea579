"""The chain, one filter that smooths, on its way there: each step leaves behind what the way back needs.

There, a filter to which the ripple is known goes in lane CHAIN of `filters`; each step leaves gain and innovation
behind, and where states are told of it the state x and the factor L of its covariance P = L L', for the modified
Bryson-Frazier smoother (Bierman 1973) of `way_back`. What a state owes to the ripple goes both ways along with it (see
`ripple`).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from textile_twin_core.compiling import compiled
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.bank import stand_at
from textile_twin_core.shaft.clock import set_second, wave
from textile_twin_core.shaft.kinematics import WIDE, correct, move_on
from textile_twin_core.shaft.ripple import absorb, along, feel, set_sensitivity
from textile_twin_core.shaft.status import Record

STEP: Final = np.dtype(
    [
        ("gain", np.float64, (2,)),
        ("surprise", np.float64),
        ("trust", np.float64),
        ("own_trust", np.float64),
        ("keep", np.float64),
    ]
)
"""What a step leaves behind: gain; innovation over its variance, the inverse of this and of the reading's own, 0 where
there was none; what is kept of the angle."""
STAND: Final = np.dtype(
    [
        ("clock", np.float64, (9,)),
        ("felt", np.float64, (lanes.WIDEST,)),
        ("sensitivity", np.float64, (3, lanes.WIDEST)),
    ]
)
"""Where the chain stands after a step: state and factor of the clock; how much the innovation felt of the ripple, and
the state's sensitivity to it."""


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
    set_second(filters.ripple[lanes.CHAIN], lanes.WAVES[family], filters.lowest, filters.second[family], change)
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
def write_down(filters: Record, stand: Record) -> None:
    """Write down where the chain stands."""
    for row in range(9):
        stand.clock[row] = filters.clock[row, lanes.CHAIN]
    for row in range(3):
        for i in range(2 * lanes.WAVES[filters.lead]):
            stand.sensitivity[row, i] = filters.sensitivity[lanes.CHAIN, row, i]


@compiled
def stand_as(filters: Record, stand: Record) -> None:
    """Put the chain where it stood when that was written down."""
    for row in range(9):
        filters.clock[row, lanes.CHAIN] = stand.clock[row]
    for row in range(3):
        for i in range(2 * lanes.WAVES[filters.lead]):
            filters.sensitivity[lanes.CHAIN, row, i] = stand.sensitivity[row, i]


@compiled
def step_there(filters: Record, at: Record, stand: Record, row: Record, intensity: float, owing: bool) -> None:
    """Move on and take a row's reading of the clock; `owing`: with what the state owes to the ripple."""
    m, clock, seen, gain, width = lanes.CHAIN, filters.clock, filters.seen, filters.gain, 2 * lanes.WAVES[filters.lead]
    move_on(filters, math.sqrt(intensity * row.step), row.step, m, m + 1)
    if owing:
        stand_at(filters, row.theta, lanes.WAVES[filters.lead])
        feel(filters.sensitivity[m], row.step, filters.basis, stand.felt, width)
    at.surprise = at.trust = at.own_trust = at.gain[0] = at.gain[1] = 0.0
    at.keep = 1.0
    if row.noise > 0.0:
        off = row.clock - clock[lanes.ANGLE, m]
        seen[0, m], seen[1, m], seen[2, m] = clock[lanes.L20, m], clock[lanes.L21, m], clock[lanes.L22, m]
        spread = clock[lanes.L20, m] ** 2 + clock[lanes.L21, m] ** 2 + clock[lanes.L22, m] ** 2
        filters.innovation[m] = off
        known = (row.reading - row.theta) ** 2 <= WIDE * row.noise
        filters.own_noise[m] = row.noise if known else max(row.noise, off * off / WIDE - spread)
        correct(filters, m, m + 1)
        at.gain[0], at.gain[1] = gain[0, m], gain[1, m]
        at.trust = 1.0 / (filters.own_noise[m] + spread)
        at.own_trust = 1.0 / filters.own_noise[m]
        at.keep, at.surprise = filters.own_noise[m] * at.trust, off * at.trust
        if owing:
            absorb(filters.sensitivity[m], stand.felt, gain[0, m], gain[1, m], gain[2, m], width)
    if owing:
        write_down(filters, stand)
