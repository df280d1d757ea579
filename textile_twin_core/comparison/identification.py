"""Identification of forces, friction, event angles, inertia and sensors of a machine from one recording."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.assessment import Assessment, assess
from textile_twin_core.comparison.calibration import calibration_refusal
from textile_twin_core.comparison.cause import WRONG_FIRST
from textile_twin_core.comparison.event_angle import event_angle
from textile_twin_core.comparison.gather import hypothesis_of, record_of
from textile_twin_core.comparison.identifiable import NotIdentifiable, identifiable
from textile_twin_core.comparison.identified_machine import Candidates
from textile_twin_core.comparison.instrumented_fit import instrumented_fit
from textile_twin_core.comparison.judged import Judged
from textile_twin_core.comparison.readings import Readings
from textile_twin_core.comparison.repeating_motion import excess_of, repeating_motion
from textile_twin_core.comparison.result import plain
from textile_twin_core.comparison.shaft_track import TURN, ShaftTrack
from textile_twin_core.comparison.stage import Begin, unheard
from textile_twin_core.comparison.stamp_timing import widened
from textile_twin_core.comparison.uncertainty import Estimate
from textile_twin_core.comparison.unmodelled import UnmodelledTorque, unmodelled_torque
from textile_twin_core.errors import RecordingError
from textile_twin_core.inference.measurement import Hypothesis, Measurement
from textile_twin_core.inference.parameter import (
    COULOMB,
    DELAY,
    DRIFT,
    GAIN,
    HELD,
    OFFSET,
    ROTOR,
    VISCOUS,
    ZERO,
    gain_factor,
)
from textile_twin_core.inference.robust import robust_scale
from textile_twin_core.machine import Machine

_GIVEN_UP_FIRST = (OFFSET, ZERO, GAIN, VISCOUS, ROTOR, "loads.backing.free_force_N", DELAY)
"""The order in which parameters with indistinguishable effects are dropped."""
_ALL_SAMPLES = 40_000
_LEFT_BY_LOADS = 0.15
"""Share of the torque's variance that a force or an angle still to be identified may leave unexplained."""
_SCAN_RAD, _SPREAD_RAD, _REACH_RAD = 0.2, math.radians(0.12), math.radians(1.0)
"""Shifts of an event that are tried at first, with the spread of its force, and the half width of its likelihood."""
_FEWEST_BESIDE = 3
"""Samples within the reach on either side of an event that determine its angle."""
_JUDGED, _FITTED = 0.6, 0.9
"""Shares of all work at which the verdict and the fit end."""


@dataclass(frozen=True)
class Identification:
    """Parameters of a machine, identified from a recording.

    Attributes:
        parameters: fitted parameters by name. fixed: parameters that stay as configured, by name.
        not_identifiable: parameters that this record does not determine, with the reason.
        rms_before_Nm, rms_after_Nm: residual of the machine as configured, and with all estimates.
        unmodelled: residual torque by shaft angle, with its band. machine: the machine with all estimates.
        notes: remarks on the recording (gaps), and reasons why parameters are not identifiable.

    Examples:
        >>> import textile_twin_core as ttc
        >>> from textile_twin_core.comparison import Readings, identify
        >>> from textile_twin_core.recordings import open_bag
        >>> bag = open_bag("bags/tufting_160rpm_synthetic")
        >>> angle, torque = bag.read_angles(), bag.read_torques("balancing_torque/measured")
        >>> readings = Readings(angle.stamps, angle.angles_rad, torque.stamps, torque.torque_Nm)
        >>> identify(readings, ttc.machines.tufting()).not_identifiable  # doctest: +SKIP
        ()
    """

    parameters: Mapping[str, Estimate]
    fixed: Mapping[str, float]
    not_identifiable: tuple[NotIdentifiable, ...]
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
                "rms_before_Nm": self.rms_before_Nm,
                "rms_after_Nm": self.rms_after_Nm,
                "unmodelled_torque": dataclasses.asdict(self.unmodelled),
                "notes": list(self.notes),
            }
        )
        return out


