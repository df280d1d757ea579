"""Equation of motion of a free chain between instants at which something changes at once: compiled slopes and monitors.

State y of n stations, reduced to the main shaft: angle of the first station, twists of the pieces (n - 1), speeds (n),
then work of the drive, of the loads and of damping. `FreeModes` has the discontinuous states: which stretch of its
loads each hanger is in, the direction of each station or whether dry friction holds it, and on which side of its play a
piece is.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.compiling import by_reference, compiled
from textile_twin_core.driveline.chain import ShaftChain
from textile_twin_core.driveline.step import TURN, function, place

WORKS = 3
"""Entries behind the speeds: work of drive, loads and damping."""


@by_reference
class FreeModes(NamedTuple):
    """Discontinuous states, with work arrays for them and for intermediate results."""

    turning: IntArray
    """(stations,) 1 forward, -1 backward, 0 held by dry friction"""
    row: IntArray
    """(hangers,) entry of the chain's `coefficients` that holds"""
    low: FloatArray
    """(hangers,) crank angle at which its stretch begins [rad]"""
    high: FloatArray
    """(hangers,) crank angle at which its stretch ends [rad]"""
    side: IntArray
    """(pieces,) 1 and -1 in contact, 0 within the play; 1 without play"""
    mass: FloatArray
    """(stations,) inertia [kg m^2]"""
    net: FloatArray
    """(stations,) torque that accelerates the station [N m]"""


def free_modes(chain: ShaftChain) -> FreeModes:
    """Room for the modes of a chain."""
    stations, hangers = chain.inertia.size, chain.phase.size
    return FreeModes(
        np.zeros(stations, dtype=np.int64),
        np.zeros(hangers, dtype=np.int64),
        np.zeros(hangers),
        np.zeros(hangers),
        np.zeros(stations - 1, dtype=np.int64),
        np.zeros(stations),
        np.zeros(stations),
    )


@compiled
def find_stretch(chain: ShaftChain, modes: FreeModes, k: int, angle: float, sense: int) -> None:
    """Set the stretch of a hanger at a crank angle, turning forward (sense 1) or backward (-1)."""
    direction, profile = (0 if sense >= 0 else 1), chain.profile[k]
    first, last = chain.start_begin[direction, profile], chain.start_begin[direction, profile + 1]
    row = stretch_at(chain, profile, angle, sense)
    modes.row[k], modes.low[k], modes.high[k] = row, -math.inf, math.inf
    if last - first < 2:
        return
    low = chain.starts[row]
    low += TURN * math.floor((angle - low) / TURN + 0.5 * nearly(angle, sense))
    after = chain.starts[row + 1] if row + 1 < last else chain.starts[first] + TURN
    modes.low[k], modes.high[k] = low, low + after - chain.starts[row]


@compiled
def nearly(angle: float, sense: int) -> float:
    """Rounding of an angle, in its direction of rotation [rad]."""
    near = 1e-13 + 1e-15 * abs(angle)
    return near if sense >= 0 else -near


@compiled
def stretch_at(chain: ShaftChain, profile: int, angle: float, sense: int) -> int:
    """Entry of `coefficients` that holds at a crank angle, turning forward (sense 1) or backward (-1)."""
    direction = 0 if sense >= 0 else 1
    first, last = chain.start_begin[direction, profile], chain.start_begin[direction, profile + 1]
    at = angle - TURN * math.floor(angle / TURN) + nearly(angle, sense)
    j = first
    while j < last and chain.starts[j] <= at:
        j += 1
    return j - 1 if j > first else last - 1


@compiled
def net_torque(chain: ShaftChain, modes: FreeModes, i: int, angle: float, omega: float) -> tuple[float, float, float]:
    """Inertia of a station, torque on it from its hanger, and the loads' part of that."""
    mass, torque, loads = chain.inertia[i], 0.0, 0.0
    for k in range(chain.first[i], chain.first[i + 1]):
        profile = chain.profile[k]
        row, u = place(chain, profile, angle + chain.phase[k])
        mass += function(chain, row, 0, u)
        torque -= function(chain, row, 1, u) * omega * omega + function(chain, row, 2, u)
        held = modes.row[k]
        for j in range(chain.coefficients.shape[1]):
            c = chain.coefficients[held, j]
            if c != 0.0:
                power = chain.powers[profile, j]
                loads += (
                    c * function(chain, row, 3 + j, u) * (1.0 if power == 0 else omega if power == 1 else omega * omega)
                )
    return mass, torque + loads, loads


