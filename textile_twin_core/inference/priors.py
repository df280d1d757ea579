"""Priors of the numbers of a machine file, by kind."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics.loads import Backing, ShaftFriction
from textile_twin_core.errors import MachineError
from textile_twin_core.inference.elastic_torque import shaft_values
from textile_twin_core.inference.parameter import (
    BUTTERWORTH,
    COULOMB,
    DELAY,
    DRIFT,
    ECCENTRIC,
    GAIN,
    HELD,
    HIGH_PASS,
    LOW_PASS,
    MOTION,
    OF_LOAD,
    OFFSET,
    ROTOR,
    VISCOUS,
    ZERO,
    ModelParameter,
)
from textile_twin_core.inference.record import Ripple
from textile_twin_core.machine import Machine
from textile_twin_core.machine.slots import Slot, read, slots
from textile_twin_core.mechanism import MAIN_SHAFT


@dataclass(frozen=True)
class Prior:
    """Tolerance, departure and its probability, and the threshold of a kind, as multiples of the kind's scale.

    widest: largest standard deviation of a departure, if mistakes several times the usual size occur; 0: `departure`.
    """

    tolerance: float
    departure: float
    probability: float
    threshold: float
    widest: float = 0.0


PRIORS: Mapping[str, Prior] = {
    # Sensors. An encoder is set to a tenth of a degree, or stays as it was mounted.
    "zero": Prior(1e-3, 1.8, 0.05, math.radians(0.3)),
    # Stamps of one clock agree to tens of microseconds; filters and buses delay by milliseconds.
    "delay": Prior(5e-5, 8e-3, 0.05, 3e-4, 0.03),
    # Quartz clocks agree to a few parts per million; clocks that are not disciplined drift by up to a thousandth.
    "drift": Prior(2e-6, 5e-4, 0.01, 2e-5),
    # Torque sensors are calibrated and mounted to a per cent; a wrong range or bridge factor changes tens of per cent.
    "gain": Prior(0.01, 0.2, 0.05, 0.02),
    # Couplings and wheels that run out by a hundredth of their radius give ten milliradians.
    "eccentricity": Prior(1e-3, 0.01, 0.05, 2e-3),
    # Time constants of a sensor's low pass, and the corner of an amplifier that blocks the mean [Hz].
    "low_pass": Prior(1e-5, 0.02, 0.05, 5e-4, 0.1),
    "high_pass": Prior(1e-4, 0.5, 0.01, 0.01, 2.0),
    # Of the working torque: zero drift of a strain gauge, and a bridge that was not balanced.
    "offset": Prior(0.01, 0.15, 0.03, 0.015),
    # Of the working torque: bearings of a machine that runs warm, and friction that the file leaves out; a light rotor
    # may have several times the torque that its file gives.
    "coulomb": Prior(0.01, 0.15, 0.05, 0.015, 5.0),
    "viscous": Prior(0.01, 0.15, 0.03, 0.015, 5.0),
    # Of the working torque: dry friction and a brake hold a standing shaft.
    "held": Prior(1e-3, 0.15, 0.005, 0.015),
    # Of the mean inertia: couplings; a motor's rotor or a flywheel may weigh many times the linkage.
    "rotor": Prior(3e-3, 0.3, 0.02, 0.02, 30.0),
    # Of the force: cloth and yarn vary by per cents; another quality by tens of per cent.
    "force": Prior(0.05, 0.3, 0.03, 0.04),
    "free_force": Prior(0.002, 0.03, 0.01, 0.01),
    "spring": Prior(0.02, 0.3, 0.02, 0.06),
    "preload": Prior(3e-3, 0.1, 0.005, 0.02),
    # Any other number of a load: friction of a joint, damping, the drag of a load of a user's own.
    "load": Prior(0.05, 0.5, 0.01, 0.1),
    # Plane of the backing [m]: set with a gauge, or not at all.
    "plane": Prior(5e-5, 2e-3, 0.01, 3e-4),
    # Bodies: weighed or taken from a drawing; a part that was exchanged or forgotten changes more.
    "mass": Prior(0.01, 0.25, 0.002, 0.04),
    "inertia": Prior(0.02, 0.4, 0.002, 0.08),
    "centroid": Prior(0.005, 0.08, 0.002, 0.02),
    # Lengths: measured between pins to half a per mille; ground points [m] with a rule.
    "length": Prior(5e-4, 0.02, 0.002, 3e-3),
    "ground": Prior(1e-4, 3e-3, 0.001, 1e-3),
    "angle": Prior(2e-3, 0.05, 0.001, 0.01),
    # An elastic shaft: its stiffness follows from a drawing, its damping from a guess; a drive's slip from its load.
    "stiffness": Prior(5e-3, 0.1, 0.05, 0.01),
    "damping": Prior(0.1, 0.5, 0.05, 0.1),
    "drive": Prior(0.02, 0.3, 0.03, 0.04),
    "slip": Prior(0.05, 0.5, 0.03, 0.1),
}
"""Standard deviations, relative where the kind's numbers have a size of their own."""

