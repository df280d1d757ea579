"""URDF of a machine, from the same declaration as its mechanics."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.expression import Expr
from textile_twin_core.machine.model import MachineModel
from textile_twin_core.machine.robot import BAR_WIDTH_SHARE, Limits, Robot
from textile_twin_core.mechanism.extremes import smallest_value, values_over
from textile_twin_core.mechanism.joint import Joint

_PROBES = 721
_ROOM = 1e-9
"""Share of a joint's stroke by which its limits lie outside of it, so that rounding does not cross them."""


def machine_urdf(model: MachineModel) -> str:
    """The URDF text of a linkage: its tree of links, and a frame `needle_tip`, `beater_tip` or `sley_tip` at the tool.

    Loops are cut; the twin publishes every joint, passive ones too, so that the loops stay closed. Joints that do not
    turn fully have the limits of their motion in the machine, at its nominal speed.
    """
    machine = model.machine
    links = machine.linkage.solved.links
    robot = Robot(machine.name, max(link.length for link in links.values()) * BAR_WIDTH_SHARE)
    for link in links.values():
        robot.bar(link.name, link.length, [body for body in machine.bodies if body.on == link.name])
    for joint in machine.joints:
        limits = None if joint.kind == "fixed" else _limits(model, joint)
        turns = joint.kind == "continuous" and limits is not None
        along = math.atan2(joint.axis[1], joint.axis[0]) if joint.kind == "prismatic" else joint.origin_angle_rad
        kind = "revolute" if turns else joint.kind
        robot.joint(joint.name, kind, joint.parent_link, joint.child_link, joint.origin_m, along, limits)
    for measure in machine.measures:
        point = measure.tool(machine.linkage.solved)
        tool = next((link for link in links.values() if link.end == point), None)
        if tool is not None:
            robot.frame(f"{measure.name}_tip")
            robot.joint(f"{measure.name}_tip", "fixed", tool.name, f"{measure.name}_tip", (tool.length, 0.0))
    return robot.text()


def _limits(model: MachineModel, joint: Joint) -> Limits | None:
    """How far and how fast a joint goes; None for one that turns on and on."""
    machine = model.machine
    position = model.output(f"joint_{joint.name}_position")
    low, high = machine.range_rad
    angles = values_over(position, np.linspace(low, high, _PROBES))
    steps = np.diff(angles)
    if joint.kind == "continuous" and (np.abs(steps).max() > math.pi / 2 or abs(angles[-1] - angles[0]) > 1.0):
        return None
    lower, upper = _extreme(position, machine.range_rad), -_extreme(-position, machine.range_rad)
    room = _ROOM * max(upper - lower, 1e-6)
    fastest = float(np.abs(steps).max()) / (high - low) * (_PROBES - 1)
    return Limits(lower - room, upper + room, fastest * machine.nominal_speed_rad_s)


def _extreme(value: Expr, range_rad: tuple[float, float]) -> float:
    return smallest_value(value, range_rad)[1]