@compiled
def friction(chain: ShaftChain, i: int, angle: float) -> float:
    """Increase of the forward load of a standing station if it turned backward [N m]."""
    more = 0.0
    for k in range(chain.first[i], chain.first[i + 1]):
        profile, at = chain.profile[k], angle + chain.phase[k]
        row, u = place(chain, profile, at)
        forward, backward = stretch_at(chain, profile, at, 1), stretch_at(chain, profile, at, -1)
        for j in range(chain.coefficients.shape[1]):
            if chain.powers[profile, j] == 0:
                apart = chain.coefficients[backward, j] - chain.coefficients[forward, j]
                more += apart * function(chain, row, 3 + j, u)
    return more


@compiled
def free_slopes(
    chain: ShaftChain, modes: FreeModes, y: FloatArray, drive: int, torque: float, slope: FloatArray
) -> None:
    """Derivative of the state under a torque at the drive's station, reduced to the main shaft [N m]."""
    n = chain.inertia.size
    angle, worked, damped, before = y[0], 0.0, 0.0, 0.0
    for i in range(n):
        omega = y[n + i]
        mass, net, loads = net_torque(chain, modes, i, angle, omega)
        net += before - chain.viscous[i] * omega
        worked += loads * omega
        damped -= chain.viscous[i] * omega * omega
        if i == drive:
            net += torque
        if i < n - 1:
            twist, rate = y[1 + i], omega - y[n + i + 1]
            side = modes.side[i]
            before = 0.0
            if side != 0:
                before = chain.stiffness[i] * (twist - side * chain.half_play[i]) + chain.damping[i] * rate
                damped -= chain.damping[i] * rate * rate
            net -= before
            slope[1 + i] = rate
            angle -= twist
        modes.mass[i], modes.net[i] = mass, net
        slope[n + i] = net / mass if modes.turning[i] != 0 else 0.0
    slope[0] = y[n]
    slope[2 * n] = torque * y[n + drive]
    slope[2 * n + 1], slope[2 * n + 2] = worked, damped


@compiled
def monitors(
    chain: ShaftChain, modes: FreeModes, y: FloatArray, drive: int, torque: float, slope: FloatArray, out: FloatArray
) -> None:
    """Write monitors that are positive until a discontinuity.

    out: (stations + 2 hangers + 2 pieces,) per station its speed in its direction, or the reserve of dry friction;
    per hanger its distances from the ends of its stretch; per piece those from the ends of its side of the play.
    """
    n, hangers = chain.inertia.size, chain.phase.size
    free_slopes(chain, modes, y, drive, torque, slope)
    angle = y[0]
    for i in range(n):
        if modes.turning[i] != 0:
            out[i] = modes.turning[i] * y[n + i]
        else:
            ahead = modes.net[i]  # of the stretches forward, to which a stopped station is set
            out[i] = min(-ahead, ahead + friction(chain, i, angle))
        for k in range(chain.first[i], chain.first[i + 1]):
            at = angle + chain.phase[k]
            out[n + 2 * k], out[n + 2 * k + 1] = at - modes.low[k], modes.high[k] - at
        if i < n - 1:
            twist, play = y[1 + i], chain.half_play[i]
            p = n + 2 * hangers + 2 * i
            out[p], out[p + 1] = math.inf, math.inf
            if play > 0.0:
                if modes.side[i] == 0:
                    out[p], out[p + 1] = twist + play, play - twist
                else:
                    out[p] = modes.side[i] * twist - play
            angle -= twist


@compiled
def first_modes(
    chain: ShaftChain, modes: FreeModes, y: FloatArray, drive: int, torque: float, slope: FloatArray
) -> None:
    """Set all modes from the state alone."""
    n = chain.inertia.size
    for i in range(n - 1):
        twist, play = y[1 + i], chain.half_play[i]
        modes.side[i] = 1 if play == 0.0 or twist > play else -1 if twist < -play else 0
    for i in range(n):
        start_station(chain, modes, y, i, 1 if y[n + i] > 0.0 else -1 if y[n + i] < 0.0 else 0)
    free_slopes(chain, modes, y, drive, torque, slope)
    for i in range(n):
        if y[n + i] == 0.0:
            release(chain, modes, y, i, False)


