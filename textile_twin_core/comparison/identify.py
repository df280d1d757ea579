"""Identify: forces, friction, event angles, inertia and sensors of a machine from one recording."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.comparison.assess import assess
from textile_twin_core.comparison.bootstrap import Estimate, estimate, moves_of
from textile_twin_core.comparison.event_angle import BesideEvent, EventAngle, event_angle
from textile_twin_core.comparison.explain import Explanation
from textile_twin_core.comparison.identifiable import NotIdentifiable, identifiable
from textile_twin_core.comparison.identified_machine import identified_machine
from textile_twin_core.comparison.readings import Readings
from textile_twin_core.comparison.result import plain
from textile_twin_core.comparison.settings_fit import HUBER, robust_scale
from textile_twin_core.comparison.torque_model import DELAY, EVENTS, GAIN, NOT_NEGATIVE, OFFSET, ZERO, TorqueModel
from textile_twin_core.comparison.unmodelled import UnmodelledTorque, unmodelled_torque
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Machine

GIVEN_UP_FIRST = (OFFSET, ZERO, "shaft_viscous_Nms", "added_inertia_kgm2", "free_force_N", DELAY)
"""The order in which parameters are given up whose effects look the same."""
_WRONG_FIRST = ("encoder_direction", "encoder_ratio", "angle_unit", "angle_rate", "torque_sign", "torque_unit")
_ALL_SAMPLES = 40_000
_FIRST_SPREAD_RAD, _WIDEST_RAD, _REACH_RAD = math.radians(0.12), math.radians(2.0), math.radians(1.0)
_ONE_AT_ONE_SPEED = {ZERO: DELAY, "shaft_viscous_Nms": "shaft_coulomb_Nm"}
_SCAN_RAD = 0.2
_LEFT_BY_LOADS = 0.15
_FEW_STEPS, _MANY_STEPS = 8, 25


@dataclass(frozen=True)
class Identification:
    """What a recording tells of a machine.

    Attributes:
        parameters: by name, those that were fitted. fixed: by name, those that stay as configured.
        not_identifiable: those that this record cannot tell, with the reason.
        spread_rad: angle over which the backing's force sets in (standard deviation).
        rms_before_Nm, rms_after_Nm: residual of the machine as configured, and with all that was found.
        unmodelled: torque by shaft angle that is left over, with its band. machine: the machine with what was found.
    """

    parameters: Mapping[str, Estimate]
    fixed: Mapping[str, float]
    not_identifiable: tuple[NotIdentifiable, ...]
    spread_rad: float
    rms_before_Nm: float
    rms_after_Nm: float
    unmodelled: UnmodelledTorque
    machine: Machine
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """One object of plain lists and numbers."""
        out: dict[str, Any] = plain(
            {
                "parameters": {name: dataclasses.asdict(each) for name, each in self.parameters.items()},
                "fixed": dict(self.fixed),
                "not_identifiable": [each.name for each in self.not_identifiable],
                "not_identifiable_because": {each.name: each.text for each in self.not_identifiable},
                "event_spread_rad": self.spread_rad,
                "rms_before_Nm": self.rms_before_Nm,
                "rms_after_Nm": self.rms_after_Nm,
                "unmodelled_torque": dataclasses.asdict(self.unmodelled),
                "notes": list(self.notes),
            }
        )
        return out


def identify(readings: Readings, machine: Machine) -> Identification:
    """Fit the parameters that the record can tell, by bounded least squares with Huber's loss.

    Effects are checked before anything is solved (see `identifiable`); linear parameters and the smooth ones are then
    solved together by scipy's trust region, event angles by a scan first. Intervals: bootstrap over whole turns.

    Raises RecordingError when the recording tells nothing, is of another machine, or a sensor's discrete setting
    (direction, ratio, unit, sign) is wrong, which `calibrate` settles.
    """
    found = _settled(readings, machine)
    evidence = found.evidence.thinned(_ALL_SAMPLES)
    model = TorqueModel(evidence, machine, found.settings.direction, _FIRST_SPREAD_RAD)
    told = model.start()
    values = told | {DELAY: found.settings.delay_s, ZERO: _near(found.settings.zero_rad, told[ZERO])}
    values[GAIN] = found.settings.gain
    free, lost = _tellable(model, values, found)
    for each in lost:
        values[each.name] = told[each.name]
    values, events = _solve(model, values, tuple(free))
    smooth = tuple(name for name in free if name not in EVENTS)
    spread = max((event.spread_rad for event in events.values()), default=0.0)
    parts = model.parts(values)
    residual = evidence.torque_Nm - model.expected(values)
    good = parts.good & ~model.near_event(parts.theta, values, _beside(spread))
    turn = model.turn(values)
    moves = moves_of(model.jacobian(values, smooth)[good], residual[good], turn[good])
    fitted = {name: _bounded(name, estimate(values[name], moves[:, k])) for k, name in enumerate(smooth)}
    phase = _phase_sigma(smooth, moves, found.settings.direction * evidence.working_speed())
    fitted |= {name: _with_phase(values[name], event, phase) for name, event in events.items()}
    fitted = {name: fitted[name] for name in free}
    before = (evidence.torque_Nm - model.expected(told))[good]
    left = unmodelled_torque(parts.theta[good], residual[good] / values[GAIN], turn[good])
    turned = machine.sensors.encoder.direction * machine.sensors.encoder.ratio
    if ZERO in fitted:
        fitted[ZERO] = fitted[ZERO].scaled(1.0 / turned)
    return Identification(
        parameters=fitted,
        fixed={name: values[name] / (turned if name == ZERO else 1.0) for name in model.names if name not in free},
        not_identifiable=tuple(lost),
        spread_rad=spread,
        rms_before_Nm=float(np.sqrt(np.mean(before**2))),
        rms_after_Nm=float(np.sqrt(np.mean(residual[good] ** 2))),
        unmodelled=left,
        machine=identified_machine(machine, {**values, ZERO: values[ZERO] / turned}, free),
        notes=tuple(each.text for each in lost),
    )


def _settled(readings: Readings, machine: Machine) -> Explanation:
    """The record explained, when its sensors' discrete settings are right. Raises RecordingError."""
    assessment = assess(readings, machine)
    found = assessment.explanation
    if found is None:
        raise RecordingError("; ".join(assessment.notes))
    for cause in assessment.verdict:
        if cause.cause in _WRONG_FIRST:
            raise RecordingError(f"{cause.text}: settle the sensors first with textile-twin calibrate")
        # Less than this a force or an angle that is to be identified may leave.
        if cause.cause == "other_machine" and 1.0 - found.explained > _LEFT_BY_LOADS:
            raise RecordingError(f"nothing to identify: {cause.text}")
    return found


