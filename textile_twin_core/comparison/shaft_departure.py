"""Departure of an elastic shaft from its machine file: stiffness, damping or drive that explain far more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from textile_twin_core.comparison.causes import Cause
from textile_twin_core.comparison.readings import Readings
from textile_twin_core.comparison.shaft_identification import (
    DAMPING,
    INERTIA,
    SLIP,
    STIFFNESS,
    ShaftIdentification,
    fit_shaft,
    scan_shaft,
    shaft_values,
)
from textile_twin_core.comparison.stage import Begin, unheard
from textile_twin_core.driveline import elastic_shaft, find_resonances
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Machine

_MOST_ANGLES = 6000
"""Angles of the middle of a recording that are used: 25 stiffnesses and 5 dampings then cost about 2 s."""
_FAR_BETTER = 0.5
"""Share of the residual that another shaft must leave: errors of the sensors leave more at any stiffness."""
_SHOWN, _CERTAIN = 0.01, 3.0
"""Relative change, and standard deviations, from both of which a parameter is named."""
_WORDS = {STIFFNESS: "stiffness", DAMPING: "damping", INERTIA: "inertia of the drive", SLIP: "slip of the drive"}
_UNITS = {STIFFNESS: "N m/rad", DAMPING: "N m s/rad", INERTIA: "kg m2", SLIP: "N m s/rad"}


def shaft_departure(readings: Readings, machine: Machine, begin: Begin = unheard) -> ShaftIdentification | None:
    """Identify the shaft if its machine file leaves at least twice the residual of the best other shaft.

    Args:
        readings: The recording; its middle is used.
        machine: Its machine with an elastic shaft.
        begin: Called at each stage.

    Returns:
        The identified shaft, or None where the file's is as good, where no number of the shaft departs from the file's,
        or where the recording is too short.
    """
    try:
        scan = scan_shaft(_middle(readings), machine, begin)
    except RecordingError:  # too short, or the state of the shaft does not settle
        return None
    found = fit_shaft(scan, begin) if scan.share < _FAR_BETTER else None
    return found if found is not None and _departing(found, machine) else None


def shaft_cause(found: ShaftIdentification, machine: Machine) -> Cause:
    """Cause for the verdict: what of the shaft departs from its machine file."""
    speed = machine.nominal_speed_rad_s
    first_Hz = find_resonances(elastic_shaft(found.machine), (0.5 * speed, speed)).modes[0].damped_Hz
    wrong = _departing(found, machine)
    stiffness = found.parameters[STIFFNESS]
    text = (
        f"the elastic shaft of the machine file is wrong: {', '.join(wrong)}; first natural frequency"
        f" {first_Hz:.1f} Hz; `identify --out` writes it, and the rest is judged with it"
    )
    value = {"first_mode_Hz": first_Hz, "stiffness_Nm_rad": stiffness.value}
    return Cause("elastic_shaft", text, value, stiffness.sigma, "shaft.pieces.0.stiffness_Nm_rad")


def _departing(found: ShaftIdentification, machine: Machine) -> list[str]:
    """Numbers of the shaft that depart from those of the machine file, in words."""
    configured, wrong = shaft_values(machine), []
    for name, each in found.parameters.items():
        known = configured[name]
        if known == 0.0 or abs(each.value - known) > max(_SHOWN * known, _CERTAIN * each.sigma):
            wrong.append(f"{_WORDS[name]} {each.value:.4g} +- {each.sigma:.2g} {_UNITS[name]} instead of {known:.4g}")
    return wrong


def _middle(readings: Readings) -> Readings:
    stamps = readings.angle_stamps_ns
    if stamps.size <= _MOST_ANGLES:
        return readings
    first = (stamps.size - _MOST_ANGLES) // 2
    rows = slice(first, first + _MOST_ANGLES)
    torques = slice(*np.searchsorted(readings.torque_stamps_ns, stamps[[first, first + _MOST_ANGLES - 1]]).tolist())
    return replace(
        readings,
        angle_stamps_ns=stamps[rows],
        angle=readings.angle[rows],
        torque_stamps_ns=readings.torque_stamps_ns[torques],
        torque=readings.torque[torques],
        velocities=None if readings.velocities is None else readings.velocities[rows],
    )
