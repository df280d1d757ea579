"""Joint reactions, group by group from the last to the first, in closed form (Newton-Euler).

Each group balances its own links with what later groups put on them, books the forces in its pins
and hands their opposites to the links that carry it. What is left on the shaft is the
balancing torque, by another way than the reduction.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import singledispatch

from textile_twin_core.dynamics.body import Body
from textile_twin_core.dynamics.shaft_state import ShaftState
from textile_twin_core.dynamics.wrenches import Wrenches
from textile_twin_core.expression import Expr, at_least, const, select
from textile_twin_core.mechanism import (
    Crank,
    EllipticGearPair,
    Group,
    LinkMotion,
    Motion,
    RigidArm,
    RRPDyad,
    RRRDyad,
)
from textile_twin_core.mechanism.vector import Vector


def centroid_lever(link: LinkMotion, body: Body) -> Vector:
    """From the link's start point to the body's centroid [m]."""
    along, across = body.centroid
    u = link.direction
    return (along * link.length) * u + (across * link.length) * u.turned_left()


def inertia_force(motion: Motion, body: Body, shaft: ShaftState) -> tuple[Vector, Expr]:
    """D'Alembert force -m a [N] at the centroid and couple -I alpha_k [N m] of a body."""
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
    """Weights and inertia forces of all bodies on their links."""
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
    """Balance every group, the last first; reactions and shaft torque stand in `wrenches` then."""
    for group in reversed(tuple(groups)):
        transmit(group, wrenches)


@singledispatch
def transmit(group: object, wrenches: Wrenches) -> None:
    """Balance one group and hand on what it transmits."""
    raise TypeError(f"no reactions are known for a group of type {type(group).__name__}")


@transmit.register
def _(group: Crank, wrenches: Wrenches) -> None:
    force, moment = wrenches.on(group.name)
    wrenches.add_reaction(group.at, -force)
    wrenches.add_torque(group.driven_by, moment)


@transmit.register
def _(group: RigidArm, wrenches: Wrenches) -> None:
    force, moment = wrenches.on(group.name)
    wrenches.transmitted[group.name] = -moment
    wrenches.add(group.on, force, moment)


@transmit.register
def _(group: RRRDyad, wrenches: Wrenches) -> None:
    motion = wrenches.motion
    coupler, rocker = motion.links[group.coupler], motion.links[group.rocker]
    coupler_force, coupler_moment = wrenches.on(group.coupler)
    rocker_force, rocker_moment = wrenches.on(group.rocker)
    inverse = 2.0 / group.root(motion.points[group.from_point], motion.points[group.ground])
    # moments about A and C leave two equations for the force in B, in the directions of the links
    joint = (rocker.length * coupler_moment * inverse) * rocker.direction + (
        coupler.length * rocker_moment * inverse
    ) * coupler.direction
    start = joint - coupler_force
    ground = -joint - rocker_force
    wrenches.add_reaction(group.end, joint)
    wrenches.add_reaction(group.from_point, start)
    wrenches.add_reaction(group.ground, ground)
    wrenches.pull_on_point(group.from_point, -start)
    wrenches.pull_on_point(group.ground, -ground)


@transmit.register
def _(group: RRPDyad, wrenches: Wrenches) -> None:
    motion = wrenches.motion
    start = motion.points[group.from_point]
    along = Vector.of(*group.axis)
    across = along.turned_left()
    rod_force, rod_moment = wrenches.on(group.rod)
    slider_force, _ = wrenches.on(group.slider)
    axial = -slider_force.dot(along)
    lateral = (rod_moment - axial * group.offset(start)) * (1.0 / group.reach(start))
    joint = axial * along + lateral * across
    first = joint - rod_force
    wrenches.add_reaction(group.end, joint)
    wrenches.add_reaction(group.from_point, first)
    wrenches.guide_reactions[group.slider] = -(lateral + slider_force.dot(across))
    wrenches.pull_on_point(group.from_point, -first)


@transmit.register
def _(group: EllipticGearPair, wrenches: Wrenches) -> None:
    mesh = group.contact(wrenches.motion)
    driver_force, driver_moment = wrenches.on(group.driver)
    driven_force, driven_moment = wrenches.on(group.driven)
    load = driven_moment + wrenches.torque_on.pop(group.driven, const(0.0))
    across = load / mesh.driven_radius
    # the flank that bears turns the force away from the common tangent so that it pushes the gears apart
    k = math.tan(group.pressure_angle_rad)
    pressing = (mesh.steepness - k) / (1.0 + k * mesh.steepness)
    other = (mesh.steepness + k) / (1.0 - k * mesh.steepness)
    slant = select(at_least(across, 0.0), pressing, other)
    tooth = across * (mesh.along.turned_left() - slant * mesh.along)
    wrenches.add_reaction(group.mesh, tooth)
    wrenches.add_reaction(group.driven_at, -tooth - driven_force)
    wrenches.add_reaction(group.at, tooth - driver_force)
    wrenches.add_torque(group.driven_by, driver_moment - mesh.driver_radius * across)
