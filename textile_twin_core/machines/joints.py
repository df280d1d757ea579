"""Joints of the robot description: the tree of links, cut where loops close, with every joint's value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from textile_twin_core.expression import Expr, const
from textile_twin_core.mechanism import Crank, EllipticGearPair, Motion, RigidArm, RRPDyad, RRRDyad
from textile_twin_core.mechanism.vector import Vector

if TYPE_CHECKING:
    from textile_twin_core.machines.machine import Machine
    from textile_twin_core.machines.model import MachineModel

BASE = "base"
Kind = Literal["continuous", "prismatic", "fixed"]


@dataclass(frozen=True)
class Joint:
    """A joint from `parent_link` to `child_link`; the child's frame lies at its start point, x along it.

    `origin_m` and `origin_angle_rad` place the joint in the parent's frame. The value of a
    continuous joint is the angle between the frames, that of a prismatic one the slider's distance
    from the guide's point along the guide.
    """

    name: str
    kind: Kind
    parent_link: str
    child_link: str
    origin_m: tuple[float, float]
    origin_angle_rad: float = 0.0
    axis: tuple[float, float] = (1.0, 0.0)


def machine_joints(machine: Machine) -> tuple[Joint, ...]:
    """The joints of a machine's first linkage, parents before children."""
    motion, names = machine.linkage.solved, machine.joint_names
    joints: list[Joint] = []
    for group in machine.groups:
        match group:
            case Crank():
                joints.append(_pivot(motion, names, group.name, group.at))
            case EllipticGearPair():
                joints.append(_pivot(motion, names, group.driver, group.at))
                joints.append(_pivot(motion, names, group.driven, group.driven_at))
            case RigidArm():
                host = motion.links[group.on]
                joints.append(Joint(f"{group.name}_mount", "fixed", host.name, group.name, (0.0, 0.0), group.angle_rad))
            case RRRDyad():
                joints.append(_pivot(motion, names, group.coupler, group.from_point))
                joints.append(_pivot(motion, names, group.rocker, group.ground))
            case RRPDyad():
                joints.append(_pivot(motion, names, group.rod, group.from_point))
                joints.append(
                    Joint(
                        names[group.slider],
                        "prismatic",
                        BASE,
                        group.slider,
                        group.guide_point_m,
                        axis=group.axis,
                    )
                )
    return tuple(joints)


def _pivot(motion: Motion, names: Mapping[str, str], link: str, point: str) -> Joint:
    name = names[link]
    if point in motion.points and motion.points[point].is_fixed:
        return Joint(name, "continuous", BASE, link, motion.points[point].fixed_position())
    carrier = [k for k in motion.links.values() if k.end == point][-1]
    return Joint(name, "continuous", carrier.name, link, (carrier.length, 0.0))


def joint_state(model: MachineModel, joint: Joint) -> tuple[Expr, Expr]:
    """Position and velocity of a joint [rad, rad/s or m, m/s]."""
    motion, omega = model.first.motion, model.shaft.omega
    child = motion.links[joint.child_link]
    if joint.kind == "prismatic":
        slide, along = motion.points[child.start], Vector.of(*joint.axis)
        travel = (slide.position - Vector.of(*joint.origin_m)).dot(along)
        return travel, slide.first.dot(along) * omega
    if joint.parent_link == BASE:
        return model.link_angle(child.name), child.first * omega
    parent = motion.links[joint.parent_link]
    angle = model.link_angle(child.name) - model.link_angle(parent.name)
    return angle, (child.first - parent.first) * omega if joint.kind != "fixed" else const(0.0)
