"""Shaking force and moment: what a machine's inertia does to its frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics.reactions import centroid_lever, inertia_force
from textile_twin_core.expression import Expr, const
from textile_twin_core.machines.machine import Machine
from textile_twin_core.synthesis.turn import SAMPLES, over_turn, shaft_angles


@dataclass(frozen=True)
class Shaking:
    """Over one turn at constant speed, (n,) arrays: shaking force [N] on the frame and moment about the origin [N m].

    The force is -sum(m a) of all bodies of all linkages, the moment theirs about the frame's origin with -sum(I alpha),
    all linkages taken as lying in one plane. Weight and loads are not in it.
    """

    theta_rad: FloatArray
    x_N: FloatArray
    y_N: FloatArray
    moment_Nm: FloatArray

    @property
    def force_N(self) -> FloatArray:
        """(n,) size of the force."""
        return np.hypot(self.x_N, self.y_N)


def shaking_expressions(machine: Machine) -> tuple[Expr, Expr, Expr]:
    """Shaking force x, y [N] and moment about the origin [N m], as expressions of the shaft's state."""
    x, y, moment = const(0.0), const(0.0), const(0.0)
    for linkage in machine.model.linkages:
        for body in linkage.bodies:
            if body.is_flywheel:
                rotor = linkage.motion.rotations[body.on]
                turning = linkage.shaft.omega_squared * rotor.second + linkage.shaft.alpha * rotor.first
                moment += -body.inertia_kgm2 * turning
                continue
            force, couple = inertia_force(linkage.motion, body, linkage.shaft)
            link = linkage.motion.links[body.on]
            place = linkage.motion.points[link.start].position + centroid_lever(link, body)
            x, y, moment = x + force.x, y + force.y, moment + place.cross(force) + couple
    return x, y, moment


def shaking(machine: Machine, speed_rad_s: float, samples: int = SAMPLES) -> Shaking:
    """Shaking force and moment over one turn at a constant speed."""
    theta = shaft_angles(samples)
    return Shaking(theta, *over_turn(shaking_expressions(machine), theta, speed_rad_s))
