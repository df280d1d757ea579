"""Analysis of the needle transfer for the page: its three elements over one cycle, with the impacts."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.explore.analysis_of_contact import FINER, NOTE, contact_marks, impact_numbers, motion_charts
from textile_twin_core.explore.shown import Analysis, Bar
from textile_twin_core.machine import ContactMachine
from textile_twin_core.machines.needle_transfer import ELEMENTS, PAD
from textile_twin_core.papers.needle_transfer import ForwardStroke, forward_stroke
from textile_twin_core.synthesis.turn import SAMPLES, shaft_angles

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
