"""Analysis of machines with contacts for the page: their elements along their line over a cycle, with the impacts."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact import ContactEvent, ContactRun
from textile_twin_core.explore.shown import Analysis, Bar, Chart, Mark
from textile_twin_core.machine import ContactMachine
from textile_twin_core.machines.needle_transfer import ELEMENTS, PAD
from textile_twin_core.papers.needle_transfer import ForwardStroke, forward_stroke
from textile_twin_core.synthesis.turn import SAMPLES, shaft_angles

NOTE = "Impacts have no duration: marks show them, the curves of acceleration do not."
FINER = 10
"""Samples for extremes per shown sample."""
_TURN = 2.0 * math.pi
_SHOWN = {"impact": "hits", "touch": "touches", "release": "leaves"}
_SETTLED = "The second cycle, after a first one from the start that the machine declares."
_FRAME = "frame"


def analyse_contact(machine: ContactMachine, speed_rad_s: float) -> Analysis:
    """Analyse the second cycle at a constant speed.

    Raises:
        ContactError: The motion cannot be integrated.
        MachineError: The machine is not valid.
    """
    fine, theta = shaft_angles(FINER * SAMPLES), shaft_angles()
    run = machine.simulate(end_s=2.0 * _TURN / speed_rad_s, times=(_TURN + fine) / speed_rad_s)
    rows = [run.model.index[element] for element in machine.elements]
    events = [event for event in run.events if event.time_s * speed_rad_s >= _TURN]
    numbers: dict[str, float] = {}
    for element, row in zip(machine.elements, rows, strict=True):
        x, v, a = run.positions[row], run.velocities[row], run.accelerations[row]
        numbers[f"{element}_stroke_m"] = float(np.ptp(x))
        numbers[f"{element}_largest_speed_m_s"] = float(np.abs(v).max())
        numbers[f"{element}_largest_acceleration_m_s2"] = float(np.abs(a).max())
    points, bars = _picture(machine, run.positions[rows][:, ::FINER])
    fixed = tuple(name for name in points if name.startswith(_FRAME))
    charts = motion_charts(run, [element.replace("_", " ") for element in machine.elements], rows)
    notes = (_SETTLED, NOTE) if events else (_SETTLED,)
    marks = contact_marks(events, speed_rad_s)
    return Analysis(theta, points, fixed, bars, charts, numbers | impact_numbers(events), marks, notes=notes)


def motion_charts(run: ContactRun, labels: list[str], rows: list[int]) -> tuple[Chart, ...]:
    """Build the curves of the elements in these rows, of a run with `FINER` samples per shown sample."""
    motion = (run.positions * 1e3, run.velocities, run.accelerations)
    heads = (("Displacement", "mm"), ("Velocity", "m/s"), ("Acceleration", "m/s²"))
    return tuple(
        Chart(title, unit, {name: values[row, ::FINER] for name, row in zip(labels, rows, strict=True)})
        for (title, unit), values in zip(heads, motion, strict=True)
    )


def contact_marks(events: Iterable[ContactEvent], speed_rad_s: float) -> tuple[Mark, ...]:
    """Mark the first impact, touch and release of each stop or pad among the events."""
    firsts: dict[str, float] = {}
    for event in events:
        if event.kind in _SHOWN:
            name = f"{event.name.replace('_', ' ')} {_SHOWN[event.kind]}"
            firsts.setdefault(name, (event.time_s * speed_rad_s) % _TURN)
    return tuple(Mark(name, angle) for name, angle in firsts.items())


def impact_numbers(events: Iterable[ContactEvent]) -> dict[str, float]:
    """Count the impacts among the events and sum the energy that they dissipate."""
    impacts = [event for event in events if event.kind == "impact"]
    return {"impacts": float(len(impacts)), "energy_lost_J": float(sum(event.energy_lost_J for event in events))}


def _picture(
    machine: ContactMachine, positions: FloatArray
) -> tuple[dict[str, tuple[FloatArray, FloatArray]], tuple[Bar, ...]]:
    """Draw each element as a bar across the line, side by side, and pads on the frame as bars over all elements."""
    ux, uy = np.array(machine.axis) / math.hypot(*machine.axis)
    width = 0.2 * float(np.ptp(positions)) or 0.01
    points, bars = {}, []

    def bar(name: str, along: FloatArray, begin: float, end: float) -> None:
        for side, across in (("left", begin * width), ("right", end * width)):
            points[f"{name} {side}"] = along * ux - across * uy, along * uy + across * ux
        bars.append(Bar(name.removeprefix(f"{_FRAME} "), f"{name} left", f"{name} right"))

    for k, element in enumerate(machine.elements):
        bar(element.replace("_", " "), positions[k], k + 0.1, k + 0.9)
    for pad in (pad for pad in machine.pads if pad.lower == _FRAME):
        bar(f"{_FRAME} {pad.name}", np.full(positions.shape[1], pad.position_m), -0.5, len(machine.elements) + 0.5)
    return points, tuple(bars)


_BESIDE_M = 0.012
_LONG_M = 0.02


def analyse_transfer(machine: ContactMachine) -> Analysis:
    """Analyse one cycle from the published start, at the declared cycles per minute.

    Raises:
        ContactError: The motion cannot be integrated.
        MachineError: The machine is not valid.
    """
    fine, theta = shaft_angles(FINER * SAMPLES), shaft_angles()
    run = machine.simulate(times=fine / machine.nominal_speed_rad_s)
    rows = [run.model.index[element] for element in ELEMENTS]
    position = run.positions[:, ::FINER]
    labels = [element.replace("_", " ") for element in ELEMENTS]
    points, bars = {}, []
    for k, (label, row) in enumerate(zip(labels, rows, strict=True)):
        x = np.full(theta.size, (k - 1) * _BESIDE_M)
        points[f"{label} top"] = (x, -position[row])
        points[f"{label} tip"] = (x, -position[row] - _LONG_M)
        bars.append(Bar(label, f"{label} top", f"{label} tip"))
    pad = next(pad.position_m for pad in machine.model.pads if pad.name == PAD)
    ends = (-2.0 * _BESIDE_M, 2.0 * _BESIDE_M)
    points |= {
        f"pad {side}": (np.full(theta.size, x), np.full(theta.size, -pad)) for side, x in zip("ab", ends, strict=True)
    }
    bars.append(Bar("rubber pad", "pad a", "pad b"))
    forward = fine < machine.parameters["return_start_rad"]
    second = run.accelerations[rows[1]]
    stroke = _forward(machine)
    numbers = {
        "pad_reached_s": stroke.pad_s,
        "element_2_largest_deceleration_m_s2": -float(second[forward].min()),
        "element_2_largest_deceleration_s": stroke.deceleration_s,
        "collets_meet_s": stroke.contact_s,
        "element_2_off_the_pin_m": stroke.leaves_pin_m,
        **impact_numbers(run.events),
    }
    within = [event for event in run.events if event.time_s * machine.nominal_speed_rad_s < 2.0 * math.pi]
    return Analysis(
        theta,
        points,
        ("pad a", "pad b"),
        tuple(bars),
        motion_charts(run, labels, rows),
        numbers,
        contact_marks(within, machine.nominal_speed_rad_s),
        notes=(NOTE,),
    )


def _forward(machine: ContactMachine) -> ForwardStroke:
    """Return the forward stroke as the paper describes it; NaN where element 2 meets neither the pad nor element 3."""
    try:
        return forward_stroke(machine)
    except IndexError:
        return ForwardStroke(math.nan, math.nan, math.nan, math.nan)