_OF_ATTRIBUTE = {
    "mass_kg": "mass",
    "inertia_kgm2": "inertia",
    "centroid": "centroid",
    "length_m": "length",
    "lengths_m": "length",
    "axis_ratio": "length",
    "radius_m": "length",
    "guide_point_m": "ground",
    "guides": "ground",
    "offset_m": "ground",
    "angle_rad": "angle",
    "slot_angle_rad": "angle",
    "phase_rad": "angle",
    "stiffness_N_m": "spring",
    "stiffness_Nm_rad": "spring",
    "free_length_m": "preload",
    "free_angle_rad": "preload",
    "entry_plane_m": "plane",
    "exit_plane_m": "plane",
}
_CONFIGURED_FILTER = 0.05
"""Relative tolerance of a filter that the machine file states, as of its capacitors and resistors."""
_RESOLVED = 0.1
"""Uncertainty of an order's acceleration, over its torque, below which the encoder resolves it."""
_MOST_RIPPLE, _FELT = 16, 2e-3
"""Most orders of the ripple in a fit; their least torque over the working torque."""
_RELATIVE = ("mass", "inertia", "length", "spring", "load", "force")
_NO_SIZE = 1e-50
"""Size below which a number has no relative tolerance, and no effect."""
_SHORTEST = 0.8
"""Least length over its nominal value: a linkage of shorter lengths is another machine."""
_LEAST_OF_SHAFT = 0.1
"""Least stiffness, damping and drive over the nominal one."""
_NOT_NEGATIVE = ("mass", "inertia", "spring", "load", "force", "free_force")
_OF_UNIT = {"kg": "mass", "kg m2": "inertia", "m": "length", "rad": "angle"}
"""Kind of a number whose name is not in `_OF_ATTRIBUTE`, by its unit; in a load `load` for any other unit."""
_UNIT = re.compile(r"(kg|rad|Pa|Hz|N|J|W|m|s)(\d?)")
"""Unit in the last parts of a name, the first over the others, as `drag_Ns2_m2`."""


@dataclass(frozen=True)
class WorkingPoint:
    """Scales of a machine at work: torque [N m], speed [rad/s], and mean inertia of the shaft [kg m2]."""

    torque_Nm: float
    speed_rad_s: float
    inertia_kgm2: float


