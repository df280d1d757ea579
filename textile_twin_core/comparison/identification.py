"""Identification of forces, friction, event angles, inertia and sensors of a machine from one recording."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.comparison.assessment import Judged, assess
from textile_twin_core.comparison.event_angle import BesideEvent, EventAngle, event_angle
from textile_twin_core.comparison.evidence import Evidence
from textile_twin_core.comparison.identifiable import NotIdentifiable, identifiable
from textile_twin_core.comparison.identified_machine import identified_machine
from textile_twin_core.comparison.readings import Readings
from textile_twin_core.comparison.repeating_motion import excess_of, repeating_motion
from textile_twin_core.comparison.result import plain
from textile_twin_core.comparison.shaft_track import TURN, ShaftTrack
from textile_twin_core.comparison.smooth_fit import (
    SLOW_ORDERS,
    SLOW_ORDERS_OF_ROTOR,
    SmoothFit,
    clean_tracks,
    instrumented_fit,
    least_squares_fit,
)
from textile_twin_core.comparison.stage import Begin, unheard
from textile_twin_core.comparison.stamp_timing import widened
from textile_twin_core.comparison.torque_model import (
    DELAY,
    EVENTS,
    GAIN,
    INERTIA,
    NOT_NEGATIVE,
    OFFSET,
    ZERO,
    TorqueModel,
)
from textile_twin_core.comparison.uncertainty import Estimate, uncertainty_by_turns
from textile_twin_core.comparison.unmodelled import UnmodelledTorque, unmodelled_torque
from textile_twin_core.errors import RecordingError
from textile_twin_core.inference.parameter import DELAY as INFERRED_DELAY
from textile_twin_core.inference.parameter import ROTOR
from textile_twin_core.inference.robust import robust_scale
from textile_twin_core.machine import Machine

GIVEN_UP_FIRST = (OFFSET, ZERO, GAIN, "shaft_viscous_Nms", "added_inertia_kgm2", "free_force_N", DELAY)
"""The order in which parameters with indistinguishable effects are dropped."""
_WRONG_FIRST = ("encoder_direction", "encoder_ratio", "angle_unit", "angle_rate", "torque_sign", "torque_unit")
_ALL_SAMPLES = 40_000
_FIRST_SPREAD_RAD, _WIDEST_RAD, _REACH_RAD = math.radians(0.12), math.radians(2.0), math.radians(1.0)
_ONE_AT_ONE_SPEED = {ZERO: DELAY, "shaft_viscous_Nms": "shaft_coulomb_Nm"}
_SCAN_RAD = 0.2
_LEFT_BY_LOADS = 0.15
_FEW_STEPS, _MANY_STEPS = 8, 25
_JUDGED, _SOLVED = 0.4, ((0.6, 0.66), (0.85, 0.92))
"""Shares of all work at which stages end: the verdict, then twice a fit and the events."""


@dataclass(frozen=True)
class Identification:
    """Parameters of a machine, identified from a recording.

    Attributes:
        parameters: fitted parameters by name. fixed: parameters that stay as configured, by name.
        not_identifiable: parameters that this record does not determine, with the reason.
        spread_rad: angle over which the backing's force sets in (standard deviation).
        rms_before_Nm, rms_after_Nm: residual of the machine as configured, and with all estimates.
        unmodelled: residual torque by shaft angle, with its band. machine: the machine with all estimates.
        notes: remarks on the recording (gaps), and reasons why parameters are not identifiable.
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


