"""Compiled runs of the chain over samples: a station that follows a given motion, and all stations free."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import by_reference, compiled, compiled_in_place
from textile_twin_core.driveline.chain import ShaftChain
from textile_twin_core.driveline.step import ChainState, beyond, midpoint_step, mounted


@by_reference
class Outputs(NamedTuple):
    """Arrays for the results of a run at its samples, reduced to the main shaft."""

    psi: FloatArray
    """(samples, stations) angle beyond the reference [rad]"""
    omega: FloatArray
    """(samples, stations) [rad/s]"""
    alpha: FloatArray
    """(samples, stations) [rad/s^2]"""
    pieces: FloatArray
    """(samples, pieces) torque in each piece, positive as it drives the far station [N m]"""
    drive: FloatArray
    """(samples,) torque that the station which follows a motion needs, else the one given [N m]"""


def outputs(samples: int, stations: int) -> Outputs:
    """Room for a run."""
    shapes = ((samples, stations), (samples, stations), (samples, stations), (samples, stations - 1), (samples,))
    return Outputs(*(np.zeros(shape) for shape in shapes))


@partial(compiled_in_place, inlined=True)
def piece_torque(chain: ShaftChain, state: ChainState, i: int) -> float:
    """Torque in a piece [N m]."""
    reach = beyond(state.psi[i] - state.psi[i + 1], chain.half_play[i])
    touching = reach != 0.0 or chain.half_play[i] == 0.0
    return chain.stiffness[i] * reach + (chain.damping[i] * (state.speed[i] - state.speed[i + 1]) if touching else 0.0)


@compiled_in_place
def observe(
    chain: ShaftChain,
    state: ChainState,
    theta: float,
    omega: float,
    alpha: float,
    fixed: int,
    torque: FloatArray,
    j: int,
    out: Outputs,
) -> None:
    """Write speeds, accelerations and torques of the state at an instant into row j."""
    n = chain.inertia.size
    before = 0.0
    for i in range(n):
        w = omega + state.speed[i]
        inertia, resisting, _ = mounted(chain, state.load, i, theta + state.psi[i], theta + state.psi[i], w, 0.0)
        after = piece_torque(chain, state, i) if i < n - 1 else 0.0
        mass = chain.inertia[i] + inertia
        needed = resisting + chain.viscous[i] * w - torque[i] + after - before
        out.psi[j, i], out.omega[j, i] = state.psi[i], w
        if i == fixed:
            out.alpha[j, i], out.drive[j] = alpha, mass * alpha + needed
        else:
            out.alpha[j, i] = -needed / mass
        if i < n - 1:
            out.pieces[j, i] = after
        before = after


@partial(compiled_in_place, inlined=True)
def quintic(x: float, d: float, rise: float, w0: float, w1: float, a0: float, a1: float) -> tuple[float, float]:
    """Angle beyond the first one, and speed, at a share x of a time d between two states of a shaft."""
    p, q, r = rise - d * (w0 + 0.5 * d * a0), d * (w1 - w0 - d * a0), d * d * (a1 - a0)
    c3, c4, c5 = 10.0 * p - 4.0 * q + 0.5 * r, -15.0 * p + 7.0 * q - r, 6.0 * p - 3.0 * q + 0.5 * r
    angle = x * (d * w0 + x * (0.5 * d * d * a0 + x * (c3 + x * (c4 + x * c5))))
    speed = w0 + x * (d * a0 + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)) / d)
    return angle, speed


@compiled
def follow(
    chain: ShaftChain,
    state: ChainState,
    fixed: int,
    time: FloatArray,
    theta: FloatArray,
    omega: FloatArray,
    alpha: FloatArray,
    substeps: int,
    torque: FloatArray,
    out: Outputs,
) -> None:
    """Run with station `fixed` on a given motion, quintic between its samples.

    torque: (samples, stations) external torques, of which each step takes the mean of its two samples [N m].
    """
    observe(chain, state, theta[0], omega[0], alpha[0], fixed, torque[0], 0, out)
    for j in range(1, time.size):
        d = time[j] - time[j - 1]
        h = d / substeps
        rise = theta[j] - theta[j - 1]
        angle, speed = 0.0, omega[j - 1]
        middle = 0.5 * (torque[j - 1] + torque[j])
        for s in range(substeps):
            next_angle, next_speed = quintic(
                (s + 1.0) / substeps, d, rise, omega[j - 1], omega[j], alpha[j - 1], alpha[j]
            )
            midpoint_step(chain, state, theta[j - 1] + angle, speed, (next_speed - speed) / h, h, fixed, middle)
            angle, speed = next_angle, next_speed
        observe(chain, state, theta[j], omega[j], alpha[j], fixed, torque[j], j, out)


@compiled_in_place
def twist_statically(
    chain: ShaftChain, state: ChainState, theta: float, omega: float, alpha: float, fixed: int, torque: FloatArray
) -> None:
    """Set the state to the twist at which all stations follow the reference: no vibration at the beginning."""
    n = chain.inertia.size
    state.speed[:] = 0.0
    state.acceleration[:] = 0.0
    for _ in range(8):
        for i in range(n):
            inertia, resisting, _ = mounted(
                chain, state.load, i, theta + state.psi[i], theta + state.psi[i], omega, 0.0
            )
            state.right[i] = (chain.inertia[i] + inertia) * alpha + resisting + chain.viscous[i] * omega - torque[i]
        state.psi[fixed] = 0.0
        held = 0.0
        for i in range(n - 1, fixed, -1):
            held += state.right[i]
            state.upper[i - 1] = held
        held = 0.0
        for i in range(fixed):
            held -= state.right[i]
            state.upper[i] = held
        for i in range(fixed, n - 1):
            state.psi[i + 1] = state.psi[i] - twist_of(chain, i, state.upper[i])
        for i in range(fixed - 1, -1, -1):
            state.psi[i] = state.psi[i + 1] + twist_of(chain, i, state.upper[i])


@partial(compiled_in_place, inlined=True)
def twist_of(chain: ShaftChain, i: int, torque: float) -> float:
    """Twist of a piece under a torque [rad]."""
    play = chain.half_play[i] if torque > 0.0 else -chain.half_play[i] if torque < 0.0 else 0.0
    return torque / chain.stiffness[i] + play
