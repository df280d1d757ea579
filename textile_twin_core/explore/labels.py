"""Labels of numbers on the page, their display units, and the values printed in the papers."""

from __future__ import annotations

import math
import re
from typing import NamedTuple


class Label(NamedTuple):
    """Text, unit and factor from SI."""

    text: str
    unit: str
    factor: float = 1.0


_DEGREES = 180.0 / math.pi
_OF_MEASURES = {
    "stroke_m": Label("stroke", "mm", 1e3),
    "dwell_rad": Label("dwell at the rear", "deg", _DEGREES),
    "largest_speed_m_s": Label("largest speed", "m/s"),
    "largest_acceleration_m_s2": Label("largest acceleration", "m/s²"),
    "front_acceleration_m_s2": Label("acceleration at the front", "m/s²"),
}
_OTHERS = {
    "smallest_transmission_angle_rad": Label("smallest transmission angle", "deg", _DEGREES),
    "crank_over_coupler": Label("crank over coupler, r/l", ""),
    "peak_torque_Nm": Label("peak torque", "N m"),
    "rms_torque_Nm": Label("RMS torque", "N m"),
    "torque_ripple_Nm": Label("torque ripple", "N m"),
    "largest_shaking_force_N": Label("largest shaking force", "N"),
    "rms_shaking_force_N": Label("RMS shaking force", "N"),
    "first_natural_frequency_Hz": Label("first natural frequency of the shaft", "Hz"),
    "largest_reaction_N": Label("largest reaction", "N"),
    "element_2_largest_deceleration_m_s2": Label("largest deceleration of element 2", "m/s²"),
    "element_2_largest_deceleration_s": Label("time of this deceleration", "ms", 1e3),
    "pad_reached_s": Label("pad reached at", "ms", 1e3),
    "collets_meet_s": Label("elements 2 and 3 meet at", "ms", 1e3),
    "element_2_off_the_pin_m": Label("element 2 leaves the pin by", "mm", 1e3),
    "impacts": Label("impacts in a cycle", ""),
    "energy_lost_J": Label("energy lost in them", "J"),
}
_CRITICAL = re.compile(r"critical_speed_order_(\d+)_mode_(\d+)_rad_s")
PRINTED: dict[str, dict[str, str]] = {
    "tufting": {"needle_stroke_m": "about 33"},
    "handloom_beatup": {
        "beater_largest_acceleration_m_s2": "25",
        "crank_over_coupler": "0.30",
        "smallest_transmission_angle_rad": "67.24",
    },
    "elliptic_gear_beatup": {
        "sley_stroke_m": "85",
        "sley_dwell_rad": "close to 200",
        "sley_front_acceleration_m_s2": "615.8434",
    },
    "needle_transfer": {
        "pad_reached_s": "15.75",
        "element_2_largest_deceleration_s": "16.10",
        "collets_meet_s": "19.23",
    },
}
"""Printed values by machine and number, in the display unit, for the parameters and speed of the paper."""


def label(number: str) -> Label:
    """Return the label of a number."""
    if number in _OTHERS:
        return _OTHERS[number]
    for ending, found in _OF_MEASURES.items():
        if number.endswith(f"_{ending}"):
            return found._replace(text=f"{number.removesuffix(ending).strip('_').replace('_', ' ')} {found.text}")
    critical = _CRITICAL.fullmatch(number)
    if critical:
        order, mode = critical.groups()
        return Label(f"critical speed, order {order} meets mode {mode}", "rpm", 30.0 / math.pi)
    return Label(number, "")


_UNITS = {"m": ("mm", 1e3), "rad": ("deg", _DEGREES)}


def shown_unit(unit: str) -> tuple[str, float]:
    """Return the display unit of a parameter in this SI unit, and its factor."""
    return _UNITS.get(unit, (unit, 1.0))