def _near(angle: float, other: float) -> float:
    return other + float(np.remainder(angle - other + np.pi, 2.0 * np.pi) - np.pi)


def _tellable(
    model: TorqueModel, values: Mapping[str, float], found: Explanation
) -> tuple[list[str], list[NotIdentifiable]]:
    """What the record can tell, judged by the effects before anything is solved."""
    names = list(model.names)
    lost = []
    if found.one_speed:
        for name, partner in _ONE_AT_ONE_SPEED.items():
            names.remove(name)
            text = f"{name} cannot be told from {partner} at one speed; it stays as configured"
            lost.append(NotIdentifiable(name, (partner,), text))
    wide = model.with_spread(_WIDEST_RAD)
    effects = wide.jacobian(values, tuple(names))[wide.parts(values).good]
    free, more = identifiable(effects, names, GIVEN_UP_FIRST)
    return free, [*lost, *more]


def _solve(
    model: TorqueModel, values: dict[str, float], free: tuple[str, ...]
) -> tuple[dict[str, float], dict[str, EventAngle]]:
    """Smooth parameters away from the events, and events from the samples beside them, in turns."""
    names = [name for name in EVENTS if name in free]
    smooth = tuple(name for name in free if name not in EVENTS)
    events: dict[str, EventAngle] = {}
    spread = _WIDEST_RAD
    for last in (False, True):
        away = ~model.near_event(model.parts(values).theta, values, _beside(spread))
        values = _least_squares(model, values, smooth, away, _MANY_STEPS if last else _FEW_STEPS)
        scale = robust_scale((model.evidence.torque_Nm - model.expected(values))[model.parts(values).good & away])
        for name in names:
            beside = model.beside_event(values, name, _SCAN_RAD)
            if beside.relative_rad.size:
                coarse = _scan(beside, _FIRST_SPREAD_RAD)
                events[name] = event_angle(beside, scale, coarse, _REACH_RAD)
                values = values | {name: values[name] + events[name].shift.value}
        spread = max((event.spread_rad for event in events.values()), default=0.0)
    return values, events