def identify(readings: Readings, machine: Machine, begin: Begin = unheard) -> Identification:
    """Fit the parameters that the record determines; all other numbers are as in the machine file.

    Effects are checked before the fit (see `identifiable`); then all are fitted together to every sample, with
    intervals that hold under model error (see `instrumented_fit`).

    Args:
        readings: the recording.
        machine: the machine as configured.
        begin: called at each stage.

    Returns:
        The estimates with their intervals, and the machine with them.

    Raises:
        RecordingError: the recording determines nothing, is of another machine, or a sensor's discrete setting
            (direction, ratio, unit, sign) is wrong, which `calibrate` corrects.

    Examples:
        >>> import textile_twin_core as ttc
        >>> from textile_twin_core.comparison import Readings, identify
        >>> from textile_twin_core.recordings import open_bag
        >>> bag = open_bag("bags/tufting_160rpm_synthetic")
        >>> angle, torque = bag.read_angles(), bag.read_torques("balancing_torque/measured")
        >>> readings = Readings(angle.stamps, angle.angles_rad, torque.stamps, torque.torque_Nm)
        >>> identify(readings, ttc.machines.tufting()).parameters["backing_force_N"].value  # [N]  # doctest: +SKIP
        1003.0
    """
    begin("judging", _JUDGED)
    found, notes = _settled(readings, machine)
    begin("fitting", _FITTED)
    candidates, hypothesis = Candidates(machine), found.posterior.hypothesis
    speed_controlled, whole_turns = bool(found.torque_by_speed_Nms), found.whole_turns
    evidence = found.evidence.in_runs() if hypothesis.filters else found.evidence
    averaged = bool(found.posterior.measurement.record.block_s)
    record = record_of(evidence, speed_controlled, whole_turns, _ALL_SAMPLES, averaged)
    m = candidates.measurement(found.posterior.measurement, record)
    off_nominal = found.posterior.off_nominal
    nuisance = {*off_nominal.intersection({DRIFT, HELD}), *m.off_nominal_chain(off_nominal)}
    start = m.nominal.copy()
    for name in (*candidates.public, *nuisance):
        if name in m.place:
            start[m.place[name]] = found.posterior.value(name)
    free, lost = _identifiable(m, candidates, found, start)
    for name in set(candidates.public).intersection(m.names).difference(free):
        start[m.place[name]] = m.nominal[m.place[name]]
    samples = m.on(record_of(evidence, most=_ALL_SAMPLES))
    clean = None if record.block_s else _clean_motion(readings, machine, found)
    smooth = {*free, *nuisance}.difference(candidates.planes)
    events = dict[str, Estimate]()
    if set(candidates.planes).intersection(free):
        least = instrumented_fit(m, hypothesis, start, smooth).x
        events, start = _events(samples, hypothesis, least, candidates, free)
    fit = instrumented_fit(m, hypothesis, start, smooth, clean)
    events, x = _events(samples, hypothesis, fit.x, candidates, tuple(events))
    for name in set(candidates.planes).intersection(free).difference(events):
        text = (
            f"{candidates.public[name]} cannot be determined: too few torque samples beside it; it stays as configured"
        )
        lost.append(NotIdentifiable(candidates.public[name], text))
    begin("weighing", 1.0)
    known, fitted = fit.uncertainty, dict[str, Estimate]()
    for k, name in enumerate(fit.free):
        if name in candidates.public:
            sigma, half = float(np.sqrt(known.covariance[k, k])), float(known.half_width[k])
            fitted[candidates.public[name]] = candidates.estimate(m, hypothesis, x, name, sigma, half)
    phase = _phase_sigma(fit.free, known.covariance, hypothesis.turn * record.speed_rad_s)
    angles = candidates.event_angles(m, fit.x)
    fitted |= {candidates.public[name]: _with_phase(angles[name], each, phase) for name, each in events.items()}
    delay = candidates.public[DELAY]
    if delay in fitted:
        fitted[delay] = widened(fitted[delay], readings.stamped)
    before, good = samples.residual(hypothesis_of(machine), samples.nominal)
    after, also = samples.residual(hypothesis, x)
    good &= also
    theta = samples.expected(hypothesis, x).theta[good]
    turn = np.floor(theta / TURN).astype(np.int64)
    gain = hypothesis.gain * gain_factor(float(x[m.place[GAIN]]))
    torque = unmodelled_torque(theta, after[good] / gain, turn, machine.sensors.encoder.cycle_turns)
    values = candidates.values(m, hypothesis, x)
    return Identification(
        parameters={name: fitted[name] for name in candidates.public.values() if name in fitted},
        fixed={name: value for name, value in values.items() if name not in fitted},
        not_identifiable=(*lost, *candidates.missing),
        rms_before_Nm=float(np.sqrt(np.mean(before[good] ** 2))),
        rms_after_Nm=float(np.sqrt(np.mean(after[good] ** 2))),
        unmodelled=torque,
        machine=candidates.machine_with(m, hypothesis, x, off_nominal),
        notes=(*notes, *(each.text for each in (*lost, *candidates.missing))),
    )


def _events(
    samples: Measurement, hypothesis: Hypothesis, x: FloatArray, candidates: Candidates, names: Collection[str]
) -> tuple[dict[str, Estimate], FloatArray]:
    """Estimate event angles from the samples beside them; return their shifts, and x with the planes moved.

    Few samples lie beside an event, so its likelihood is no parabola, and the fit of all samples would be
    overconfident. An event with too few samples on either side is left out, its plane as configured.
    """
    residual, good = samples.residual(hypothesis, x)
    scale, moved, events = robust_scale(residual[good]), x.copy(), dict[str, Estimate]()
    angles = candidates.event_angles(samples, x)
    for name in set(candidates.planes).intersection(names):
        place = samples.place[name]
        moved[place] = samples.nominal[place]
        if name not in angles:
            continue
        beside = candidates.beside_event(samples, hypothesis, x, name, angles[name], 1.2 * _SCAN_RAD)
        shifts = np.linspace(-_SCAN_RAD, _SCAN_RAD, 401)
        coarse = float(shifts[np.argmin([beside.error(float(shift), _SPREAD_RAD) for shift in shifts])])
        past = beside.relative_rad - coarse
        near = np.abs(past) < _REACH_RAD
        if min(np.count_nonzero(near & (past < 0.0)), np.count_nonzero(near & (past > 0.0))) >= _FEWEST_BESIDE:
            events[name] = event_angle(beside, scale, coarse, _REACH_RAD)
            moved[place] = candidates.plane_at(angles[name] + events[name].value)
    return events, moved


