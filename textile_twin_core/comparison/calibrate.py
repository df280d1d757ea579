"""Calibrate: encoder and torque sensor of a machine settled from one recording."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from textile_twin_core.comparison.assess import Assessment, assess
from textile_twin_core.comparison.evidence import Settings
from textile_twin_core.comparison.explain import ALL_SAMPLES, INERTIA, Explanation
from textile_twin_core.comparison.identifiable import identifiable
from textile_twin_core.comparison.readings import Readings
from textile_twin_core.comparison.rest import rest_reading
from textile_twin_core.comparison.result import plain
from textile_twin_core.comparison.settings_fit import SettingsFit, fit_settings
from textile_twin_core.comparison.shaft_track import TURN
from textile_twin_core.comparison.stage import Begin, unheard
from textile_twin_core.comparison.stamp_timing import widened
from textile_twin_core.comparison.torque_units import nearest_gain
from textile_twin_core.comparison.uncertainty import Estimate, estimates
from textile_twin_core.comparison.verdict import NOT_THIS_MACHINE
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Machine
from textile_twin_core.machine.sensors import Sensors, TorqueSensor

_TOLD = 0.005
"""Sigma over value from which on a gain is not told apart from the loads."""
_LEAST_LOAD, _SIGMAS = 0.01, 4.0
"""By so much, and so many standard deviations, loads are other than declared; the latter holds for offsets, too."""

_MOST_LEFT = 0.5
"""Share of the RMS error that an encoder or a sensor turned round may leave at most: else it explains nothing."""
_JUDGED = 0.8
"""Share of all work at which the verdict is there."""
_FREE_REST = "it takes a few seconds with the shaft at rest, the machine unclamped"


@dataclass(frozen=True)
class Ambiguity:
    """What a recording cannot tell apart: the settings, in words, and what would tell."""

    between: tuple[str, ...]
    text: str
    recording: str


@dataclass(frozen=True)
class Calibration:
    """Sensors as a recording shows them; shaft = (measured - zero) * direction * ratio, as in a machine file.

    The torque sensor's gain in a machine file is sign * unit_factor * gain.

    Attributes:
        angle_unit: of the logged angle. direction, ratio, zero_rad: the encoder's.
        sign, unit_factor, unit: of the torque. gain, offset_Nm, delay_s: of the torque sensor.
        ambiguous: what this recording cannot tell.
        rms_before_Nm, rms_after_Nm: of the residual while the shaft turns, sensors as they were and as settled.
        rms_beside_Nm: what is left when friction, loads and drift that the file does not get are taken off too.
        assessment: the verdict on the settings as they were. machine: the machine with the sensors settled.
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


def calibrate(readings: Readings, machine: Machine, begin: Begin = unheard) -> Calibration:
    """Settle direction, ratio and zero of the encoder, and sign, unit, gain, offset and delay of the torque sensor.

    Discrete settings are those of the likeliest hypothesis (see `search`), continuous ones are fitted to all samples,
    with what else departs (loads, friction) fitted beside them. Intervals are by `uncertainty_by_turns`.
    `begin` hears of each stage.

    Raises RecordingError when the recording tells nothing, is of another machine, or what it asks for explains no more.
    """
    begin("judging", _JUDGED)
    assessment = assess(readings, machine)
    begin("settling", 1.0)
    found = assessment.explanation
    if found is None:
        raise RecordingError("; ".join(assessment.notes))
    foreign = [c.text for c in assessment.verdict if c.cause in ("stamps_in_bursts", "other_machine")]
    if 1.0 - found.explained > NOT_THIS_MACHINE and foreign:
        text = foreign[0]
        raise RecordingError(f"no calibration from this recording: {text}")
    fit, at_rest = _with_rest(found, _final_fit(found))
    fit, told = _beside_loads(found, fit)
    known = estimates(fit)
    settings = fit.settings
    turned = settings.direction * machine.sensors.encoder.ratio * settings.ratio / found.configured.ratio
    near = nearest_gain(settings.gain, 1.0)
    before, after = _rms(found, found.configured), _rms(found, _sensors_alone(settings, found.configured))
    mirrored = settings.direction != found.configured.direction or settings.gain * found.configured.gain < 0.0
    if (mirrored or settings.ratio != found.configured.ratio) and after > _MOST_LEFT * before:
        raise RecordingError(
            f"no calibration from this recording: another direction, sign or ratio takes its RMS error from"
            f" {before:.3g} to {after:.3g} N m only, so the fault lies elsewhere; see what compare tells of it"
        )
    zero = known.get("zero_rad", Estimate(settings.zero_rad)).scaled(1.0 / turned)
    zero = zero.scaled(1.0, _whole_turns(zero.value, machine.sensors.encoder.zero_rad, TURN / abs(turned)))
    gain = known.get("gain", Estimate(settings.gain)).scaled(1.0 / near.gain)
    offset = known.get("offset_Nm", at_rest or Estimate(settings.offset_Nm))
    delay = widened(known.get("delay_s", Estimate(settings.delay_s)), readings.stamped)
    encoder = replace(machine.sensors.encoder, zero_rad=zero.value, direction=settings.direction, ratio=abs(turned))
    sensor = TorqueSensor(settings.gain, offset.value, delay.value)
    return Calibration(
        angle_unit=assessment.unit.name,
        direction=settings.direction,
        ratio=abs(turned),
        zero_rad=zero,
        sign=near.sign,
        unit_factor=near.factor,
        unit=near.unit or "N m",
        gain=gain,
        offset_Nm=offset,
        delay_s=delay,
        ambiguous=tuple(_ambiguous(assessment, found, fit, abs(turned), told, offset)),
        rms_before_Nm=before,
        rms_after_Nm=after,
        rms_beside_Nm=fit.rms,
        assessment=assessment,
        machine=replace(machine, sensors=Sensors(encoder, sensor)),
    )


