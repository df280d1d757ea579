"""Printed numbers of the two beat-up mechanisms and results of their machines."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics import Body
from textile_twin_core.machine.events import crossings
from textile_twin_core.machine.machine import Machine
from textile_twin_core.machines.elliptic_gear_beatup import elliptic_gear_beatup, stretched_angle
from textile_twin_core.machines.handloom_beatup import handloom_beatup
from textile_twin_core.papers.rows import PrintedAndOurs, PublishedRow, at_angles, in_sections, over_a_turn

HANDLOOM = "Topalbekiroglu and Celik 2010"
ELLIPTIC_GEAR = "Zhao, Ren and Chen 2011"

_SAMPLES = 36000
CRANK_RAD_S = 15.5
SPINDLE_RAD_S = 300.0 * math.pi / 30.0
DWELL_START_DEG, DWELL_END_DEG = 92.0, 285.0
WITHIN_M = 0.007
_CAST_IRON_KG_M3, _WIDTH_M, _THICKNESS_M = 7210.0, 0.03, 0.01


def handloom_rows() -> tuple[PublishedRow, ...]:
    """Compare the beater's motion at 15.5 rad/s, and masses and inertias of the links."""
    machine = handloom_beatup()
    parameters = machine.parameters
    names = ("beater_position_m", "beater_velocity_m_s", "beater_acceleration_m_s2")
    position, velocity, acceleration = over_a_turn(machine, names, CRANK_RAD_S, _SAMPLES).values()
    swing = math.degrees(float(np.ptp(position)) / parameters["arm_m"])
    largest, reversed_motion = float(-acceleration.min()), float(acceleration.max())
    motion: list[PrintedAndOurs] = [
        ("swing of the beater", "deg", 30.0, swing, "the lengths are rounded to 0.1 mm"),
        ("largest speed of the beater", "m/s", None, float(np.abs(velocity).max()), ""),
        ("largest acceleration of the beater", "m/s^2", 25.0, largest, ""),
        ("its acceleration at the front dead centre", "m/s^2", None, float(-acceleration[position.argmax()]), ""),
        ("its largest acceleration the other way", "m/s^2", None, reversed_motion, ""),
        ("largest beat-up force", "N", "over 60", parameters["beater_kg"] * largest, ""),
        *_about_beat_up(machine),
    ]
    reasons = {"DC": "printed for a bar 15 mm wide; the text says 30 mm"}
    links: list[PrintedAndOurs] = []
    for link, name in (("DC", "crank"), ("CB", "coupler"), ("AE", "arm")):
        bar = Body.bar(link, parameters[f"{name}_m"], _CAST_IRON_KG_M3, _WIDTH_M, _THICKNESS_M)
        inertia = parameters[f"{name}_kgm2"]
        links.append((f"mass of {link}", "kg", parameters[f"{name}_kg"], bar.mass_kg, ""))
        links.append((f"inertia of {link}", "kg m^2", inertia, bar.inertia_kgm2, reasons.get(link, "")))
    return in_sections(
        HANDLOOM,
        {"Beater at 15.5 rad/s": motion, "Links of cast iron, 7210 kg/m^3, 30 mm x 10 mm": links},
    )


def _about_beat_up(machine: Machine) -> list[PrintedAndOurs]:
    """Compute the crank angles before beat-up of largest speed and largest joint loads; loads exclude weights."""
    (front,) = (event.angle_rad for event in machine.events() if event.name == "beater_largest")
    pins = [f"reaction_{pin}_{axis}_N" for pin in "CB" for axis in "xy"]
    names = ("beater_velocity_m_s", *pins)
    turn = over_a_turn(handloom_beatup(gravity_m_s2=0.0), names, CRANK_RAD_S, _SAMPLES)
    velocity, *loads = turn.values()
    on_c, on_b = np.hypot(*loads[:2]), np.hypot(*loads[2:])

    def before(values: FloatArray) -> str:
        return f"{(math.degrees(front) - 360.0 * int(values.argmax()) / _SAMPLES) % 360.0:.1f} deg before"

    inertia = "inertia alone; the paper does not say how the mechanism stands"
    dead_centre = "at a dead centre, as beat-up is, the speed is zero"
    return [
        ("speed of the beater is largest", "", "about beat-up", before(velocity), dead_centre),
        ("load on joint C is largest", "", "at beat-up", before(on_c), inertia),
        ("load on joint B is largest", "", "at beat-up", before(on_b), inertia),
        ("load on joint C, largest", "N", None, float(on_c.max()), inertia),
        ("load on joint B, largest", "N", None, float(on_b.max()), inertia),
    ]


