"""Joint reactions in closed form (Newton-Euler), group by group from the last to the first.

Each group balances its own links under the forces of later groups, writes the forces in its pins, and applies their
opposites to the links that carry it. The remaining moment on the shaft is the balancing torque, on a route independent
of the reduction.
"""

from __future__ import annotations

from collections.abc import Iterable

from textile_twin_core.dynamics.body import Body
from textile_twin_core.dynamics.shaft_state import ShaftState
from textile_twin_core.expression import Expr
from textile_twin_core.mechanism import Group, LinkMotion, Motion
from textile_twin_core.mechanism.vector import Vector
from textile_twin_core.mechanism.wrenches import Wrenches


def centroid_lever(link: LinkMotion, body: Body) -> Vector:
    """Express the vector from the link's start point to the body's centroid [m]."""
    along, across = body.centroid
    u = link.direction
    return (along * link.length) * u + (across * link.length) * u.turned_left()


def inertia_force(motion: Motion, body: Body, shaft: ShaftState) -> tuple[Vector, Expr]:
    """Express the d'Alembert force -m a [N] at the centroid and the couple -I alpha_k [N m] of a body."""
    link = motion.links[body.on]
    start = motion.points[link.start]
    lever = centroid_lever(link, body)
    p, q, normal = link.first, link.second, lever.turned_left()
    first = start.first + p * normal
    second = start.second + q * normal - (p * p) * lever
    m, w2, a = body.mass_kg, shaft.omega_squared, shaft.alpha
    force = (-m) * (w2 * second + a * first)
    return force, (-body.inertia_kgm2) * (w2 * q + a * p)


def gather(motion: Motion, bodies: Iterable[Body], gravity: Vector, shaft: ShaftState) -> Wrenches:
    """Sum the weights and inertia forces of all bodies on their links."""
    wrenches = Wrenches(motion)
    for body in bodies:
        if body.is_flywheel:
            rotor = motion.rotations[body.on]
            turning = shaft.omega_squared * rotor.second + shaft.alpha * rotor.first
            wrenches.add_torque(body.on, -body.inertia_kgm2 * turning)
            continue
        link = motion.links[body.on]
        force, couple = inertia_force(motion, body, shaft)
        lever = centroid_lever(link, body)
        total = force + body.mass_kg * gravity
        wrenches.add(link.name, total, lever.cross(total) + couple)
    return wrenches


def balance(groups: Iterable[Group], wrenches: Wrenches) -> None:
    """Balance every group, the last first, and leave reactions and shaft torque in `wrenches`."""
    for group in reversed(tuple(groups)):
        group.balance(wrenches)