def _final_fit(found: Explanation) -> SettingsFit:
    """All sensor settings that the record can tell, fitted to all of its samples."""
    free = {*found.departing, "gain"} | ({"zero_rad"} if found.evidence.terms.has_zero else set())
    is_one = bool(found.governed_Nms) and INERTIA in free
    if found.one_speed:
        free -= {"zero_rad"} if is_one or "delay_s" in found.departing else {"delay_s"}
    elif not is_one:
        free |= {"delay_s"}
    if found.offset_at_rest is not None:
        free = (free | {"constant_Nm"}) - {"offset_Nm"}
    elif "offset_Nm" in found.departing or found.evidence.turns_both_ways():
        free |= {"offset_Nm"}
    elif found.rest_tells or "viscous_Nms" in free:
        free |= {"constant_Nm"}  # friction, then: at rest the sensor shows none of it
    elif "constant_Nm" not in free:
        free |= {"offset_Nm"}
    return fit_settings(found.weighed.thinned(ALL_SAMPLES), found.settings, free)


def _with_rest(found: Explanation, fit: SettingsFit) -> tuple[SettingsFit, Estimate | None]:
    """The fit with the torque sensor's offset as the shaft at rest shows it, and that offset where there is one.

    It counts by its sigma: what is too small to accuse anybody of is an offset all the same, which left out reads as
    friction. What is not significant leaves the offset as configured, and known by the rest. A shaft held at rest shows
    a torque that is gone while it turns, or whose friction would help it on: of that none is the sensor's.
    """
    if found.offset_at_rest is not None or not found.rest_tells or "constant_Nm" not in fit.free:
        return fit, found.offset_at_rest
    settings, turning = fit.settings, estimates(fit)["constant_Nm"]
    shown = rest_reading(found.evidence, settings)
    if shown is None:
        return fit, None
    if not _significant(shown):
        return fit, _kept(settings.offset_Nm, shown.scaled(1.0, settings.offset_Nm))
    if not _significant(turning):
        return fit, None
    way = float(np.sign(settings.direction * found.evidence.working_speed()))
    friction = settings.constant_Nm - shown.value * way / settings.gain
    sigma = math.hypot(turning.sigma, shown.sigma / settings.gain)
    if friction < -found.evidence.terms.coulomb_Nm - _SIGMAS * sigma:
        return fit, None
    start = replace(settings, constant_Nm=friction, offset_Nm=settings.offset_Nm + shown.value)
    fit = fit_settings(found.weighed.thinned(ALL_SAMPLES), start, fit.free)
    return fit, shown.scaled(1.0, settings.offset_Nm)


def _kept(value: float, shown: Estimate) -> Estimate:
    """A value that is kept beside what was shown instead: how far off it may be, and the interval of both."""
    low, high = shown.interval95
    return Estimate(value, math.hypot(shown.sigma, shown.value - value), (min(low, value), max(high, value)))


def _significant(estimate: Estimate) -> bool:
    return abs(estimate.value) > _SIGMAS * estimate.sigma


def _beside_loads(found: Explanation, fit: SettingsFit) -> tuple[SettingsFit, bool]:
    """The fit with the loads free too, where they are other than declared; whether gain and loads can be told apart.

    Loads a little stronger than declared, too little to be named as a departure, are no gain of the sensor.
    """
    if not found.evidence.terms.has_load:
        return fit, True
    told = found.configured.load
    if "load" in fit.free:
        load = estimates(fit)["load"]
        if abs(load.value - told) > max(_LEAST_LOAD, _SIGMAS * load.sigma):
            return fit, True
        # What the verdict took for loads is all of the gain, once that is free.
        free = [name for name in fit.free if name != "load"]
        return fit_settings(found.weighed.thinned(ALL_SAMPLES), replace(fit.settings, load=told), free), True
    beside = fit_settings(found.weighed.thinned(ALL_SAMPLES), fit.settings, {*fit.free, "load"})
    kept, _ = identifiable(beside.jacobian[beside.good], beside.free, ("load",))
    known = estimates(beside)
    gain, load = known["gain"], known["load"]
    if "load" not in kept or gain.sigma > _TOLD * abs(gain.value):
        return fit, False
    away = abs(load.value - told)
    return (beside if away > max(_LEAST_LOAD, _SIGMAS * load.sigma) else fit), True