def parameters(machine: Machine, point: WorkingPoint) -> tuple[tuple[ModelParameter, ...], dict[str, Slot]]:
    """List the numbers on which a machine's torque depends, and the slots of those in its declaration.

    Args:
        machine: the machine.
        point: its scales at work.
    """
    frictions = [load for load in machine.loads if isinstance(load, ShaftFriction)]
    rotor = sum(body.inertia_kgm2 for body in machine.bodies if body.is_flywheel)
    torque, speed, inertia = point.torque_Nm, point.speed_rad_s, point.inertia_kgm2
    own = [
        _of("zero", ZERO, 0.0, 1.0, "rad"),
        _of("delay", DELAY, 0.0, 1.0, "s"),
        _of("drift", DRIFT, 0.0, 1.0, "s/s"),
        _of("gain", GAIN, 0.0, 1.0, ""),
        _of("offset", OFFSET, 0.0, torque, "N m"),
        _of("coulomb", COULOMB, sum(load.coulomb_Nm for load in frictions), torque, "N m", 0.0),
        _of("viscous", VISCOUS, sum(load.viscous_Nms for load in frictions), torque / speed, "N m s", 0.0),
        _of("held", HELD, 0.0, torque, "N m"),
        _of("rotor", ROTOR, rotor, inertia, "kg m2", 0.0),
        *chain_parameters(machine),
    ]
    values, held = read(machine), {}
    for slot in slots(machine):
        kind = _kind(machine, slot)
        value = values[slot.name]
        if not kind or (abs(value) < _NO_SIZE and kind in _RELATIVE):
            continue
        scale = abs(value) if kind in _RELATIVE else 1.0
        if kind == "free_force":
            scale = machine.loads[int(slot.entry)].force_N  # type: ignore[attr-defined]
            if abs(scale) < _NO_SIZE:
                continue
        name, low = slot.path, 0.0 if kind in _NOT_NEGATIVE else -math.inf
        if kind == "length":
            low = _SHORTEST * value
        own.append(_of(kind, name, value, scale, _unit(slot), low))
        held[name] = slot
    return tuple(_with_tolerance(machine, known) for known in _checked(machine, own)), held


def shaft_parameters(machine: Machine, learned: bool) -> tuple[ModelParameter, ...]:
    """Parameters of an elastic shaft; `learned`: its drive is estimated from the record, and departs from no file."""
    kinds = ("stiffness", "N m/rad"), ("damping", "N m s/rad"), ("drive", "kg m2"), ("slip", "N m s/rad")
    out = []
    for (name, value), (kind, unit) in zip(shaft_values(machine).items(), kinds, strict=True):
        if value > 0.0:
            p = _of(kind, name, value, value, unit, _LEAST_OF_SHAFT * value)
            free = learned and kind in ("drive", "slip")
            out.append(replace(p, tolerance=p.departure, probability=0.0) if free else p)
    return tuple(out)


def chain_parameters(machine: Machine) -> list[ModelParameter]:
    """Parameters of the measuring chain; the eccentricity's are departures from the configured one."""
    sensor = machine.sensors.torque
    first, corner = sensor.low_pass_s, sensor.low_pass_hz
    if corner and sensor.low_pass_order == 1:
        first, corner = 1.0 / (2.0 * math.pi * corner), 0.0
    second = 1.0 / (2.0 * math.pi * corner) if corner else 0.0
    own = [
        _of("low_pass", LOW_PASS, first, 1.0, "s", 0.0),
        _of("low_pass", BUTTERWORTH, second, 1.0, "s", 0.0),
        _of("high_pass", HIGH_PASS, sensor.high_pass_hz, 1.0, "Hz", 0.0),
    ]
    own = [replace(p, tolerance=max(p.tolerance, _CONFIGURED_FILTER * p.nominal)) for p in own]
    for name in ECCENTRIC:
        cosine = _of("eccentricity", name, 0.0, 1.0, "rad")
        own += [cosine, replace(cosine, name=f"{name}.sine", leader=name)]
    return own


