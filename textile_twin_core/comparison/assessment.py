"""Assess a recording: explain the measured torque by machine and sensors, and give the verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.comparison.cause import Cause, Quantity
from textile_twin_core.comparison.causes import NOT_THIS_MACHINE, burst_verdict, causes, quantities
from textile_twin_core.comparison.change_in_time import change_in_time
from textile_twin_core.comparison.elastic_hypothesis import RIGID_NOTE, elastic_cause, elastic_hypothesis
from textile_twin_core.comparison.elastic_readings import elastic_torque
from textile_twin_core.comparison.evidence import Evidence
from textile_twin_core.comparison.force_law import ForceLawCause, ForceLaws, cause_of
from textile_twin_core.comparison.gather import (
    evidence_of,
    gather,
    hypothesis_of,
    record_of,
    unusable_reason,
)
from textile_twin_core.comparison.judged import Judged, best_periodic
from textile_twin_core.comparison.range_ends import range_end_note
from textile_twin_core.comparison.readings import AngleUnit, Readings, angle_unit, samples_per_turn
from textile_twin_core.comparison.shaft_track import TURN, ShaftTrack
from textile_twin_core.comparison.speed_control import torque_by_speed
from textile_twin_core.comparison.stage import Begin, unheard
from textile_twin_core.comparison.stamp_timing import widened
from textile_twin_core.comparison.torque_readings import TimeLine, time_lines
from textile_twin_core.comparison.uncertainty import Estimate
from textile_twin_core.inference.elastic_posterior import infer_elastic
from textile_twin_core.inference.measurement import Hypothesis
from textile_twin_core.inference.parameter import (
    DELAY,
)
from textile_twin_core.inference.posterior import Posterior
from textile_twin_core.inference.record import Ripple
from textile_twin_core.inference.record_posterior import infer
from textile_twin_core.inference.starts import RATIOS
from textile_twin_core.inference.torque_model import TabulatedTorque
from textile_twin_core.machine import Machine

_MOST_GOVERNED = 60_000
_LINE_SAMPLES, _FEWEST_FOR_LINES = 100_000, 512
"""Most and fewest samples in which lines fixed in time are searched."""
OTHER_UNITS = (("degrees", 360.0), ("revolutions", 1.0))
"""Units tried for an angle that never wraps, when radians explain little."""
SOME_SLIPS = 3
"""Fewest slips of the angle that are reported: a single one is a fault that `FaultWatch` names."""
_CHANGES = 2
"""Estimates of a change in time: the first stands beside values that had to do without it."""
_FEWEST_ANGLES = 64
"""Fewest angles beside torque that show the unit by themselves."""
_MOST_LISTED = 3
_WELL = 0.9
"""Share of the torque's variance, noise apart, from which no other unit of the angle is tried; with the noise, from
which the other directions of a rigid shaft are not."""
_BESIDE_S = 0.05
"""Largest distance of a torque from the readings of the runs that an elastic shaft is observed in."""
_PLAUSIBLE_RAD_S = (0.2, 700.0)
_WHEEL = (
    "read off a toothed wheel the acceleration is not known well enough for this torque: no verdict on it; hold the"
    " shaft's speed against what the torque drives instead (compare --quantity speed)"
)
_LONG_DELAY_S = 0.1
_LONG_DELAY = (
    "the torque sensor's delay_s of {:g} s is longer than filters and links take, and may be wrong by whole turns; if"
    " it is in milliseconds, write {:g}"
)
_LIKE_PITCH_ERRORS = ("torque_gain", "load_force")
_PITCH = (
    "gain and loads are not judged: the pitch errors of the toothed wheel are unknown, and read as acceleration of the"
    " shaft; give pitch_errors_rad of the encoder in the machine file"
)


@dataclass(frozen=True)
class Assessment:
    """Assessment of a recording.

    Attributes:
        unit: unit of the logged angle. found: estimates of machine and sensors; None when the recording determines
            nothing, with the reason in `notes`.
        verdict: causes of the differences, likeliest first; empty when all is right.
        quantities: estimated quantities, each once. notes: remarks for the reader.
        law: force law that explains what constant forces do not.
        delay: of the torque [s], from the same fit; None without a judgement of this machine.

    Examples:
        >>> import textile_twin_core as ttc
        >>> from textile_twin_core.comparison import Readings, assess
        >>> from textile_twin_core.recordings import open_bag
        >>> bag = open_bag("bags/tufting_160rpm_synthetic")
        >>> angle, torque = bag.read_angles(), bag.read_torques("balancing_torque/measured")
        >>> readings = Readings(angle.stamps, angle.angles_rad, torque.stamps, torque.torque_Nm)
        >>> assess(readings, ttc.machines.tufting()).unit.name  # doctest: +SKIP
        'radians'
    """

    unit: AngleUnit
    found: Judged | None
    verdict: tuple[Cause, ...]
    notes: tuple[str, ...]
    quantities: tuple[Quantity, ...] = ()
    law: ForceLawCause | None = None
    delay: Estimate | None = None

    @property
    def explained(self) -> float:
        """Share of the torque's variance that is explained, nan without an estimate."""
        return math.nan if self.found is None else self.found.explained