def _ambiguous(
    assessment: Assessment, found: Explanation, fit: SettingsFit, ratio: float, told: bool, offset: Estimate
) -> list[Ambiguity]:
    ambiguous = []
    if found.one_speed:
        kept = "delay" if "delay_s" in fit.free else "zero"
        ambiguous.append(
            Ambiguity(
                ("zero_rad", "torque.delay_s"),
                f"at one speed a zero is a delay; all of it was taken as {kept}",
                "it takes a run-up, a coast-down or two speeds that differ by a fifth",
            )
        )
    if found.governed_Nms:
        kept = "inertia" if INERTIA in fit.free else "delay"
        ambiguous.append(
            Ambiguity(
                ("torque.delay_s", "inertia"),
                "where the torque follows the speed, a delay looks like a rotor or a flywheel that the file does not"
                f" have; all of it was taken as {kept}",
                "no recording under this controller tells; one that holds the speed more stiffly tells better",
            )
        )
    if not found.rest_tells and not found.evidence.turns_both_ways():
        ambiguous.append(
            Ambiguity(
                ("torque.offset_Nm", "shaft_coulomb_Nm"),
                "while the shaft turns one way, an offset of the torque sensor looks like dry friction",
                _FREE_REST,
            )
        )
    elif not math.isfinite(offset.sigma):
        ambiguous.append(
            Ambiguity(
                ("torque.offset_Nm", "shaft_coulomb_Nm"),
                "the torque at rest does not go with that of the turning shaft, as where a brake holds it: no offset of"
                " the torque sensor was taken from it",
                _FREE_REST,
            )
        )
    if not told:
        ambiguous.append(
            Ambiguity(
                ("torque.gain", "load"),
                "a gain of the torque sensor looks like stronger loads; those of the machine file were taken as right",
                "it takes several speeds up to the highest, or some turns without the load",
            )
        )
    if assessment.unit.wrapped and ratio < 0.75:
        parts = round(1.0 / ratio)
        ambiguous.append(
            Ambiguity(
                ("zero_rad",),
                f"the encoder turns {parts} times in a turn of the shaft and begins anew each time: this zero holds"
                " until it is switched off",
                "no recording tells; use an encoder on the shaft itself, or one that counts its turns",
            )
        )
    if assessment.repeating_Nm:
        ambiguous.append(
            Ambiguity(
                ("zero_rad", "torque.gain", "torque.delay_s", "masses", "joint_friction"),
                f"up to {assessment.repeating_Nm:.2g} N m that repeat with the shaft's angle are left: wrong masses or"
                " friction of a joint look like this, and in part like these settings, whose intervals do not hold it",
                "no recording tells; weigh the links, declare friction of joints and every load, then calibrate again",
            )
        )
    if not found.evidence.terms.has_zero:
        ambiguous.append(
            Ambiguity(
                ("zero_rad",),
                "the torque of this machine does not depend on the shaft's angle: the zero stays as configured",
                "no recording tells",
            )
        )
    for other in found.others:
        s = other.fit.settings
        ambiguous.append(
            Ambiguity(
                ("direction", "torque.sign"),
                f"direction {s.direction:+d}, ratio {s.ratio:.4g} and a torque gain of {s.gain:+.3g} do as well",
                "a recording with another speed, or at rest, would tell",
            )
        )
    return ambiguous


def _whole_turns(value: float, near: float, turn: float) -> float:
    """Whole turns that bring a value nearest to another."""
    return turn * float(np.rint((near - value) / turn))


def _sensors_alone(settings: Settings, configured: Settings) -> Settings:
    """What a machine file gets of settings: those of the sensors; friction, loads and drift stay as configured."""
    beside = ("drift", "load", "constant_Nm", "viscous_Nms", INERTIA)
    return settings.changed({name: getattr(configured, name) for name in beside})


def _rms(found: Explanation, settings: Settings) -> float:
    """RMS of the residual with some settings, over samples of the turning shaft [N m]."""
    evidence = found.weighed.thinned()
    left, good = evidence.left(settings, evidence.states(settings))
    return float(np.sqrt(np.mean(left[good] ** 2))) if good.any() else math.nan