def uncertain_ripple(
    ripple: Ripple, torque_Nm: FloatArray, inertia_kgm2: float, speed_rad_s: float, working_torque_Nm: float
) -> tuple[tuple[ModelParameter, ...], float]:
    """Parameters of the orders of the shaft's ripple that the encoder leaves uncertain and the torque feels.

    A ripple is no larger than the torque of its order can accelerate the shaft, twice over; where the orders that the
    encoder resolves follow the torque less, as under a controller of the speed, the others do, too. No order departs:
    its tolerance is all that is known of it.

    Args:
        ripple: of the motion.
        torque_Nm: (k,) amplitude of the machine's torque at constant speed by order.
        inertia_kgm2: mean inertia of the shaft. speed_rad_s: working speed. working_torque_Nm: scale of the torque.

    Returns:
        The parameters, and the root mean square of the torque that all uncertain orders make [N m].
    """
    order = np.arange(1, ripple.sigma_rad.size + 1)
    stiffness, torque = (
        inertia_kgm2 * (order * speed_rad_s) ** 2,
        torque_Nm[: order.size],
    )  # stiffness: torque per angle
    resolved = stiffness * ripple.sigma_rad < _RESOLVED * torque
    power = float(np.sum(torque[resolved] ** 2))
    follows = math.sqrt(float(np.sum((inertia_kgm2 * ripple.swing_rad_s2[resolved]) ** 2)) / power) if power else 1.0
    sigma = np.minimum(ripple.sigma_rad, 2.0 * min(follows, 1.0) * torque / stiffness)
    felt = stiffness * sigma
    chosen = [k for k in np.argsort(-felt)[:_MOST_RIPPLE].tolist() if felt[k] > _FELT * working_torque_Nm]
    out = []
    for k in sorted(chosen):
        size = float(sigma[k])
        for name in (f"{MOTION}{order[k]}", f"{MOTION}{order[k]}{OF_LOAD}"):
            cosine = ModelParameter(name, "motion", 0.0, size, size, size, 0.0, math.inf, "rad")
            out += [cosine, replace(cosine, name=f"{name}.sine", leader=name)]
    return tuple(out), float(np.sqrt(np.sum(felt**2)))


def _checked(machine: Machine, known: list[ModelParameter]) -> list[ModelParameter]:
    """Return the parameters; raise MachineError if the machine states a tolerance of any other number."""
    names = {parameter.name: parameter for parameter in known}
    for path in machine.tolerances:
        if path not in names or names[path].nominal == 0.0:
            near = get_close_matches(path, names, n=3) or list(names)[:6]
            raise MachineError(
                f"machine '{machine.name}': tolerances.{path}: the torque depends on no number of this name that is"
                f" not 0; did you mean {' or '.join(near)}?"
            )
    return known


def _with_tolerance(machine: Machine, known: ModelParameter) -> ModelParameter:
    """Return a parameter with the tolerance that the machine states for it, if any."""
    relative = machine.tolerances.get(known.name)
    return known if relative is None else replace(known, tolerance=relative * abs(known.nominal))


def _of(kind: str, name: str, nominal: float, scale: float, unit: str, low: float = -math.inf) -> ModelParameter:
    p = PRIORS[kind]
    return ModelParameter(
        name,
        kind,
        nominal,
        p.tolerance * scale,
        p.departure * scale,
        max(p.widest, p.departure) * scale,
        p.probability,
        p.threshold * scale,
        unit,
        low,
    )


def _kind(machine: Machine, slot: Slot) -> str:
    """Key of the table of priors; empty for a number without effect on the torque, or which is a parameter already."""
    part = machine.loads[int(slot.entry)] if slot.field == "loads" else None
    if (
        isinstance(part, ShaftFriction)
        or slot.name.startswith(f"{MAIN_SHAFT}.")
        or slot.name.startswith(f"{MAIN_SHAFT}#")
    ):
        return ""
    if isinstance(part, Backing):
        return {"force_N": "force", "free_force_N": "free_force"}.get(slot.attribute, "plane")
    if slot.field == "points":
        return "ground"
    if slot.attribute in _OF_ATTRIBUTE:
        return _OF_ATTRIBUTE[slot.attribute]
    return _OF_UNIT.get(_unit(slot), "load" if part is not None else "")


def _unit(slot: Slot) -> str:
    """Unit of a number by its name."""
    if slot.attribute == "centroid":
        return "lengths"
    units: list[str] = []
    for part in reversed(slot.name.rsplit(".", 1)[-1].split("_")[1:]):
        found = _UNIT.findall(part)
        if "".join(map("".join, found)) != part:
            break
        units.insert(0, " ".join(map("".join, found)))
    return "/".join(units)
