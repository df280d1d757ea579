"""Balancing on the page: the balanced machine, and a sentence with the values before and after."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import SceneError
from textile_twin_core.explore.design import Design
from textile_twin_core.machine import Machine
from textile_twin_core.synthesis.balancing import WAYS, balancing_spring, counterweights, flywheel, opposed_linkages


def balanced(design: Design, method: str, ripple: float = 0.02) -> tuple[Design, str]:
    """Balance the design by one of the methods in `WAYS`, and describe the change in a sentence.

    Raises:
        MachineError: The machine cannot be balanced by this method.
        SceneError: The method is unknown, or the machine is not a linkage.
    """
    machine, speed = design.machine(), design.speed_rad_s
    if not isinstance(machine, Machine):
        raise SceneError(f"machine '{machine.name}' is not a linkage; balancing needs one")
    made, said = _balanced(machine, speed, method, ripple)
    return _as_design(design, made), said


def _balanced(machine: Machine, speed: float, method: str, ripple: float) -> tuple[Machine, str]:
    match method:
        case "counterweight" | "force":
            aim: Any = "gravity_torque" if method == "counterweight" else "shaking_force"
            found = counterweights(machine, None, aim, speed_rad_s=speed)
            weight, unit = found.weights[0], "N m" if method == "counterweight" else "N"
            place = (
                f"{weight.mass_kg:.4g} kg at {1e3 * weight.radius_m:.4g} mm, {math.degrees(weight.angle_rad):.2f} deg"
            )
            before, after = found.rms
            rms = f"{before:.4g} to {after:.4g} {unit}"
            return (
                found.machine,
                f"Counterweight on {weight.link}: {place} from the link. RMS {aim.replace('_', ' ')} {rms}.",
            )
        case "spring":
            sprung = balancing_spring(machine, speed)
            spring = sprung.spring
            what = f"{spring.stiffness_N_m:.4g} N/m, free length {1e3 * spring.free_length_m:.4g} mm"
            rms = f"{_rms(sprung.before_Nm):.4g} to {_rms(sprung.after_Nm):.4g} N m at this speed"
            return sprung.machine, f"Spring from {spring.from_point} to {spring.to_point}: {what}. RMS torque {rms}."
        case "second-linkage":
            phased = opposed_linkages(machine, None, speed)
            rms = f"{_rms(phased.together_Nm):.4g} N m in step, {_rms(phased.apart_Nm):.4g} N m so"
            return (
                phased.machine,
                f"Second linkage {math.degrees(phased.phase_rad):.2f} deg ahead. RMS inertial torque {rms}.",
            )
        case "flywheel":
            wheel = flywheel(machine, ripple, speed)
            change = f"{100.0 * wheel.ripple_before:.3g} % to {100.0 * wheel.ripple_after:.3g} %"
            return (
                wheel.machine,
                f"Flywheel of {wheel.inertia_kgm2:.4g} kg m². Speed ripple {change} under a constant torque.",
            )
        case _:
            raise SceneError(f"there is no balancing method '{method}'; choose one of {', '.join(WAYS)}")


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _as_design(design: Design, machine: Machine) -> Design:
    fresh = Design.of(machine)
    return Design(fresh.family, design.speed_rad_s, {}, design.dwell_within_m)
