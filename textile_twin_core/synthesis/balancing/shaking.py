"""Shaking force and moment of a machine's inertia on its frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics.body import Body
from textile_twin_core.expression import Expr
from textile_twin_core.machine.machine import Machine
from textile_twin_core.mechanism import Motion
from textile_twin_core.synthesis.turn import SAMPLES, over_turn


@dataclass(frozen=True)
class Shaking:
    """Shaking force on the frame [N] and moment about the origin [N m] over a turn at constant speed, (n,) arrays.

    The force is -sum(m a) of all bodies of all linkages. The moment is that of these forces about the frame's origin,
    with -sum(I alpha), taking all linkages in one plane. Weight and loads are not included.
    """

    theta_rad: FloatArray
    x_N: FloatArray
    y_N: FloatArray
    moment_Nm: FloatArray

    @property
    def force_N(self) -> FloatArray:
        """(n,) magnitude of the force [N]."""
        return np.hypot(self.x_N, self.y_N)


def shaking(machine: Machine, speed_rad_s: float, theta_rad: FloatArray | None = None) -> Shaking:
    """Compute shaking force and moment at a constant speed, at shaft angles (n,) [rad], by default 720 per turn.

    The computation uses the motion's derivatives by the shaft angle on arrays, quickly enough for interactive use.
    """
    theta = machine.shaft_angles(SAMPLES) if theta_rad is None else theta_rad
    moved = [(k.motion, b) for k in machine.model.linkages for b in k.bodies]
    needed = [part for motion, body in moved for part in _parts(motion, body)]
    found = iter(over_turn(needed, theta))
    force, moment = np.zeros(theta.size, dtype=np.complex128), np.zeros(theta.size)
    for motion, body in moved:
        if body.is_flywheel:
            moment -= body.inertia_kgm2 * next(found)
            continue
        place, start, direction = (next(found) + 1j * next(found) for _ in range(3))
        first, second = next(found), next(found)
        lever = complex(*body.centroid) * motion.links[body.on].length * direction
        push = -body.mass_kg * (start + (1j * second - first**2) * lever)
        force += push
        moment += (np.conj(place + lever) * push).imag - body.inertia_kgm2 * second
    w2 = speed_rad_s**2
    return Shaking(theta, w2 * force.real, w2 * force.imag, w2 * moment)


def _parts(motion: Motion, body: Body) -> tuple[Expr, ...]:
    """Return the motion that determines a body's inertia force: start of its link, and accelerations of both."""
    if body.is_flywheel:
        return (motion.rotations[body.on].second,)
    link = motion.links[body.on]
    start, u = motion.points[link.start], link.direction
    return start.position.x, start.position.y, start.second.x, start.second.y, u.x, u.y, link.first, link.second