@compiled
def start_station(chain: ShaftChain, modes: FreeModes, y: FloatArray, i: int, turning: int) -> None:
    """Let a station turn in a direction, or stop it (0)."""
    angle = y[0]
    for j in range(i):
        angle -= y[1 + j]
    modes.turning[i] = turning
    for k in range(chain.first[i], chain.first[i + 1]):
        find_stretch(chain, modes, k, angle + chain.phase[k], turning)


@compiled
def release(chain: ShaftChain, modes: FreeModes, y: FloatArray, i: int, surely: bool) -> None:
    """Let a station that stands, and whose net torque was just computed forward, start or be stopped by dry friction.

    surely: it starts, towards the side where the reserve of friction is smaller, because the torque passes it now.
    """
    angle = y[0]
    for j in range(i):
        angle -= y[1 + j]
    ahead, behind = modes.net[i], -(modes.net[i] + friction(chain, i, angle))
    if ahead > 0.0 or (surely and ahead >= behind):
        modes.turning[i] = 1
    elif behind > 0.0 or surely:
        start_station(chain, modes, y, i, -1)
    else:
        modes.turning[i] = 0


@compiled
def change(
    chain: ShaftChain, modes: FreeModes, y: FloatArray, drive: int, torque: float, slope: FloatArray, which: int
) -> None:
    """Let the change of one monitor happen; the state is on it."""
    n, hangers = chain.inertia.size, chain.phase.size
    if which < n:
        held = modes.turning[which] == 0
        y[n + which] = 0.0
        start_station(chain, modes, y, which, 0)
        free_slopes(chain, modes, y, drive, torque, slope)
        release(chain, modes, y, which, held)
    elif which < n + 2 * hangers:
        k, forward = (which - n) // 2, (which - n) % 2 == 1
        step_stretch(chain, modes, k, forward)
    else:
        i, upper = (which - n - 2 * hangers) // 2, (which - n - 2 * hangers) % 2 == 1
        modes.side[i] = 0 if modes.side[i] != 0 else 1 if upper else -1


@compiled
def step_stretch(chain: ShaftChain, modes: FreeModes, k: int, forward: bool) -> None:
    """Move a hanger to the next stretch of its direction."""
    profile = chain.profile[k]
    direction = 0 if modes.row[k] < chain.start_begin[1, 0] else 1
    first, last = chain.start_begin[direction, profile], chain.start_begin[direction, profile + 1]
    row = modes.row[k]
    if forward:
        row = row + 1 if row + 1 < last else first
        after = row + 1 if row + 1 < last else first
        modes.low[k] = modes.high[k]
        gap = chain.starts[after] - chain.starts[row]
        modes.high[k] += gap if gap > 0.0 else gap + TURN
    else:
        gap = chain.starts[row] - chain.starts[row - 1 if row > first else last - 1]
        row = row - 1 if row > first else last - 1
        modes.high[k] = modes.low[k]
        modes.low[k] -= gap if gap > 0.0 else gap + TURN
    modes.row[k] = row


@compiled
def energies(chain: ShaftChain, y: FloatArray, angles: FloatArray) -> tuple[float, float]:
    """Kinetic and elastic energy [J]; the crank angle of each hanger goes into `angles`."""
    n = chain.inertia.size
    angle, kinetic, elastic = y[0], 0.0, 0.0
    for i in range(n):
        mass = chain.inertia[i]
        for k in range(chain.first[i], chain.first[i + 1]):
            angles[k] = angle + chain.phase[k]
            row, u = place(chain, chain.profile[k], angles[k])
            mass += function(chain, row, 0, u)
        kinetic += 0.5 * mass * y[n + i] ** 2
        if i < n - 1:
            reach = max(abs(y[1 + i]) - chain.half_play[i], 0.0)
            elastic += 0.5 * chain.stiffness[i] * reach * reach
            angle -= y[1 + i]
    return kinetic, elastic
