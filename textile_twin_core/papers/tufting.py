"""Printed motion, events, torques and forces of the tufting machine, and results of the machine."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.machine.machine import Machine
from textile_twin_core.machines.tufting import tufting
from textile_twin_core.papers.rows import PrintedAndOurs, PublishedRow, at_angles, in_sections, over_a_turn, span
from textile_twin_core.papers.tufting_equations import equation_rows

TUFTING = "Xu et al. 2016"

SPEED_RAD_S = 160.0 * math.pi / 30.0
SAMPLING_HZ = 500.0

FIGURE_9_START_S = 14.0
"""Time of shaft angle 0 in Fig. 9 [s]."""

PRINTED_EVENTS: tuple[tuple[str, float, str, str], ...] = (
    # description, shaft angle [deg], time in Fig. 9 [s], event of the machine
    ("needle stabs the backing", 22.0, "14.02", "needle_enters_backing"),
    ("needle lowest", 108.0, "14.11", "needle_largest"),
    ("needle leaves the backing", 194.0, "14.20", "needle_leaves_backing"),
    ("needle highest", 287.0, "14.30", "needle_smallest"),
)

_SAMPLES = 36000
_EITHER_SIDE = np.array([-1e-9, 1e-9])
_CUT = "cut off in print, not rounded"
_SWING = "a misprint: t4 = t3 + 168 - 360 deg (Eq. 15) and the printed 184.3 of t3 give -7.7"
_PRINTED_ANGLES: tuple[tuple[int, tuple[float, str], tuple[float, str]], ...] = (
    # rod, smallest and largest angle [deg], each with the reason for a difference
    (2, (101.7, ""), (114.3, "")),
    (3, (184.3, ""), (199.4, "")),
    (4, (-7.89, _SWING), (7.38, _CUT)),
    (5, (257.9, _CUT), (258.5, "")),
)


def tufting_rows() -> tuple[PublishedRow, ...]:
    """Compare motion, needle and backing, torques and forces at 160 rpm, and the misprinted equations."""
    machine = tufting()
    groups: dict[str, list[PrintedAndOurs]] = {
        "Angles of the rods": _angles(machine),
        "Needle and backing": _needle(machine),
        "Torques and bearing forces at 160 rpm": _forces(machine),
        "Equations as printed, and as the machine moves": equation_rows(tufting(backing_force_N=0.0), SPEED_RAD_S),
    }
    return in_sections(TUFTING, groups)


def _angles(machine: Machine) -> list[PrintedAndOurs]:
    rows: list[PrintedAndOurs] = []
    for rod, smallest, largest in _PRINTED_ANGLES:
        name = f"theta_{rod}_rad"
        angle = np.degrees(over_a_turn(machine, [name], SPEED_RAD_S, _SAMPLES)[name])
        rows.append((f"t{rod}, smallest", "deg", smallest[0], float(angle.min()), smallest[1]))
        rows.append((f"t{rod}, largest", "deg", largest[0], float(angle.max()), largest[1]))
    return rows


def _needle(machine: Machine) -> list[PrintedAndOurs]:
    speed_deg_s = math.degrees(SPEED_RAD_S)
    step = f"within the {speed_deg_s / SAMPLING_HZ:.2f} deg between two samples of the 500 Hz sensor"
    plane = "the plane of the backing is taken from the two printed angles"
    angle = {event.name: math.degrees(event.angle_rad) for event in machine.events()}

    def depth_mm(*degrees: float) -> list[float]:
        at = at_angles(machine, ["needle_position_m"], SPEED_RAD_S, np.radians(degrees))
        return [metres * 1e3 for metres in at["needle_position_m"].tolist()]

    lowest, highest = depth_mm(angle["needle_largest"], angle["needle_smallest"])
    rows: list[PrintedAndOurs] = [("stroke of the needle", "mm", "about 33", lowest - highest, "")]
    for quantity, printed, _, event in PRINTED_EVENTS:
        reason = ""
        if event in ("needle_largest", "needle_smallest"):
            there, here = depth_mm(printed, angle[event])
            reason = f"{step}; the needle moves {abs(here - there):.3f} mm between the two angles"
        rows.append((quantity, "deg", printed, angle[event], reason))
    for quantity, _, printed_s, event in PRINTED_EVENTS:
        rows.append((f"{quantity}, Fig. 9", "s", printed_s, FIGURE_9_START_S + angle[event] / speed_deg_s, ""))
    stab, leave = depth_mm(22.0, 194.0)
    return [
        *rows,
        ("one turn of the main shaft", "s", 0.375, 360.0 / speed_deg_s, ""),
        ("needle below the driven shaft at 22 deg", "mm", None, stab, plane),
        ("needle below the driven shaft at 194 deg", "mm", None, leave, plane),
        ("needle below the backing, lowest", "mm", None, lowest - machine.parameters["entry_plane_m"] * 1e3, ""),
    ]


def _forces(machine: Machine) -> list[PrintedAndOurs]:
    torques = ["balancing_torque_Nm", "driven_shaft_torque_Nm"]
    parts = [f"torque_{part}_Nm" for part in ("inertial", "gravity", "load")]
    pins = [f"reaction_{pin}_{axis}_N" for pin in "CO" for axis in "xy"]
    turn = over_a_turn(machine, [*torques, *parts, *pins, "equivalent_inertia_kgm2"], SPEED_RAD_S, _SAMPLES)
    balancing, driven = turn["balancing_torque_Nm"], turn["driven_shaft_torque_Nm"]
    inertial, gravity, friction = (turn[part] for part in parts)
    on_c, on_o = (np.hypot(turn[f"reaction_{pin}_x_N"], turn[f"reaction_{pin}_y_N"]) for pin in "CO")

    stab = next(event.angle_rad for event in machine.events() if event.name == "needle_enters_backing")
    beside = at_angles(machine, torques, SPEED_RAD_S, stab + _EITHER_SIDE)
    before, after = beside["balancing_torque_Nm"].tolist()
    driven_at_stab = float(np.abs(beside["driven_shaft_torque_Nm"])[1])
    idle = tufting(backing_force_N=0.0)
    driven_idle = over_a_turn(idle, ["driven_shaft_torque_Nm"], SPEED_RAD_S, _SAMPLES)["driven_shaft_torque_Nm"]
    ratio = float(np.abs(driven).max() / balancing.max())
    return [
        ("driven shaft over main shaft, largest torques", "", "far greater", ratio, ""),
        ("torque on the driven shaft, largest", "N m", None, float(np.abs(driven).max()), ""),
        ("torque on the driven shaft, at the stab", "N m", None, driven_at_stab, ""),
        ("torque on the driven shaft, no friction", "N m", None, span(driven_idle, 2), ""),
        ("balancing torque", "N m", None, span(balancing, 3), ""),
        ("balancing torque, largest", "N m", None, float(balancing.max()), ""),
        ("balancing torque, largest, at", "deg", None, 360.0 * float(balancing.argmax()) / _SAMPLES, ""),
        ("balancing torque just before the stab", "N m", None, before, ""),
        ("balancing torque just after the stab", "N m", None, after, ""),
        ("its inertial part", "N m", None, span(inertial, 3), ""),
        ("its gravity part", "N m", None, span(gravity, 3), ""),
        ("its friction part, largest", "N m", None, float(friction.max()), ""),
        ("inertia that the main shaft feels", "g m^2", None, span(turn["equivalent_inertia_kgm2"] * 1e3, 4), ""),
        ("force on bearing C, largest", "N", None, float(on_c.max()), ""),
        ("force on bearing O, largest", "N", None, float(on_o.max()), ""),
    ]