def identify(readings: Readings, machine: Machine, begin: Begin = unheard) -> Identification:
    """Fit the parameters that the record determines.

    Effects are checked before any fit (see `identifiable`); then the smooth parameters are fitted together (see
    `smooth_fit`), and event angles by the likelihood of the samples beside them. Intervals by `uncertainty_by_turns`.
    `begin` is called at each stage.

    Raises RecordingError when the recording determines nothing, is of another machine, or a sensor's discrete setting
    (direction, ratio, unit, sign) is wrong, which `calibrate` corrects.
    """
    begin("judging", _JUDGED)
    found, notes = _settled(readings, machine)
    evidence = found.evidence.thinned(_ALL_SAMPLES)
    model = TorqueModel(evidence, machine, found.settings.direction, _FIRST_SPREAD_RAD)
    configured = model.start()
    values = configured | {DELAY: found.settings.delay_s, ZERO: _near(found.settings.zero_rad, configured[ZERO])}
    values[GAIN] = found.settings.gain
    free, lost = _identifiable(model, values, found)
    smooth = tuple(name for name in free if name not in EVENTS)
    steady = None if found.torque_by_speed_Nms or found.whole_turns else _steady(readings, machine, evidence)
    orders = SLOW_ORDERS_OF_ROTOR if found.whole_turns else SLOW_ORDERS
    clean = clean_tracks(model.with_spread(_WIDEST_RAD), steady, values, smooth, orders)
    for each in lost:
        values[each.name] = configured[each.name]
    values, events, fit, moved = _solve(model, clean, values, free, begin)
    begin("weighing", 1.0)
    turn = model.turn(values)[fit.good]
    known = uncertainty_by_turns(fit.slopes, fit.residual, turn, fit.instruments).wider(moved)
    fitted = {name: _bounded(name, known.estimate(k, values[name])) for k, name in enumerate(smooth)}
    phase = _phase_sigma(smooth, known.covariance, found.settings.direction * evidence.working_speed())
    fitted |= {name: _with_phase(values[name], event, phase) for name, event in events.items()}
    fitted = {name: fitted[name] for name in free}
    if DELAY in fitted:
        fitted[DELAY] = widened(fitted[DELAY], readings.stamped)
    before = (evidence.torque_Nm - model.expected(configured))[fit.good]
    theta = model.parts(values).theta[fit.good]
    torque = unmodelled_torque(theta, fit.residual / values[GAIN], turn, machine.sensors.encoder.cycle_turns)
    turned = machine.sensors.encoder.direction * machine.sensors.encoder.ratio
    if ZERO in fitted:
        fitted[ZERO] = fitted[ZERO].scaled(1.0 / turned)
    return Identification(
        parameters=fitted,
        fixed={name: values[name] / (turned if name == ZERO else 1.0) for name in model.names if name not in free},
        not_identifiable=(*lost, *model.not_there),
        spread_rad=_spread(events),
        rms_before_Nm=float(np.sqrt(np.mean(before**2))),
        rms_after_Nm=float(np.sqrt(np.mean(fit.residual**2))),
        unmodelled=torque,
        machine=identified_machine(machine, {**values, ZERO: values[ZERO] / turned}, free),
        notes=(*notes, *(each.text for each in (*lost, *model.not_there))),
    )


def _settled(readings: Readings, machine: Machine) -> tuple[Judged, tuple[str, ...]]:
    """Return the judged record and its notes, provided that its sensors' discrete settings are right.

    Raises RecordingError.
    """
    assessment = assess(readings, machine)
    found = assessment.found
    if found is None:
        raise RecordingError("; ".join(assessment.notes))
    for cause in assessment.verdict:
        if cause.cause in _WRONG_FIRST:
            raise RecordingError(f"{cause.text}: settle the sensors first with textile-twin calibrate")
        # A force or an angle that is still to be identified may leave this much unexplained.
        if cause.cause == "other_machine" and found.unexplained > _LEFT_BY_LOADS:
            raise RecordingError(f"nothing to identify: {cause.text}")
    return found, assessment.notes


def _near(angle: float, other: float) -> float:
    return other + float(np.remainder(angle - other + np.pi, 2.0 * np.pi) - np.pi)


def _identifiable(
    model: TorqueModel, values: Mapping[str, float], found: Judged
) -> tuple[tuple[str, ...], list[NotIdentifiable]]:
    """Choose the identifiable parameters from their effects on the torque, before any fit."""
    names = list(model.names)
    lost = []
    if found.evidence.track.at_one_speed:
        for name, partner in _ONE_AT_ONE_SPEED.items():
            names.remove(name)
            text = f"{name} cannot be told from {partner} at one speed; it stays as configured"
            lost.append(NotIdentifiable(name, text))
    if found.whole_turns and DELAY in names and INFERRED_DELAY not in found.posterior.departing:
        names.remove(DELAY)
        text = f"{DELAY} stays as configured: without a linkage only changes of speed show it, and these show none"
        lost.append(NotIdentifiable(DELAY, text))
    wide = model.with_spread(_WIDEST_RAD)
    effects = wide.jacobian(values, tuple(names))[wide.parts(values).good]
    free, more = identifiable(effects, names, GIVEN_UP_FIRST)
    if found.torque_by_speed_Nms and {INERTIA, DELAY} <= set(free):
        gone, partner = (DELAY, INERTIA) if ROTOR in found.posterior.departing else (INERTIA, DELAY)
        free.remove(gone)
        text = f"{gone} cannot be told from {partner} where the torque follows the speed; it stays as configured"
        more = [*more, NotIdentifiable(gone, text)]
    return tuple(free), [*lost, *more]


