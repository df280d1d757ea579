"""URDF of a machine, from the same declaration as its mechanics or from a run of its contact model."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from textile_twin_core.contact import ContactRun
from textile_twin_core.dynamics.body import Body
from textile_twin_core.expression import Expr
from textile_twin_core.machine.linkage_row import linkage_row, station_places_m
from textile_twin_core.machine.model import MachineModel
from textile_twin_core.machine.robot import BAR_WIDTH_SHARE, Limits, Robot
from textile_twin_core.mechanism import MAIN_SHAFT
from textile_twin_core.mechanism.extremes import smallest_value, values_over
from textile_twin_core.mechanism.joint import BASE, Joint

_PROBES = 721
_ROOM = 1e-9
"""Margin of a joint's limits as a share of its stroke, against rounding."""


def machine_urdf(model: MachineModel) -> str:
    """Build the URDF text of a linkage: its tree of links, and a frame `NAME_tip` at each tool.

    With an elastic shaft every linkage is at its station along z, with the suffix `_at_S` on its names, and each
    station is a link `station_S` that turns about the shaft's axis.

    Loops are cut. The twin publishes every joint, passive ones included, so that the loops stay closed. Joints that do
    not turn fully have the limits of their motion in the machine, at nominal speed.
    """
    machine = model.machine
    links = machine.linkage.solved.links
    robot = Robot(machine.name, max(link.length for link in links.values()) * BAR_WIDTH_SHARE)
    limits = {joint.name: None if joint.kind == "fixed" else _limits(model, joint) for joint in machine.joints}
    for row in linkage_row(machine):
        for link in links.values():
            robot.bar(f"{link.name}{row.suffix}", link.length, [b for b in machine.bodies if b.on == link.name])
        for joint in machine.joints:
            limit, on_base = limits[joint.name], joint.parent_link == BASE
            along = math.atan2(joint.axis[1], joint.axis[0]) if joint.kind == "prismatic" else joint.origin_angle_rad
            robot.joint(
                f"{joint.name}{row.suffix}",
                "revolute" if joint.kind == "continuous" and limit is not None else joint.kind,
                BASE if on_base else f"{joint.parent_link}{row.suffix}",
                f"{joint.child_link}{row.suffix}",
                joint.origin_m,
                along,
                limit,
                z_m=row.z_m if on_base else 0.0,
            )
        for measure in machine.measures:
            point, tip = measure.tool(machine.linkage.solved), f"{measure.name}_tip{row.suffix}"
            tool = next((link for link in links.values() if link.end == point), None)
            if tool is not None:
                robot.frame(tip)
                robot.joint(tip, "fixed", f"{tool.name}{row.suffix}", tip, (tool.length, 0.0))
    _add_stations(robot, model)
    return robot.text()


def _add_stations(robot: Robot, model: MachineModel) -> None:
    """Add the stations of an elastic shaft about the axis of the main shaft, each with the piece behind it."""
    shaft, along = model.machine.shaft, station_places_m(model.machine)
    axis = next((joint for joint in model.machine.joints if joint.name == MAIN_SHAFT), None)
    for k, name in enumerate(() if shaft is None else shaft.names):
        robot.rod(f"station_{name}", float(along[min(k + 1, along.size - 1)] - along[k]))
        place = axis.origin_m if axis is not None and axis.parent_link == BASE else (0.0, 0.0)
        robot.joint(f"station_{name}", "continuous", BASE, f"station_{name}", place, z_m=float(along[k]))


def _limits(model: MachineModel, joint: Joint) -> Limits | None:
    """Compute range and largest speed of a joint; None for a joint that turns fully."""
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


def contact_urdf(name: str, run: ContactRun, masses_kg: Mapping[str, float], axis: tuple[float, float]) -> str:
    """Build the URDF text: each element as a bar that slides along `axis`, within the limits of a run."""
    rows = {element: row for element, row in run.model.index.items() if element in masses_kg}
    strokes = {element: run.positions[row] for element, row in rows.items()}
    length = max(float(np.ptp(positions)) for positions in strokes.values())
    robot = Robot(name, length * BAR_WIDTH_SHARE)
    for element, positions in sorted(strokes.items()):
        # A sliding element has no declared inertia: take that of a rod.
        mass = masses_kg[element]
        robot.bar(element, length, [Body(element, mass, mass * length**2 / 12.0)])
        fastest = float(np.abs(run.velocities[rows[element]]).max())
        limits = Limits(float(positions.min()), float(positions.max()), fastest)
        robot.joint(element, "prismatic", BASE, element, (0.0, 0.0), math.atan2(axis[1], axis[0]), limits)
    return robot.text()