def assess(readings: Readings, machine: Machine, track: ShaftTrack | None = None, begin: Begin = unheard) -> Assessment:
    """Assess a recording by the hypotheses of its sensors and machine.

    Args:
        readings: the recording.
        machine: the machine as configured.
        track: the shaft's motion if it was estimated before, from angles in radians and the first angle's stamp on.
        begin: called at each stage of the fit of an elastic shaft.

    Returns:
        The verdict, with the estimates behind it.

    Raises:
        RecordingError: too few samples to estimate the motion of the shaft.

    Examples:
        >>> import textile_twin_core as ttc
        >>> from textile_twin_core.comparison import Readings, assess
        >>> from textile_twin_core.recordings import open_bag
        >>> bag = open_bag("bags/tufting_160rpm_synthetic")
        >>> angle, torque = bag.read_angles(), bag.read_torques("balancing_torque/measured")
        >>> readings = Readings(angle.stamps, angle.angles_rad, torque.stamps, torque.torque_Nm)
        >>> assess(readings, ttc.machines.tufting()).verdict[0].cause  # doctest: +SKIP
        'delay'
    """
    judged = _assess(readings, machine, track, begin)
    judged = replace(judged, verdict=burst_verdict(readings.stamped, judged.verdict))
    if judged.unit.is_other and all(c.cause != "angle_unit" for c in judged.verdict):
        note = f"{judged.unit.instead}: give --angle-unit {judged.unit.option}"
        return replace(judged, notes=(*judged.notes, note))
    return judged


