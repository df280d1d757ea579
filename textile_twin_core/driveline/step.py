"""One step of the chain by the linearly implicit midpoint rule, compiled.

Per station, with psi_i = theta_i - theta_0 relative to a reference motion theta_0 (so that small twists keep their
digits):

    (J(theta_i) + I_i) (psi_i'' + alpha_0) + J'/2 omega_i^2 + V' - load_i = torque_i + torques of the pieces beside i

Stiffness and damping of the pieces are implicit: one tridiagonal system for the accelerations over the step (Hairer and
Wanner 1996, Solving Ordinary Differential Equations II, IV.7). A load that steps within the time step counts with
the share of the time on each side; backlash counts with the mean torque over the time step.
"""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import by_reference, compiled_in_place
from textile_twin_core.driveline.chain import ShaftChain

TURN = 2.0 * math.pi
_TURNS = 1.0 / TURN


@by_reference
class ChainState(NamedTuple):
    """State of the stations relative to the reference motion, and room for the tridiagonal system."""

    psi: FloatArray
    """(stations,) angle beyond the reference [rad]"""
    speed: FloatArray
    """(stations,) speed beyond the reference's [rad/s]"""
    acceleration: FloatArray
    """(stations,) acceleration beyond the reference's, over the last step [rad/s^2]"""
    lower: FloatArray
    diagonal: FloatArray
    upper: FloatArray
    right: FloatArray
    load: FloatArray
    """(loads,) room for coefficients of load functions"""


def chain_state(chain: ShaftChain) -> ChainState:
    """A state at standstill relative to the reference motion."""
    count = chain.inertia.size
    psi, speed, acceleration, lower, diagonal, upper, right = np.zeros((7, count))
    load = np.zeros(chain.coefficients.shape[1])
    return ChainState(psi, speed, acceleration, lower, diagonal, upper, right, load)


@compiled_in_place
def midpoint_step(
    chain: ShaftChain,
    state: ChainState,
    theta: float,
    omega: float,
    alpha: float,
    h: float,
    fixed: int,
    torque: FloatArray,
) -> None:
    """Advance the state by a time h [s].

    theta, omega: the reference at the beginning of the step [rad, rad/s]; alpha: its acceleration over the step.
    fixed: the station that follows the reference, -1 for none. torque: (stations,) external torque over the step,
    reduced to the main shaft, positive along positive theta [N m].
    """
    n = chain.inertia.size
    psi, v, a = state.psi, state.speed, state.acceleration
    low, diagonal, up, right = state.lower, state.diagonal, state.upper, state.right
    half, quarter = 0.5 * h, 0.25 * h * h
    middle_theta, middle_omega = theta + half * omega + 0.125 * h * h * alpha, omega + half * alpha
    for i in range(n):
        w = middle_omega + v[i] + half * a[i]
        inertia, resisting, drag = mounted(
            chain,
            state.load,
            i,
            middle_theta + psi[i] + half * v[i] + quarter * a[i],
            theta + psi[i],
            w,
            h,
        )
        mass = chain.inertia[i] + inertia
        # viscous parts act at the speed in the middle of the step, which the unknown acceleration changes
        slip = chain.viscous[i] + drag
        diagonal[i] = mass + half * slip
        right[i] = torque[i] - mass * alpha - resisting - slip * (middle_omega + v[i]) + drag * w
        low[i], up[i] = 0.0, 0.0
    for i in range(n - 1):
        k, c = chain.stiffness[i], chain.damping[i]
        twist, rate = psi[i] - psi[i + 1], v[i] - v[i + 1]
        if chain.half_play[i] == 0.0:
            q = half * c + (0.25 - chain.lead[i]) * h * h * k
            held = k * (twist + half * rate) + c * rate
        else:
            change = half * (a[i] - a[i + 1])
            mean, slope, share = dead_band(twist, h * (rate + change), chain.half_play[i], k)
            q = half * c * share + 0.5 * h * h * slope
            held = mean + c * share * rate - slope * h * change
        right[i] -= held
        right[i + 1] += held
        diagonal[i] += q
        diagonal[i + 1] += q
        up[i] -= q
        low[i + 1] -= q
    if fixed >= 0:
        low[fixed], diagonal[fixed], up[fixed], right[fixed] = 0.0, 1.0, 0.0, 0.0
    inverse = 1.0 / diagonal[0]
    for i in range(1, n):
        up[i - 1] *= inverse
        right[i - 1] *= inverse
        inverse = 1.0 / (diagonal[i] - low[i] * up[i - 1])
        right[i] -= low[i] * right[i - 1]
    a[n - 1] = right[n - 1] * inverse
    for i in range(n - 2, -1, -1):
        a[i] = right[i] - up[i] * a[i + 1]
    for i in range(n):
        psi[i] += h * v[i] + 0.5 * h * h * a[i]
        v[i] += h * a[i]


@compiled_in_place
def dead_band(twist: float, change: float, half_play: float, stiffness: float) -> tuple[float, float, float]:
    """Mean torque of a piece with backlash while its twist goes from `twist` by `change` in a straight line.

    Returns the mean torque, its slope with the twist at the end, and the share of the travel in contact. The mean is
    the difference of the elastic energy over the travel, so the step gains no energy from the backlash.
    """
    end = twist + change
    reach, reach_end = beyond(twist, half_play), beyond(end, half_play)
    if reach * reach_end > 0.0:
        return 0.5 * stiffness * (reach + reach_end), 0.5 * stiffness, 1.0
    if abs(change) < 1e-15:
        return stiffness * reach, 0.0, 1.0 if reach != 0.0 else 0.0
    mean = 0.5 * stiffness * (reach_end * reach_end - reach * reach) / change
    slope = (stiffness * reach_end - mean) / change
    return mean, max(slope, 0.0), min((abs(reach) + abs(reach_end)) / abs(change), 1.0)


