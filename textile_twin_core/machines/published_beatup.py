"""What the papers print of the two beat-up mechanisms, beside what their machines give."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.dynamics import Body
from textile_twin_core.machines.elliptic_gear_beatup import elliptic_gear_beatup, stretched_angle
from textile_twin_core.machines.events import crossings
from textile_twin_core.machines.handloom_beatup import handloom_beatup
from textile_twin_core.machines.machine import Machine
from textile_twin_core.machines.published import PublishedRow, over_a_turn

HANDLOOM = "Topalbekiroglu and Celik 2010"
ELLIPTIC_GEAR = "Zhao, Ren and Chen 2011"

_SAMPLES = 36000
_CRANK_RAD_S = 15.5
_SPINDLE_RAD_S = 300.0 * math.pi / 30.0
_CAST_IRON_KG_M3, _WIDTH_M, _THICKNESS_M = 7210.0, 0.03, 0.01


def handloom_rows() -> tuple[PublishedRow, ...]:
    """Motion of the beater at 15.5 rad/s, and masses and inertias of the links."""
    machine = handloom_beatup()
    parameters = machine.parameters
    turn = over_a_turn(machine, ("beater_position_m", "beater_acceleration_m_s2"), _CRANK_RAD_S, _SAMPLES)
    swing = math.degrees(float(turn["beater_position_m"].max()) / parameters["arm_m"])
    acceleration = float(np.abs(turn["beater_acceleration_m_s2"]).max())
    rows: list[tuple[str, str, float | str, float, str]] = [
        ("swing of the beater", "deg", 30.0, swing, "the lengths are rounded to 0.1 mm"),
        ("largest acceleration of the beater", "m/s^2", 25.0, acceleration, "rounded in print"),
        ("largest beat-up force", "N", "over 60", parameters["beater_kg"] * acceleration, ""),
    ]
    reasons = {
        "crank": "printed for a bar 15 mm wide; the text says 30 mm",
        "coupler": "rounded in print",
        "arm": "rounded in print",
    }
    for link, name in (("DC", "crank"), ("CB", "coupler"), ("AE", "arm")):
        bar = Body.bar(link, parameters[f"{name}_m"], _CAST_IRON_KG_M3, _WIDTH_M, _THICKNESS_M)
        rows.append((f"mass of {link}", "kg", parameters[f"{name}_kg"], bar.mass_kg, ""))
        rows.append((f"inertia of {link}", "kg m^2", parameters[f"{name}_kgm2"], bar.inertia_kgm2, reasons[name]))
    return tuple(PublishedRow(HANDLOOM, *row) for row in rows)


def elliptic_gear_rows() -> tuple[PublishedRow, ...]:
    """Motion of the sley at 300 rpm; accelerations are those of the front dead centre, towards the rear."""
    machine = elliptic_gear_beatup()
    parameters = machine.parameters
    sizes = (parameters[f"{name}_m"] for name in ("crank", "coupler", "rocker", "ground"))
    front_angle = math.degrees(stretched_angle(*sizes))
    largest, at_front = _front(parameters["axis_ratio"])
    start, end = dwell_rad(machine)
    dwell = "within 7 mm of the rear point; the paper does not say what it calls dwell"
    rows = (
        ("largest displacement of the sley", "mm", 85.0, largest * 1e3, "rounded in print"),
        (
            "acceleration of the sley at beat-up, 300 rpm",
            "m/s^2",
            615.8434,
            at_front,
            "no sense or role of the two printed angles gives the printed value",
        ),
        ("start of the dwell at the rear", "deg", 92.0, math.degrees(start), dwell),
        ("end of the dwell at the rear", "deg", 285.0, math.degrees(end), dwell),
        ("dwell at the rear", "deg", "close to 200", math.degrees(end - start), dwell),
        (
            "angle from AD to the crank, sley in front",
            "deg",
            None,
            front_angle,
            "not in print; crank and coupler are stretched there",
        ),
        (
            "acceleration at beat-up, k = 0.90 over k = 0.85",
            "",
            "below 1 (3.1), above 1 (3.2)",
            _front(0.90)[1] / at_front,
            "the paper contradicts itself",
        ),
    )
    return tuple(PublishedRow(ELLIPTIC_GEAR, *row) for row in rows)


def dwell_rad(machine: Machine, within_m: float = 0.007) -> tuple[float, float]:
    """Shaft angles between which the sley stays within a distance of its rear point [rad]."""
    rising, falling = crossings(machine.model.output("sley_position_m") - within_m)
    return falling[0], rising[0]


def _front(axis_ratio: float) -> tuple[float, float]:
    """Position [m] and acceleration towards the rear [m/s^2] of the sley at the front dead centre, theta = 0."""
    names = ("sley_position_m", "sley_acceleration_m_s2")
    turn = over_a_turn(elliptic_gear_beatup(axis_ratio=axis_ratio), names, _SPINDLE_RAD_S, 1)
    position, acceleration = (float(turn[name][0]) for name in names)
    return position, -acceleration