def _assess(readings: Readings, machine: Machine, track: ShaftTrack | None, begin: Begin) -> Assessment:
    unit = _unit(readings)
    if track is not None and unit.name == "radians":
        origin = int(readings.angle_stamps_ns[0])
        evidence = evidence_of(readings, track, origin, machine.sensors.encoder, unit)
    else:
        evidence = gather(readings, machine, unit)
    reason = unusable_reason(evidence)
    if reason:
        return Assessment(unit, None, (), (reason,))
    twisting = elastic_hypothesis(evidence, machine, hypothesis_of(machine))
    if twisting is not None:
        # Fits of a rigid machine would explain the vibration by false inertias and sensors.
        return Assessment(unit, None, (elastic_cause(twisting),), (RIGID_NOTE,))
    found = None
    if machine.shaft is not None and not readings.as_rigid:
        found = _judged_elastically(readings, machine, unit, evidence, begin)
    if found is None or found.explained < _WELL:
        rigid = _judged(readings, machine, unit, evidence)
        if found is None or (rigid is not None and rigid.explained > found.explained):
            found = rigid
    # without a linkage another unit of the angle is the same as another inertia
    rotor = found is not None and found.whole_turns
    if not unit.wrapped and not rotor and (found is None or found.unexplained > 1.0 - _WELL):
        unit, found = _other_unit(readings, machine, (unit, found))
    if found is None:
        return Assessment(unit, None, (), ("no setting of encoder and torque sensor gives any accord",))
    law = cause_of(found, machine)
    evidence = found.evidence
    speed = found.posterior.hypothesis.turn * evidence.working_speed()
    per_turn = samples_per_turn(readings.angle_stamps_ns, speed)
    # The bound over all machines is needed only where this machine leaves something unexplained.
    short = found.unexplained > NOT_THIS_MACHINE
    periodic = best_periodic(found) if short else found.explained
    if short and machine.sensors.encoder.teeth:
        # Pitch errors of its wheel read as acceleration, so no cause is named.
        return Assessment(unit, found, (), (*_notes(evidence), _WHEEL))
    named, notes = causes(found, unit, per_turn, periodic), _notes(evidence)
    configured_s = machine.sensors.torque.delay_s
    if abs(configured_s) > _LONG_DELAY_S:
        notes = (*notes, _LONG_DELAY.format(configured_s, configured_s * 1e-3))
    if law is not None:
        peak, sigma = law.peak
        named.insert(0, Cause("force_law", law.text, peak, sigma, f"loads.{law.curve.name}"))
    if machine.sensors.encoder.teeth and machine.sensors.encoder.pitch_errors_rad is None:
        judged = [cause for cause in named if cause.cause not in _LIKE_PITCH_ERRORS]
        if len(judged) < len(named):
            notes = (*notes, _PITCH)
        named = judged
    delay = widened(found.delay, readings.stamped)
    known = all(cause.cause != "other_machine" for cause in named)
    return Assessment(unit, found, tuple(named), notes, quantities(found, named, delay), law, delay if known else None)


def _judged(readings: Readings, machine: Machine, unit: AngleUnit, evidence: Evidence) -> Judged | None:
    """Infer the record's posterior; for another gear ratio estimate the shaft's motion again."""
    configured, ratio = hypothesis_of(machine), 1.0
    posterior, by_speed = _inferred(evidence, machine, configured, RATIOS)
    if posterior is None:
        return None
    beside = abs(posterior.hypothesis.turn / configured.turn)
    if abs(beside - 1.0) > 1e-9:
        evidence = gather(readings, machine, unit, beside)
        configured, ratio = replace(configured, turn=configured.turn / beside), beside
        posterior, by_speed = _inferred(evidence, machine, configured, (beside,))
        if posterior is None:
            return None
    whole, changing = evidence, None
    for _ in range(_CHANGES):
        found = change_in_time(whole, posterior)
        if found is None:
            break
        changing, evidence = found, replace(whole, torque_Nm=whole.torque_Nm - found.torque_Nm)
        posterior, by_speed = _inferred(evidence, machine, configured, (1.0,))
        if posterior is None:
            return None
    lines = _time_lines(evidence, posterior)
    if lines:
        quiet = evidence.torque_Nm - sum(line.at(evidence.time_s) for line in lines)
        evidence = replace(evidence, torque_Nm=quiet)
        posterior, by_speed = _inferred(evidence, machine, configured, (1.0,))
        if posterior is None:
            return None
    return Judged(evidence, posterior, ratio, _encoder_turn(machine), posterior.explained, by_speed, lines, changing)


