"""The needle transfer on the page: its three elements over one cycle, with the impacts."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.explore.shown import Analysis, Bar, Chart, Mark
from textile_twin_core.machine import ContactMachine
from textile_twin_core.machines.needle_transfer import ELEMENTS, PAD
from textile_twin_core.papers.needle_transfer import ForwardStroke, forward_stroke
from textile_twin_core.synthesis.turn import SAMPLES, shaft_angles

_BESIDE_M = 0.012
_LONG_M = 0.02
_FINER = 10
_SHOWN = {"impact": "hits", "touch": "touches", "release": "leaves"}


def analyse_transfer(machine: ContactMachine) -> Analysis:
    """One cycle from the published start, at the declared cycles per minute. Raises ContactError and MachineError."""
    fine, theta = shaft_angles(_FINER * SAMPLES), shaft_angles()
    run = machine.simulate(times=fine / machine.nominal_speed_rad_s)
    rows = [run.model.index[element] for element in ELEMENTS]
    position, velocity, acceleration = (a[:, ::_FINER] for a in (run.positions, run.velocities, run.accelerations))
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
        "impacts": float(sum(event.kind == "impact" for event in run.events)),
        "energy_lost_J": float(sum(event.energy_lost_J for event in run.events)),
    }
    firsts: dict[str, float] = {}
    for event in run.events:
        if event.kind in _SHOWN and event.time_s * machine.nominal_speed_rad_s < 2.0 * math.pi:
            name = f"{event.name.replace('_', ' ')} {_SHOWN[event.kind]}"
            firsts.setdefault(name, event.time_s * machine.nominal_speed_rad_s)
    charts = (
        Chart("Displacement", "mm", {n: 1e3 * position[r] for n, r in zip(labels, rows, strict=True)}),
        Chart("Velocity", "m/s", {n: velocity[r] for n, r in zip(labels, rows, strict=True)}),
        Chart("Acceleration", "m/s²", {n: acceleration[r] for n, r in zip(labels, rows, strict=True)}),
    )
    note = "Impacts are instants: curves of acceleration do not show them, marks do."
    return Analysis(
        theta,
        points,
        ("pad a", "pad b"),
        tuple(bars),
        charts,
        numbers,
        tuple(Mark(name, angle) for name, angle in firsts.items()),
        notes=(note,),
    )


def _forward(machine: ContactMachine) -> ForwardStroke:
    """What the paper tells of the forward motion; NaN where element 2 meets neither pad nor element 3."""
    try:
        return forward_stroke(machine)
    except IndexError:
        return ForwardStroke(math.nan, math.nan, math.nan, math.nan)
