"""Analysis of a design for the page: curves over one turn, moving linkage, marks and numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.driveline import elastic_shaft, find_resonances
from textile_twin_core.dynamics.loads import Backing, ForceCurve
from textile_twin_core.explore.analysis_of_contact import analyse_contact, analyse_transfer
from textile_twin_core.explore.design import Design
from textile_twin_core.explore.interference import clashes
from textile_twin_core.explore.shown import Analysis, Bar, Chart, Mark, Span
from textile_twin_core.machine import ContactMachine, Machine
from textile_twin_core.machine.events import DWELL_SHARE
from textile_twin_core.mechanism import Crank, EllipticGearPair, GearPair, RRPDyad, RRRDyad
from textile_twin_core.mechanism.joint import BASE
from textile_twin_core.synthesis.balancing.shaking import shaking
from textile_twin_core.synthesis.design_chart import TRANSMISSION
from textile_twin_core.synthesis.numbers import (
    MOTION,
    dwell_within,
    motion_number,
    shaking_numbers,
    smallest,
    torque_numbers,
)
from textile_twin_core.synthesis.turn import over_turn, shaft_angles

_TURN = 2.0 * math.pi
_SLOWEST, _FASTEST = 0.2, 2.0
_CRITICAL_SPEEDS = 4
"""Number of critical speeds shown, in a range around the speed of the design."""
_BEAT_UP = ("beater", "reed", "sley")
"""Measures whose front end beats up the weft."""
_TORQUE = {
    "balancing_torque_Nm": "balancing",
    "torque_inertial_Nm": "inertia",
    "torque_gravity_Nm": "gravity",
    "torque_load_Nm": "loads",
}


def analyse(design: Design) -> Analysis:
    """Analyse one turn of a design.

    Raises:
        MachineError: The machine cannot close; the message names the shaft angle.
    """
    machine = design.machine()
    if isinstance(machine, ContactMachine):
        return analyse_contact(machine, design.speed_rad_s) if design.has_speed else analyse_transfer(machine)
    assert isinstance(machine, Machine)  # the only other kind of machine
    theta, meshes = shaft_angles(), [group.mesh for group in machine.groups if isinstance(group, GearPair)]
    points = _points(machine, theta)
    charts, numbers, curves = _motion(machine, design, theta)
    numbers[TRANSMISSION] = min((c.transmission_angle_rad for c in machine.closeness), default=math.nan)
    numbers |= _ratios(machine)
    notes = []
    if not machine.bodies:
        notes.append("No link has a mass: there is no torque. Give masses to see it.")
    elif machine.missing_for_torque:
        missing = len(machine.missing_for_torque)
        notes.append(f"The paper gives no masses: fill in the {missing} fields that say 'give' and there is torque.")
    else:
        more, forces = _forces(machine, design.speed_rad_s, theta)
        charts += more
        numbers |= forces
    if machine.shaft is not None and not machine.missing_for_torque:
        numbers |= _shaft_numbers(machine, design.speed_rad_s)
        notes.append("The main shaft twists: torque and forces here are those of a rigid one.")
    return Analysis(
        theta,
        points,
        tuple(n for n, point in machine.linkage.solved.points.items() if point.is_fixed and n not in meshes),
        _bars(machine),
        tuple(charts),
        {name: float(value) for name, value in numbers.items()},
        tuple(_marks(machine, curves, theta)),
        tuple(_dwells(design, curves, theta)),
        clashes(machine, points, theta),
        tuple((*j.origin_m, *j.axis) for j in machine.joints if j.kind == "prismatic" and j.parent_link == BASE),
        tuple(notes),
        {name: curve[0] for name, curve in curves.items()},
    )


def _points(machine: Machine, theta: FloatArray) -> dict[str, tuple[FloatArray, FloatArray]]:
    motion = machine.model.first.motion
    places = [axis for point in motion.points.values() for axis in (point.position.x, point.position.y)]
    found = over_turn(places, theta)
    return {name: (found[2 * k], found[2 * k + 1]) for k, name in enumerate(motion.points)}


def _motion(
    machine: Machine, design: Design, theta: FloatArray
) -> tuple[list[Chart], dict[str, float], dict[str, tuple[FloatArray, ...]]]:
    speed = design.speed_rad_s
    curves: dict[str, tuple[FloatArray, ...]] = {}
    numbers: dict[str, float] = {}
    for measure in machine.measures:
        names = [f"{measure.name}_{what}" for what in ("position_m", "velocity_m_s", "acceleration_m_s2")]
        position, velocity, acceleration = over_turn([machine.model.output(n) for n in names], theta, speed)
        curves[measure.name] = position, velocity, acceleration
        for what in MOTION:
            found = motion_number(what, position, velocity, acceleration, design.dwell_within_m)
            numbers[f"{measure.name}_{what}"] = float(found)
    if not curves:
        return [_swings(machine, theta)], numbers, curves
    charts = [
        Chart("Displacement", "mm", {name: 1e3 * (c[0] - c[0].min()) for name, c in curves.items()}),
        Chart("Velocity", "m/s", {name: c[1] for name, c in curves.items()}),
        Chart("Acceleration", "m/s²", {name: c[2] for name, c in curves.items()}),
    ]
    return charts, numbers, curves


def _swings(machine: Machine, theta: FloatArray) -> Chart:
    """Return the angles of the links that do not turn with the shaft, for a machine without measures."""
    motion = machine.model.first.motion
    links = [link for name, link in motion.links.items() if link.angle is None and not link.direction.x.is_constant]
    found = over_turn([part for link in links for part in (link.direction.x, link.direction.y)], theta)
    angles = {
        link.name: np.degrees(np.unwrap(np.arctan2(found[2 * k + 1], found[2 * k]))) for k, link in enumerate(links)
    }
    return Chart("Angle", "deg", angles)


def _forces(machine: Machine, speed: float, theta: FloatArray) -> tuple[list[Chart], dict[str, float]]:
    model, at = machine.model, machine.linkage.pins
    guides = [name for name in model.outputs if name.startswith("reaction_guide")]
    contacts = [name for name in model.outputs if name.startswith("contact_force_")]
    parts = [name for name in _TORQUE if name != "torque_load_Nm" or machine.loads]
    names = [*parts, *(f"reaction_{pin}_{axis}_N" for pin in at for axis in "xy"), *guides, *contacts]
    by_name = dict(zip(names, over_turn([model.output(name) for name in names], theta, speed), strict=True))
    shaken = shaking(machine, speed, theta)
    reactions = {pin: np.hypot(by_name[f"reaction_{pin}_x_N"], by_name[f"reaction_{pin}_y_N"]) for pin in at}
    reactions |= {"guide" if len(guides) == 1 else name[15:-2]: np.abs(by_name[name]) for name in guides}
    reactions |= {
        f"on {name[14:-2].replace('_', ' ')}": by_name[name] for name in contacts
    }  # negative: the roller would lift off
    charts = [
        Chart("Torque on the shaft", "N m", {_TORQUE[name]: by_name[name] for name in parts}),
        Chart("Reactions", "N", reactions),
        Chart("Shaking force", "N", {"x": shaken.x_N, "y": shaken.y_N}),
        Chart("Shaking moment", "N m", {"about the origin": shaken.moment_Nm}),
    ]
    numbers = torque_numbers(by_name["balancing_torque_Nm"]) | shaking_numbers(shaken.x_N, shaken.y_N)
    largest = max(reactions, key=lambda pin: float(reactions[pin].max()))
    more = {"largest_reaction_N": float(reactions[largest].max())}
    return charts, {name: float(value) for name, value in numbers.items()} | more


def _shaft_numbers(machine: Machine, speed: float) -> dict[str, float]:
    """Return the first natural frequency of an elastic main shaft and its severest critical speeds up to twice
    this speed.
    """
    found = find_resonances(elastic_shaft(machine), (_SLOWEST * speed, _FASTEST * speed))
    severest = sorted(found.critical, key=lambda each: -each.severity)[:_CRITICAL_SPEEDS]
    return {"first_natural_frequency_Hz": found.modes[0].damped_Hz} | {
        f"critical_speed_order_{each.order}_mode_{each.mode}_rad_s": each.speed_rad_s for each in severest
    }


def _ratios(machine: Machine) -> dict[str, float]:
    """Return crank over coupler, or over rod, of the first dyad on a crank."""
    cranks = {group.end: group.length_m for group in machine.groups if isinstance(group, Crank)}
    for group in machine.groups:
        if isinstance(group, (RRRDyad, RRPDyad)) and group.from_point in cranks:
            return {"crank_over_coupler": cranks[group.from_point] / group.lengths_m[0]}
    return {}


def _bars(machine: Machine) -> tuple[Bar, ...]:
    half_axes: dict[str, tuple[float, float]] = {}
    for group in machine.groups:
        if isinstance(group, EllipticGearPair):
            (ox, oy), (ax, ay) = machine.points[group.at], machine.points[group.driven_at]
            major = math.hypot(ax - ox, ay - oy) / 2.0
            half_axes |= dict.fromkeys((group.driver, group.driven), (major, group.axis_ratio * major))
    discs: dict[str, list[tuple[str, float]]] = {}
    for gears in (group for group in machine.groups if isinstance(group, GearPair)):
        for circle in gears.pitch_circles(machine.linkage.solved):
            discs.setdefault(circle.link or gears.driven, []).append((circle.centre, circle.radius))
    return tuple(
        Bar(name, start, end, half_axes.get(name), tuple(discs.get(name, ()))) for name, start, end in machine.links
    )


def _marks(machine: Machine, curves: dict[str, tuple[FloatArray, ...]], theta: FloatArray) -> list[Mark]:
    found = []
    for name, (position, velocity, _) in curves.items():
        words, low, high = name.replace("_", " "), float(position.min()), float(position.max())
        for angle in _crossings(theta, -velocity):
            place = float(np.interp(angle, theta, position, period=_TURN))
            beats = name in _BEAT_UP and place > high - DWELL_SHARE * (high - low)  # excludes oscillations in the dwell
            found.append(Mark("beat-up" if beats else f"{words} front", angle))
        found += [Mark(f"{words} rear", angle) for angle in _crossings(theta, velocity)]
        for load in machine.loads:
            if isinstance(load, Backing) and load.on == name and high >= load.entry_plane_m:
                found += [Mark("entry", angle) for angle in _crossings(theta, position - load.entry_plane_m)]
                found += [Mark("exit", angle) for angle in _crossings(theta, load.exit_plane_m - position)]
            if isinstance(load, ForceCurve) and load.measure == f"{name}_position_m" and high >= load.knots[0]:
                found += [Mark("entry", angle) for angle in _crossings(theta, position - load.knots[0])]
                found += [Mark("exit", angle) for angle in _crossings(theta, load.knots[0] - position)]
    return sorted(found, key=lambda mark: mark.angle_rad)


def _dwells(design: Design, curves: dict[str, tuple[FloatArray, ...]], theta: FloatArray) -> Iterator[Span]:
    """Find the dwell of each measure at its rear, as its number counts it."""
    for name, (position, _, _) in curves.items():
        inside = smallest(position) + dwell_within(position, design.dwell_within_m) - position
        ends = _crossings(theta, -inside)
        for begin in _crossings(theta, inside):
            yield Span(
                f"{name.replace('_', ' ')} dwell", begin, (begin + min((end - begin) % _TURN for end in ends)) % _TURN
            )


def _crossings(theta: FloatArray, values: FloatArray) -> list[float]:
    """Return the angles [rad] where values rise through zero, with linear interpolation."""
    after = np.roll(values, -1)
    k = np.flatnonzero((values < 0.0) & (after >= 0.0))
    share = values[k] / (values[k] - after[k])
    angles = theta[k] + share * (theta[1] - theta[0])
    return [float(angle) % _TURN for angle in angles]
