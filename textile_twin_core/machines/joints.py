"""Joints of a machine: their names, and their values as expressions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from textile_twin_core.expression import Expr, const
from textile_twin_core.mechanism import MAIN_SHAFT, Linkage
from textile_twin_core.mechanism.joint import BASE, Joint
from textile_twin_core.mechanism.vector import Vector

if TYPE_CHECKING:
    from textile_twin_core.machines.model import MachineModel


def default_joint_names(linkage: Linkage) -> dict[str, str]:
    """A joint name for each link that moves on its own: the shaft's for what it turns first, else the link's."""
    names = {joint.child_link: joint.name for joint in linkage.joints if joint.kind != "fixed"}
    return names if linkage.shaft_link is None else names | {linkage.shaft_link: MAIN_SHAFT}


def named_joints(linkage: Linkage, names: Mapping[str, str]) -> tuple[Joint, ...]:
    """The joints of a linkage, called as `names` says by link."""
    return tuple(
        joint if joint.kind == "fixed" else replace(joint, name=names[joint.child_link]) for joint in linkage.joints
    )


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