def elliptic_gear_rows() -> tuple[PublishedRow, ...]:
    """Compare the gears, and the sley's motion at 300 rpm; accelerations at beat-up are towards the rear."""
    machine = elliptic_gear_beatup()
    gears: list[PrintedAndOurs] = [
        ("speed of gear 2 over gear 1, smallest", "", None, _gear_ratio(machine)[0], ""),
        ("speed of gear 2 over gear 1, largest", "", None, _gear_ratio(machine)[1], ""),
        (
            "Eq. 18, 19: sley in terms of t3",
            "",
            "cos(t3 - pi/2)",
            "cos(t3 + pi/2)",
            "the sign that Eq. 17 has as its derivatives",
        ),
    ]
    return in_sections(
        ELLIPTIC_GEAR,
        {"Gears and equations": gears, "Sley at beat-up, 300 rpm": _front_rows(machine), "Dwell": _dwell_rows(machine)},
    )


def dwell_rad(machine: Machine, within_m: float = WITHIN_M) -> tuple[float, float]:
    """Find the shaft angles between which the sley stays within a distance of its rear point [rad]."""
    rising, falling = crossings(machine.model.output("sley_position_m") - within_m)
    return falling[0], rising[0]


def _front_rows(machine: Machine) -> list[PrintedAndOurs]:
    parameters = machine.parameters
    crank, coupler, rocker, ground = (parameters[f"{name}_m"] for name in ("crank", "coupler", "rocker", "ground"))
    position, at_front = _front(machine)
    chord = 2.0 * parameters["sley_m"] * math.sin(position / parameters["sley_m"] / 2.0)
    before = elliptic_gear_beatup(past_largest_ratio_rad=-parameters["past_largest_ratio_rad"])
    names = ("sley_acceleration_m_s2",)
    peak_before = float(np.abs(over_a_turn(before, names, SPINDLE_RAD_S, _SAMPLES)[names[0]]).max())
    more_open = _front(elliptic_gear_beatup(axis_ratio=0.90))[1] / at_front
    front_angle = math.degrees(stretched_angle(crank, coupler, rocker, ground))
    nowhere = "not reproduced: no sense, role or component of the two printed angles gives it"
    dwell = "not the default: the printed dwell needs 4 deg past it"
    return [
        ("largest displacement of the sley", "mm", 85.0, position * 1e3, ""),
        ("the same as a chord", "mm", None, chord * 1e3, ""),
        ("acceleration of the sley at beat-up, 300 rpm", "m/s^2", 615.8434, at_front, nowhere),
        ("its peak, gears 4 deg before their top ratio", "m/s^2", None, peak_before, dwell),
        ("angle from AD to the crank, sley in front", "deg", None, front_angle, "crank and coupler are stretched"),
        (
            "acceleration at beat-up, k = 0.90 over k = 0.85",
            "",
            "below 1, above 1",
            more_open,
            "below 1 by section 3.1, above 1 by 3.2; 3.1 is right",
        ),
    ]


def _dwell_rows(machine: Machine) -> list[PrintedAndOurs]:
    start, end = dwell_rad(machine)
    longer = dwell_rad(elliptic_gear_beatup(axis_ratio=0.90))
    why = "here: within 7 mm of the rear point; the paper does not say what it calls dwell"
    printed = np.radians([DWELL_START_DEG, DWELL_END_DEG])
    gaps = at_angles(machine, ["sley_position_m"], SPINDLE_RAD_S, printed)["sley_position_m"] * 1e3
    return [
        ("start of the dwell at the rear", "deg", DWELL_START_DEG, math.degrees(start), why),
        ("end of the dwell at the rear", "deg", DWELL_END_DEG, math.degrees(end), why),
        ("dwell at the rear", "deg", "close to 200", math.degrees(end - start), "the printed ends are 193 deg apart"),
        ("sley before its rear point at 92 deg", "mm", None, float(gaps[0]), ""),
        ("sley before its rear point at 285 deg", "mm", None, float(gaps[1]), ""),
        (
            "dwell, k = 0.90 over k = 0.85",
            "",
            "below 1, above 1",
            (longer[1] - longer[0]) / (end - start),
            "below 1 by section 3.1, above 1 by 3.2; 3.1 is right",
        ),
    ]


def _gear_ratio(machine: Machine) -> tuple[float, float]:
    """Compute the smallest and largest speed of gear 2 over that of gear 1."""
    name = "omega_gear_2_rad_s"
    ratio = np.abs(over_a_turn(machine, (name,), 1.0, _SAMPLES)[name])
    return float(ratio.min()), float(ratio.max())


def _front(machine: Machine) -> tuple[float, float]:
    """Compute the sley's position [m] and rearward acceleration [m/s^2] at the front dead centre, theta = 0."""
    names = ("sley_position_m", "sley_acceleration_m_s2")
    turn = over_a_turn(machine, names, SPINDLE_RAD_S, 1)
    position, acceleration = (float(turn[name][0]) for name in names)
    return position, -acceleration
