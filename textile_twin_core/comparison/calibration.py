"""Calibration of the sensors from one recording, with uncertainties and ambiguities."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from textile_twin_core.comparison.assessment import Assessment, assess
from textile_twin_core.comparison.cause import WRONG_FIRST
from textile_twin_core.comparison.causes import NOT_THIS_MACHINE
from textile_twin_core.comparison.gather import hypothesis_of
from textile_twin_core.comparison.judged import Judged
from textile_twin_core.comparison.readings import Readings
from textile_twin_core.comparison.result import plain
from textile_twin_core.comparison.shaft_track import TURN
from textile_twin_core.comparison.stage import Begin, unheard
from textile_twin_core.comparison.stamp_timing import widened
from textile_twin_core.comparison.uncertainty import Estimate
from textile_twin_core.errors import RecordingError
from textile_twin_core.inference.measurement import Hypothesis
from textile_twin_core.inference.parameter import DELAY, GAIN, HELD, OFFSET, ROTOR, SENSORS, ZERO, gain_factor
from textile_twin_core.inference.torque_units import nearest_gain
from textile_twin_core.machine import Machine

_CONTINUOUS = (ZERO, DELAY, GAIN, OFFSET)
_NO_WORSE = 1.0 + 1e-9
_MOST_LEFT = 0.5
"""Largest share of the RMS error that a reversed encoder or sensor may leave; above it the reversal is refused."""
_JUDGED = 0.8
"""Share of all work at which the verdict is ready."""
_FREE_REST = "it takes a few seconds with the shaft at rest, the machine unclamped"


@dataclass(frozen=True)
class Ambiguity:
    """Settings that a recording cannot separate, in words, and a recording that would."""

    between: tuple[str, ...]
    text: str
    recording: str


@dataclass(frozen=True)
class Calibration:
    """Estimated sensors; shaft = (measured - zero) * direction * ratio, as in a machine file.

    The torque sensor's gain in a machine file is sign * unit_factor * gain.

    Attributes:
        angle_unit: of the logged angle. direction, ratio, zero_rad: the encoder's.
        sign, unit_factor, unit: of the torque. gain, offset_Nm, delay_s: of the torque sensor.
        given_file: estimates by name, given that all other numbers of the file are exactly right.
        ambiguous: settings that this recording cannot separate.
        rms_before_Nm, rms_after_Nm: RMS residual while the shaft turns, with configured and estimated sensors.
        rms_beside_Nm: RMS residual without the friction, loads and drift that are not written to the file.
        assessment: the verdict on the configured sensors. machine: the machine with the estimated sensors.

    Examples:
        >>> import textile_twin_core as ttc
        >>> from textile_twin_core.comparison import Readings, calibrate
        >>> from textile_twin_core.recordings import open_bag
        >>> bag = open_bag("bags/tufting_160rpm_synthetic")
        >>> angle, torque = bag.read_angles(), bag.read_torques("balancing_torque/measured")
        >>> readings = Readings(angle.stamps, angle.angles_rad, torque.stamps, torque.torque_Nm)
        >>> calibrate(readings, ttc.machines.tufting()).delay_s.value  # [s]  # doctest: +SKIP
        0.00202
    """

    angle_unit: str
    direction: int
    ratio: float
    zero_rad: Estimate
    sign: int
    unit_factor: float
    unit: str
    gain: Estimate
    offset_Nm: Estimate
    delay_s: Estimate
    given_file: Mapping[str, Estimate]
    ambiguous: tuple[Ambiguity, ...]
    rms_before_Nm: float
    rms_after_Nm: float
    rms_beside_Nm: float
    assessment: Assessment
    machine: Machine

    def to_json(self) -> dict[str, Any]:
        """One object of plain lists and numbers."""
        out: dict[str, Any] = plain(
            {
                "angle_unit": self.angle_unit,
                "direction": self.direction,
                "ratio": self.ratio,
                "zero_rad": dataclasses.asdict(self.zero_rad),
                "torque": {
                    "sign": self.sign,
                    "unit_factor": self.unit_factor,
                    "unit": self.unit,
                    "gain": dataclasses.asdict(self.gain),
                    "offset_Nm": dataclasses.asdict(self.offset_Nm),
                    "delay_s": dataclasses.asdict(self.delay_s),
                },
                "given_file": {name: dataclasses.asdict(each) for name, each in self.given_file.items()},
                "ambiguous": [dataclasses.asdict(each) for each in self.ambiguous],
                "rms_before_Nm": self.rms_before_Nm,
                "rms_after_Nm": self.rms_after_Nm,
                "rms_beside_Nm": self.rms_beside_Nm,
                "explained": self.assessment.explained,
                "verdict": [dataclasses.asdict(cause) for cause in self.assessment.verdict],
                "notes": list(self.assessment.notes),
            }
        )
        return out


def _fit_of(found: Judged, machine: Machine) -> tuple[frozenset[str], float, float, float]:
    """Return the parameters to write, and the RMS error as configured, with these alone, and with all estimates."""
    chain = frozenset(found.posterior.measurement.off_nominal_chain(found.posterior.off_nominal))
    written = chain.union(_CONTINUOUS)
    before, after, beside = _rms(found, hypothesis_of(machine)), _rms(found, None, written), _rms(found, None)
    if not after <= before:  # estimates within their intervals fit beside friction and loads that the file has not
        written = chain | found.posterior.off_nominal.intersection(_CONTINUOUS)
        after = _rms(found, None, written)
    return written, before, after, beside


def calibration_refusal(assessment: Assessment, machine: Machine) -> str:
    """Say why `calibrate` writes no sensors from a record that determines some; empty where it does."""
    found = assessment.found
    assert found is not None
    short = found.unexplained > NOT_THIS_MACHINE
    reasons = ("other_machine", "stamps_in_bursts") if short else ("other_machine",)
    foreign = [c.text for c in assessment.verdict if c.cause in reasons]
    if foreign:
        return foreign[0]
    _, before, after, _ = _fit_of(found, machine)
    configured, hypothesis = hypothesis_of(machine), found.posterior.hypothesis
    mirrored = hypothesis.turn * configured.turn < 0.0 or hypothesis.gain * configured.gain < 0.0
    if (mirrored or found.ratio != 1.0) and after > _MOST_LEFT * before:
        return (
            f"another direction, sign or ratio takes its RMS error from {before:.3g} to {after:.3g} N m only, so the"
            " fault lies elsewhere; correct by hand in the machine file what compare names first, or what you know to"
            " be wrong"
        )
    if after > _NO_WORSE * before:
        found_first = any(cause.cause in WRONG_FIRST for cause in assessment.verdict)
        return (
            "without the friction and loads that the file lacks, corrected sensors take its RMS error from"
            f" {before:.3g} to {after:.3g} N m; "
            + (
                "correct by hand in the machine file what compare names first"
                if found_first
                else "write these first with textile-twin identify --out"
            )
        )
    return ""


def calibrate(readings: Readings, machine: Machine, begin: Begin = unheard) -> Calibration:
    """Estimate direction, ratio and zero of the encoder, and sign, unit, gain, offset and delay of the torque sensor.

    Values, standard deviations and intervals allow for the tolerances of the file (see `Settled`).

    Args:
        readings: the recording.
        machine: the machine as configured.
        begin: called at each stage.

    Returns:
        The estimates, and the machine with them.

    Raises:
        RecordingError: the recording determines nothing, is of another machine, or a reversal it asks for does not
            explain more.

    Examples:
        >>> import textile_twin_core as ttc
        >>> from textile_twin_core.comparison import Readings, calibrate
        >>> from textile_twin_core.recordings import open_bag
        >>> bag = open_bag("bags/tufting_160rpm_synthetic")
        >>> angle, torque = bag.read_angles(), bag.read_torques("balancing_torque/measured")
        >>> readings = Readings(angle.stamps, angle.angles_rad, torque.stamps, torque.torque_Nm)
        >>> calibrate(readings, ttc.machines.tufting()).direction  # doctest: +SKIP
        1
    """
    begin("judging", _JUDGED)
    assessment = assess(readings, machine)
    begin("settling", 1.0)
    found = assessment.found
    if found is None:
        raise RecordingError("; ".join(assessment.notes))
    written, before, after, beside = _fit_of(found, machine)
    if refusal := calibration_refusal(assessment, machine):
        raise RecordingError(f"no calibration from this recording: {refusal}")
    hypothesis = found.posterior.hypothesis
    direction = 1 if hypothesis.turn > 0.0 else -1
    turned = direction * machine.sensors.encoder.ratio * found.ratio
    m = found.posterior.measurement
    chain = frozenset(m.off_nominal_chain(found.posterior.off_nominal))
    gain_now = found.sensors.gain if GAIN in written else hypothesis.gain
    near = nearest_gain(gain_now, 1.0)
    zero = _estimate(found, ZERO, hypothesis.zero_rad, written=written).scaled(1.0 / turned)
    zero = zero.scaled(1.0, _whole_turns(zero.value, machine.sensors.encoder.zero_rad, TURN / abs(turned)))
    gain = _gain(found) if GAIN in written else replace(_gain(found), value=hypothesis.gain)
    gain = gain.scaled(1.0 / near.gain)
    offset = _estimate(found, OFFSET, hypothesis.offset_Nm, hypothesis.unit, written)
    delay = widened(_estimate(found, DELAY, hypothesis.delay_s, written=written), readings.stamped)
    encoder = replace(machine.sensors.encoder, zero_rad=zero.value, direction=direction, ratio=abs(turned))
    sensor = replace(machine.sensors.torque, gain=gain_now, offset_Nm=offset.value, delay_s=delay.value)
    own = replace(machine.sensors, encoder=encoder, torque=sensor)
    given = {
        "zero_rad": _given_file(found, ZERO, hypothesis.zero_rad).scaled(1.0 / turned),
        "torque.gain": _gain(found, given_file=True).scaled(1.0 / near.gain),
        "torque.offset_Nm": _given_file(found, OFFSET, hypothesis.offset_Nm, hypothesis.unit),
        "torque.delay_s": widened(_given_file(found, DELAY, hypothesis.delay_s), readings.stamped),
    }
    return Calibration(
        angle_unit=assessment.unit.name,
        direction=direction,
        ratio=abs(turned),
        zero_rad=zero,
        sign=near.sign,
        unit_factor=near.factor,
        unit=near.unit or "N m",
        gain=gain,
        offset_Nm=offset,
        delay_s=delay,
        given_file=given,
        ambiguous=tuple(_ambiguous(assessment, found, abs(turned))),
        rms_before_Nm=before,
        rms_after_Nm=after,
        rms_beside_Nm=beside,
        assessment=assessment,
        machine=replace(machine, sensors=m.chain_sensors(own, found.settled.tolerant.x, chain)),
    )


def _estimate(
    found: Judged, name: str, configured: float, unit: float = 1.0, written: Collection[str] = _CONTINUOUS
) -> Estimate:
    """Estimated sensor value, the configured one included, with its interval; the configured one where not written."""
    settled = found.settled
    if name not in settled.free:
        return Estimate(configured)
    low, high = settled.interval95(name)
    estimate = Estimate(settled.value(name), settled.sigma(name), (low, high)).scaled(unit, configured)
    return estimate if name in written else replace(estimate, value=configured)


def _given_file(found: Judged, name: str, configured: float, unit: float = 1.0) -> Estimate:
    """Estimated sensor value, given that all other numbers of the file are exactly right."""
    if name not in found.settled.free:
        return Estimate(configured)
    value, sigma = found.settled.given_file(name)
    return Estimate.normal(value, sigma).scaled(unit, configured)


def _gain(found: Judged, given_file: bool = False) -> Estimate:
    """Estimated gain with sign and unit (see `gain_factor` of its parameter)."""
    settled, gain = found.settled, found.posterior.hypothesis.gain
    value, sigma = settled.given_file(GAIN) if given_file else (settled.value(GAIN), settled.sigma(GAIN))
    factor = gain_factor(value)
    ends = sorted(gain * gain_factor(min(value + side * 1.96 * sigma, 0.99)) for side in (-1.0, 1.0))
    return Estimate(gain * factor, abs(gain) * factor**2 * sigma, (ends[0], ends[1]))


def _rms(found: Judged, hypothesis: Hypothesis | None, names: Collection[str] | None = None) -> float:
    """RMS of the residual [N m] while the shaft turns, for a hypothesis or for the estimates.

    names: apply the estimates of these parameters only, as the machine file gets them; None: of all.
    """
    m = found.posterior.measurement
    x = m.nominal.copy()
    if hypothesis is None:
        hypothesis, wanted = found.posterior.hypothesis, m.names if names is None else names
        for name in wanted:
            x[m.place[name]] = found.settled.value(name)
    elif found.ratio != 1.0:
        hypothesis = replace(hypothesis, turn=hypothesis.turn / found.ratio)
    residual, good = m.linearised(x, found.posterior.off_nominal).residual(hypothesis, x)
    return float(np.sqrt(np.mean(residual[good] ** 2))) if good.any() else math.nan


def _ambiguous(assessment: Assessment, found: Judged, ratio: float) -> list[Ambiguity]:
    p, settled, ambiguous = found.posterior, found.settled, list[Ambiguity]()
    if p.measurement.record.one_speed:
        kept = "delay" if DELAY in settled.free else "zero"
        ambiguous.append(
            Ambiguity(
                ("zero_rad", "torque.delay_s"),
                f"at one speed a zero is a delay; all of it was taken as {kept}",
                "it takes a run-up, a coast-down or two speeds that differ by a fifth",
            )
        )
    if found.torque_by_speed_Nms:
        kept = "inertia" if ROTOR in p.off_nominal else "delay"
        ambiguous.append(
            Ambiguity(
                ("torque.delay_s", "inertia"),
                "where the torque follows the speed, a delay looks like a rotor or a flywheel that the file does not"
                f" have; all of it was taken as {kept}",
                "no recording under this controller tells; one that holds the speed more stiffly tells better",
            )
        )
    if HELD in p.off_nominal:
        ambiguous.append(
            Ambiguity(
                ("torque.offset_Nm", "shaft_coulomb_Nm"),
                "the torque at rest does not go with that of the turning shaft, as where a brake holds it: no offset of"
                " the torque sensor was taken from it",
                _FREE_REST,
            )
        )
    elif OFFSET not in settled.free:
        ambiguous.append(
            Ambiguity(
                ("torque.offset_Nm", "shaft_coulomb_Nm"),
                "while the shaft turns one way, an offset of the torque sensor looks like dry friction",
                _FREE_REST,
            )
        )
    for name in p.off_nominal.intersection(SENSORS):
        others = [other for other in p.equivalents(name) if other != HELD and {name, other} != {ZERO, DELAY}]
        if others:
            ambiguous.append(
                Ambiguity(
                    (name.removeprefix("sensors.").removeprefix("encoder."), *others),
                    f"{', '.join(others)} wrong in the machine file explains this recording as well as {name}",
                    "a recording at another speed, without the load or at standstill may tell; else measure the part",
                )
            )
    if assessment.unit.wrapped and ratio < 0.75:
        parts = round(1.0 / ratio)
        ambiguous.append(
            Ambiguity(
                ("zero_rad",),
                f"the encoder turns {parts} times in a turn of the shaft and wraps each time: this zero holds"
                " until it is switched off",
                "no recording tells; use an encoder on the shaft itself, or one that counts its turns",
            )
        )
    if not p.measurement.model.depends_on_angle():
        ambiguous.append(
            Ambiguity(
                ("zero_rad",),
                "the torque of this machine does not depend on the shaft's angle: the zero stays as configured",
                "no recording tells",
            )
        )
    return ambiguous


def _whole_turns(value: float, near: float, turn: float) -> float:
    """Whole turns that bring a value closest to another."""
    return turn * float(np.rint((near - value) / turn))