def _phase_sigma(names: tuple[str, ...], covariance: FloatArray, speed_rad_s: float) -> float:
    """Standard deviation of the shaft angle at working speed due to zero and delay [rad]."""
    effects = {ZERO: -1.0, DELAY: -speed_rad_s}
    weigh = np.array([effects.get(name, 0.0) for name in names])
    return math.sqrt(max(float(weigh @ covariance @ weigh), 0.0))


def _with_phase(angle_rad: float, shift: Estimate, phase_rad: float) -> Estimate:
    """Angle of an event, with the uncertainty of its own samples and of the shaft's angle."""
    wider = math.hypot(shift.sigma, phase_rad) / shift.sigma
    low, high = (angle_rad + shift.value + wider * (end - shift.value) for end in shift.interval95)
    return Estimate(angle_rad + shift.value, wider * shift.sigma, (low, high))


def _settled(readings: Readings, machine: Machine) -> tuple[Judged, tuple[str, ...]]:
    """Return the judged record and its notes, provided that its sensors' discrete settings are right.

    Raises RecordingError.
    """
    assessment = assess(readings, machine)
    found = assessment.found
    if found is None:
        raise RecordingError("; ".join(assessment.notes))
    check_sensors(assessment, machine)
    for cause in assessment.verdict:
        if cause.cause == "other_machine" and found.unexplained > _LEFT_BY_LOADS:
            raise RecordingError(f"nothing to identify: {cause.text}")
    return found, assessment.notes


def check_sensors(assessment: Assessment, machine: Machine) -> None:
    """Raise RecordingError where direction, ratio, unit or sign of a sensor is wrong, with the way to settle it."""
    wrong = [cause.text for cause in assessment.verdict if cause.cause in WRONG_FIRST]
    if wrong:
        refusal = calibration_refusal(assessment, machine)
        way = (
            f"calibrate cannot settle it here: {refusal}" if refusal else "settle it first with textile-twin calibrate"
        )
        raise RecordingError(f"{wrong[0]}: {way}")


def _identifiable(
    m: Measurement, candidates: Candidates, found: Judged, values: FloatArray
) -> tuple[tuple[str, ...], list[NotIdentifiable]]:
    """Choose the identifiable parameters from their effects on the torque, before any fit."""
    public, off_nominal = candidates.public, found.posterior.off_nominal
    names = [name for name in public if name in m.place]
    lost = []

    def give_up(name: str, why: str) -> None:
        names.remove(name)
        lost.append(NotIdentifiable(public[name], f"{public[name]} {why}; it stays as configured"))

    if m.record.one_speed:
        delay, partner = (DELAY, ZERO) if DELAY not in found.settled.free else (ZERO, DELAY)
        for name, other in ((delay, partner), (VISCOUS, COULOMB)):
            give_up(name, f"cannot be distinguished from {public[other]} at one speed")
    elif found.whole_turns and DELAY not in off_nominal:
        give_up(DELAY, "shows in changes of the speed alone without a linkage, and these show none")
    if m.record.speed_controlled and {ROTOR, DELAY} <= set(names):
        gone, other = (DELAY, ROTOR) if ROTOR in off_nominal else (ROTOR, DELAY)
        give_up(gone, f"cannot be distinguished from {public[other]} where the torque follows the speed")
    if m.record.speed_controlled:
        for name in candidates.planes:
            give_up(name, "cannot be determined: the torque of a speed-controlled drive makes no step there")
    seen = m.expected(found.posterior.hypothesis, values, slopes=True)
    assert seen.slopes is not None
    effects, good = m.means(seen.slopes[:, [m.place[name] for name in names]], seen.good)
    standing = m.at_standstill(found.posterior.hypothesis, values, slopes=True)[1]
    rows = [effects[good]]
    if standing is not None and standing.size:
        rows.append(standing[:, [m.place[name] for name in names]])
    order = [public[name] for name in _GIVEN_UP_FIRST if name in names]
    kept, more = identifiable(np.concatenate(rows), [public[name] for name in names], order)
    return tuple(name for name in names if public[name] in kept), [*lost, *more]


def _clean_motion(readings: Readings, machine: Machine, found: Judged) -> ShaftTrack:
    """Estimate the part of the motion that repeats or changes slowly, without the errors of single readings."""
    encoder, track = machine.sensors.encoder, found.evidence.track
    excess = None
    if not encoder.teeth:
        time: FloatArray = np.asarray((readings.angle_stamps_ns - readings.angle_stamps_ns[0]) * 1e-9, np.float64)
        excess = excess_of(track, time, encoder.true_angle(readings.angle) * encoder.ratio, TURN * encoder.ratio)
    return repeating_motion(track, encoder.cycle_turns, found.evidence.slow_rad_s, excess)