def _steady(readings: Readings, machine: Machine, evidence: Evidence) -> ShaftTrack:
    """Estimate the part of the motion that repeats or changes slowly, without the errors of single readings."""
    encoder, track = machine.sensors.encoder, evidence.track
    excess = None
    if not encoder.teeth:
        time: FloatArray = np.asarray((readings.angle_stamps_ns - readings.angle_stamps_ns[0]) * 1e-9, np.float64)
        excess = excess_of(track, time, readings.angle * encoder.ratio, TURN * encoder.ratio)
    return repeating_motion(track, encoder.cycle_turns, evidence.slow_rad_s, excess)


def _solve(
    model: TorqueModel, clean: tuple[ShaftTrack, ...], values: dict[str, float], free: tuple[str, ...], begin: Begin
) -> tuple[dict[str, float], dict[str, EventAngle], SmoothFit, list[FloatArray]]:
    """Fit in alternation the smooth parameters away from the events, and the events from the samples beside them.

    Also return the moves (k,) of the smooth parameters with instruments on each of the other tracks.
    """
    names = [name for name in EVENTS if name in free]
    smooth = tuple(name for name in free if name not in EVENTS)
    events: dict[str, EventAngle] = {}

    def away() -> BoolArray:
        spread = _spread(events) if events else _WIDEST_RAD
        return ~model.near_event(model.parts(values).theta, values, _beside(spread))

    for last, (fitted, events_end) in zip((False, True), _SOLVED, strict=True):
        begin("fitting", fitted)
        chosen = away()
        values = least_squares_fit(model, values, smooth, chosen, _MANY_STEPS if last else _FEW_STEPS)
        if last:
            values = instrumented_fit(model, clean[0], values, smooth, chosen).values
        scale = robust_scale((model.evidence.torque_Nm - model.expected(values))[model.parts(values).good & chosen])
        begin("seeking events", events_end)
        for name in names:
            beside = model.beside_event(values, name, _SCAN_RAD)
            if beside.relative_rad.size:
                coarse = _scan(beside, _FIRST_SPREAD_RAD)
                events[name] = event_angle(beside, scale, coarse, _REACH_RAD)
                values = values | {name: values[name] + events[name].shift.value}
    fit, *others = (instrumented_fit(model, track, values, smooth, away()) for track in clean)
    moved = [np.array([other.values[name] - fit.values[name] for name in smooth]) for other in others]
    return fit.values, events, fit, moved


def _spread(events: Mapping[str, EventAngle]) -> float:
    """Widest angle over which a force sets in."""
    return max((event.spread_rad for event in events.values()), default=0.0)


def _scan(beside: BesideEvent, spread_rad: float) -> float:
    """Shift of least absolute error."""
    shifts = np.linspace(-_SCAN_RAD, _SCAN_RAD, 401)
    return float(shifts[np.argmin([beside.error(float(shift), spread_rad) for shift in shifts])])


def _beside(spread_rad: float) -> float:
    """Distance from an event [rad] within which its spread matters, the model's own spread included."""
    return 3.0 * spread_rad + 4.0 * _FIRST_SPREAD_RAD


def _phase_sigma(names: tuple[str, ...], covariance: FloatArray, speed: float) -> float:
    """Standard deviation of the shaft angle at working speed due to zero and delay [rad]."""
    effects = {ZERO: -1.0, DELAY: -speed}
    weigh = np.array([effects.get(name, 0.0) for name in names])
    return math.sqrt(max(float(weigh @ covariance @ weigh), 0.0))


def _with_phase(value: float, event: EventAngle, phase: float) -> Estimate:
    """Angle of an event, with the uncertainty of its own samples and of the shaft's angle."""
    shift = event.shift
    wider = float(np.hypot(shift.sigma, phase)) / shift.sigma
    low, high = (value + wider * (end - shift.value) for end in shift.interval95)
    return Estimate(value, wider * shift.sigma, (low, high))


def _bounded(name: str, found: Estimate) -> Estimate:
    """Clip the interval to the admissible values of the parameter."""
    if name not in NOT_NEGATIVE:
        return found
    low, high = found.interval95
    return dataclasses.replace(found, interval95=(max(low, 0.0), max(high, 0.0)))