def _judged_elastically(
    readings: Readings, machine: Machine, unit: AngleUnit, evidence: Evidence, begin: Begin
) -> Judged | None:
    """Infer the posterior with the elastic shaft free beside sensors, loads and bodies; None if it does not settle."""
    torque, configured = elastic_torque(readings, unit, machine), hypothesis_of(machine)
    if torque is None:
        return None
    late = evidence.time_s - configured.delay_s
    after = np.clip(np.searchsorted(torque.time_s, late), 1, torque.time_s.size - 1)
    beside = np.minimum(np.abs(torque.time_s[after] - late), np.abs(late - torque.time_s[after - 1])) < _BESIDE_S
    evidence = replace(evidence, time_s=evidence.time_s[beside], torque_Nm=evidence.torque_Nm[beside], ripple=Ripple())
    posterior = infer_elastic(record_of(evidence), torque, configured, begin) if beside.any() else None
    if posterior is None:
        return None
    evidence = replace(evidence, predicted=posterior.measurement.record.predicted)
    lines = _time_lines(evidence, posterior)
    if lines:
        quiet = evidence.torque_Nm - sum(line.at(evidence.time_s) for line in lines)
        evidence = replace(evidence, torque_Nm=quiet)
        posterior = infer(record_of(evidence), torque.machine, configured, (1.0,)) or posterior
    return Judged(evidence, posterior, 1.0, _encoder_turn(machine), posterior.explained, 0.0, lines)


def _time_lines(evidence: Evidence, posterior: Posterior) -> tuple[TimeLine, ...]:
    """Find lines fixed in time in the residual of all samples, or of runs where the torque is filtered."""
    h = posterior.hypothesis
    m = posterior.measurement.on(record_of(evidence.in_runs() if h.filters else evidence, most=_LINE_SAMPLES))
    residual, good = m.residual(h, posterior.fit.x)
    if np.count_nonzero(good) < _FEWEST_FOR_LINES:
        return ()
    time, theta = m.record.time_s[good], m.record.motion.at(m.record.time_s[good])[0]
    lines = time_lines(time, residual[good], theta, m.record.speed_rad_s)
    uncertain = abs(h.gain) * m.uncertain_Nm  # orders that the encoder does not resolve look like lines at one speed
    return tuple(line for line in lines if line.amplitude_Nm > uncertain)


def _inferred(
    evidence: Evidence, machine: Machine, configured: Hypothesis, ratios: tuple[float, ...]
) -> tuple[Posterior | None, float]:
    """Return the posterior and the fall of the torque with the speed [N m s].

    Under a speed-controlled drive, or where they exceed the noise, the errors of single accelerations are correlated
    with the torque; those of means over a tenth of a turn are not.
    """
    turning = evidence.in_blocks().thinned(_MOST_GOVERNED)
    by_speed = torque_by_speed(turning, configured.delay_s)
    rotor = not TabulatedTorque(machine, (), {}).depends_on_angle()
    if rotor:  # another ratio is the same as another inertia
        ratios = ratios[:1]
    found = _posterior(evidence, bool(by_speed), bool(by_speed), rotor, machine, configured, ratios)
    if found is not None and not by_speed:
        by_speed = torque_by_speed(turning, found.hypothesis.delay_s + found.value(DELAY))
        if by_speed or found.is_motion_uncertain:
            averaged = _posterior(evidence, bool(by_speed), True, rotor, machine, configured, ratios)
            # a torque that itself steps between two samples has worse averages
            if by_speed or (averaged is not None and averaged.fit.rms < found.fit.rms):
                found = averaged
    return found, by_speed


def _posterior(
    evidence: Evidence,
    speed_controlled: bool,
    averaged: bool,
    rotor: bool,
    machine: Machine,
    configured: Hypothesis,
    ratios: tuple[float, ...],
) -> Posterior | None:
    """Infer the posterior of the record, of departures or of a force law; filters are judged on runs of it."""
    record, runs = (
        record_of(each, speed_controlled, rotor, averaged=averaged) for each in (evidence, evidence.in_runs())
    )
    laws = ForceLaws(evidence, machine, _encoder_turn(machine), runs)
    found = infer(record, machine, configured, ratios, runs, laws.at_once)
    return None if found is None else laws.likelier(found)