@partial(compiled_in_place, inlined=True)
def beyond(twist: float, half_play: float) -> float:
    """Twist beyond the dead band [rad]."""
    return twist - half_play if twist > half_play else twist + half_play if twist < -half_play else 0.0


@compiled_in_place
def mounted(
    chain: ShaftChain, load: FloatArray, station: int, angle: float, begin: float, omega: float, h: float
) -> tuple[float, float, float]:
    """Load of a station: inertia, resisting torque at the speed omega, and its slope over omega.

    angle: the station's in the middle of a step of h seconds that it begins at `begin` [rad]. Returns J [kg m^2],
    J'/2 omega^2 + V' - load [N m], and the viscous part of that per speed [N m s].
    """
    inertia, resisting, drag = 0.0, 0.0, 0.0
    for k in range(chain.first[station], chain.first[station + 1]):
        row, u = place(chain, chain.profile[k], angle + chain.phase[k])
        inertia += function(chain, row, 0, u)
        resisting += function(chain, row, 1, u) * omega * omega + function(chain, row, 2, u)
    if load.size == 0:
        return inertia, resisting, drag
    way = h * omega
    # near standstill both directions, blended in proportion to the speed: dry friction cannot overshoot
    mass, width = inertia + chain.inertia[station], chain.slow_rad_s
    if 0.5 * h * chain.friction_Nm > width * mass:
        width = 0.5 * h * chain.friction_Nm / mass if abs(omega) * mass < 0.5 * h * chain.friction_Nm else 0.0
    blended = abs(omega) < width
    for k in range(chain.first[station], chain.first[station + 1]):
        profile, phase = chain.profile[k], chain.phase[k]
        row, u = place(chain, profile, angle + phase)
        for direction in range(2):
            if not blended and (omega > 0.0) == (direction == 1):
                continue
            add_coefficients(chain, load, profile, begin + phase, way, direction)
            sense = 1.0 if direction == 0 else -1.0
            share = 0.5 * (1.0 + sense * omega / width) if blended else 1.0
            for j in range(load.size):
                value = load[j] * function(chain, row, 3 + j, u)
                power = chain.powers[profile, j]
                if power == 0:
                    resisting -= share * value
                    if blended:
                        drag -= 0.5 * sense * value / width
                elif power == 1:
                    resisting -= share * value * omega
                    drag -= share * value
                else:
                    resisting -= share * value * omega * omega
    return inertia, resisting, drag


@compiled_in_place
def dry_friction(chain: ShaftChain, load: FloatArray, station: int, angle: float) -> float:
    """Half the difference of a station's load torques between the two directions, at speed 0 [N m]."""
    result = 0.0
    for k in range(chain.first[station], chain.first[station + 1] if load.size else chain.first[station]):
        profile, phase = chain.profile[k], chain.phase[k]
        row, u = place(chain, profile, angle + phase)
        for direction in range(2):
            add_coefficients(chain, load, profile, angle + phase, 0.0, direction)
            for j in range(load.size):
                if chain.powers[profile, j] == 0:
                    result += (direction - 0.5) * load[j] * function(chain, row, 3 + j, u)
    return abs(result)


@partial(compiled_in_place, inlined=True)
def place(chain: ShaftChain, profile: int, angle: float) -> tuple[int, float]:
    """Row of the table and the place behind its node, in [0, 1), at an angle [rad]."""
    begin = chain.node_begin[profile]
    nodes = chain.node_begin[profile + 1] - begin
    turns = angle * _TURNS
    x = (turns - math.floor(turns)) * nodes
    node = min(int(x), nodes - 1)
    return begin + node, x - node


@partial(compiled_in_place, inlined=True)
def function(chain: ShaftChain, row: int, number: int, u: float) -> float:
    """A tabulated function behind a node."""
    table = chain.table
    p, q = table[row, number, 0] + u * table[row, number, 1], table[row, number, 2] + u * table[row, number, 3]
    return p + u * u * q


@compiled_in_place
def add_coefficients(
    chain: ShaftChain, load: FloatArray, profile: int, angle: float, way: float, direction: int
) -> None:
    """Mean coefficients of the load functions while an angle goes from `angle` on by `way` [rad], into `load`.

    direction: 0 for the stretches of forward rotation, 1 for those of backward rotation.
    """
    first, last = chain.start_begin[direction, profile], chain.start_begin[direction, profile + 1]
    if way < 0.0:
        angle, way = angle + way, -way
    row, _ = place(chain, profile, angle)
    at = angle - TURN * math.floor(angle * _TURNS)
    ahead = chain.next_start[direction, row]  # may lie before the angle, within the same interval of the table
    while ahead < last and chain.starts[ahead] <= at:
        ahead += 1
    behind = ahead - 1 if ahead > first else last - 1
    turned = 0.0
    if ahead == last:
        ahead, turned = first, TURN
    gap = chain.starts[ahead] + turned - at
    if gap >= way:
        for j in range(load.size):
            load[j] = chain.coefficients[behind, j]
        return
    for j in range(load.size):
        load[j] = gap / way * chain.coefficients[behind, j]
    done = gap
    while done < way:
        behind = ahead
        ahead += 1
        if ahead == last:
            ahead, turned = first, turned + TURN
        gap = min(chain.starts[ahead] + turned - at, way)
        for j in range(load.size):
            load[j] += (gap - done) / way * chain.coefficients[behind, j]
        done = gap