def _scan(beside: BesideEvent, spread_rad: float) -> float:
    """The shift of least absolute error."""
    shifts = np.linspace(-_SCAN_RAD, _SCAN_RAD, 401)
    return float(shifts[np.argmin([beside.error(float(shift), spread_rad) for shift in shifts])])


def _beside(spread_rad: float) -> float:
    """How far from an event its spread decides [rad], the model's own spread included."""
    return 3.0 * spread_rad + 4.0 * _FIRST_SPREAD_RAD


def _phase_sigma(names: tuple[str, ...], moves: FloatArray, speed: float) -> float:
    """Standard deviation of the shaft angle at working speed that zero and delay leave [rad]."""
    weigh = {ZERO: -1.0, DELAY: -speed}
    phase = np.zeros(moves.shape[0])
    for name in set(weigh) & set(names):
        phase += weigh[name] * moves[:, names.index(name)]
    return float(np.std(phase))


def _with_phase(value: float, event: EventAngle, phase: float) -> Estimate:
    """An event's angle, uncertain by its own samples and by the shaft's angle."""
    shift = event.shift
    wider = float(np.hypot(shift.sigma, phase)) / max(shift.sigma, 1e-300)
    low, high = (value + wider * (end - shift.value) for end in shift.interval95)
    return Estimate(value, wider * shift.sigma, (low, high))


def _least_squares(
    model: TorqueModel, values: dict[str, float], free: tuple[str, ...], chosen: BoolArray | None, most_steps: int
) -> dict[str, float]:
    """Bounded least squares with Huber's loss in the free parameters, each scaled by its effect."""
    good = model.parts(values).good
    if chosen is not None:
        good = good & chosen
    torque = model.evidence.torque_Nm[good]
    slopes = model.jacobian(values, free)[good]
    size = np.sqrt(np.mean(slopes**2, axis=0)) + 1e-300
    scale = robust_scale(torque - model.expected(values)[good])

    def at(x: FloatArray) -> dict[str, float]:
        return values | dict(zip(free, (x / size).tolist(), strict=True))

    def residual(x: FloatArray) -> FloatArray:
        return np.asarray(np.nan_to_num((model.expected(at(x))[good] - torque) / scale))

    def jacobian(x: FloatArray) -> FloatArray:
        return np.asarray(np.nan_to_num(model.jacobian(at(x), free)[good] / (size * scale)))

    low = np.array([0.0 if name in NOT_NEGATIVE else -np.inf for name in free])
    start = np.array([values[name] for name in free]) * size
    for _ in range(2):  # the second time with the scale of what is left
        start = np.maximum(start, low + 1e-12)
        solved = scipy.optimize.least_squares(
            residual, start, jacobian, (low, np.inf), loss="huber", f_scale=HUBER, max_nfev=most_steps
        )
        start = solved.x
        scale = robust_scale(torque - model.expected(at(start))[good])
    return at(start)


def _bounded(name: str, found: Estimate) -> Estimate:
    """An interval that keeps to what the parameter can be."""
    if name not in NOT_NEGATIVE:
        return found
    low, high = found.interval95
    return dataclasses.replace(found, interval95=(max(low, 0.0), max(high, 0.0)))