def _unit(readings: Readings) -> AngleUnit:
    """Return the unit of the angle while there is torque, or of all angles if that does not show it.

    The driver may have been corrected before the torque sensor was switched on.
    """
    stamps, measured = readings.angle_stamps_ns, readings.torque_stamps_ns[np.isfinite(readings.torque)]
    inside = (stamps >= measured[0]) & (stamps <= measured[-1])
    if np.count_nonzero(np.isfinite(readings.angle[inside])) >= _FEWEST_ANGLES:
        unit = angle_unit(readings.angle[inside])
        if unit.wrapped:
            return unit
    return angle_unit(readings.angle)


def _encoder_turn(machine: Machine) -> float:
    """Shaft angle after which a wrapped encoder repeats its reading."""
    return TURN * machine.sensors.encoder.ratio


def _other_unit(
    readings: Readings, machine: Machine, first: tuple[AngleUnit, Judged | None]
) -> tuple[AngleUnit, Judged | None]:
    """Return the unit that explains the record best, among those that give a plausible speed."""
    best = first
    for name, turn in OTHER_UNITS:
        unit = AngleUnit(name, turn, wrapped=False)
        evidence = gather(readings, machine, unit)
        if unusable_reason(evidence) or not _PLAUSIBLE_RAD_S[0] < abs(evidence.working_speed()) < _PLAUSIBLE_RAD_S[1]:
            continue
        found = _judged(readings, machine, unit, evidence)
        if found is not None and (best[1] is None or 1.0 - found.explained < 0.5 * (1.0 - best[1].explained)):
            best = (unit, found)
    return best


def _notes(evidence: Evidence) -> tuple[str, ...]:
    notes = []
    if evidence.at_ends_Nm.size:
        ends = np.unique(evidence.at_ends_Nm)
        notes.append(range_end_note(evidence.at_ends_Nm.size, ends, "the verdict is"))
    if evidence.stuck[1].size:
        seconds, values = evidence.stuck[0], " and ".join(f"{value:.4g}" for value in evidence.stuck[1][:_MOST_LISTED])
        notes.append(
            f"the torque stays at {values} N m for {seconds:.1f} s while the shaft turns: a sensor or a driver that"
            " stopped; the verdict is without it"
        )
    step = np.diff(evidence.track.time_s)
    gaps, uncertain = evidence.track.gaps
    if uncertain.any():
        place = np.clip(np.searchsorted(evidence.track.time_s, evidence.time_s, side="right") - 1, 0, step.size - 1)
        notes.append(
            f"{np.count_nonzero(uncertain[place])} torques left out: the shaft's acceleration is too uncertain there"
        )
    if gaps.any():
        longest = float(step[gaps].max())
        notes.append(
            f"{np.count_nonzero(gaps)} gaps in the shaft angle, {float(step[gaps].sum()):.2f} s in all, the longest"
            f" {longest:.2f} s: torque inside them does not count"
        )
    if evidence.slips:
        first, last = evidence.track.time_s[[0, -1]].tolist()
        listed = ", ".join(f"{np.degrees(by):+.1f} deg at {at:.3f} s" for at, by in evidence.slips[:_MOST_LISTED])
        more = f" and {len(evidence.slips) - _MOST_LISTED} times more" if len(evidence.slips) > _MOST_LISTED else ""
        notes.append(
            f"the shaft angle leaps as no shaft does, an encoder that slips or was reset: {listed}{more}, from the"
            f" first angle on; the verdict is of the part from {first:.2f} to {last:.2f} s alone"
        )
    elif evidence.track.slips >= SOME_SLIPS:
        notes.append(
            f"the shaft angle leaps {evidence.track.slips} times as no shaft does, and torque there is wrong: an"
            " encoder that slips, or a controller that is polled by another clock (--stamp-jitter, 0.3 of its cycle)"
        )
    return tuple(notes)
