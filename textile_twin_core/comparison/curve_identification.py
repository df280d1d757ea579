"""Identification of a force law together with friction and sensors (`identify --curve`)."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from textile_twin_core.comparison.assessment import assess
from textile_twin_core.comparison.force_law import key_of, notes_of, with_law
from textile_twin_core.comparison.gather import hypothesis_of, record_of
from textile_twin_core.comparison.identifiable import NotIdentifiable
from textile_twin_core.comparison.identification import Identification, check_sensors
from textile_twin_core.comparison.identified_machine import ALWAYS
from textile_twin_core.comparison.judged import Judged
from textile_twin_core.comparison.readings import Readings
from textile_twin_core.comparison.result import curve_json
from textile_twin_core.comparison.shaft_track import TURN
from textile_twin_core.comparison.stage import Begin, unheard
from textile_twin_core.comparison.stamp_timing import widened
from textile_twin_core.comparison.uncertainty import Estimate
from textile_twin_core.comparison.unmodelled import unmodelled_torque
from textile_twin_core.dynamics.loads import ShaftFriction
from textile_twin_core.errors import RecordingError
from textile_twin_core.inference.curved_torque import place_of
from textile_twin_core.inference.force_law import learn_curve
from textile_twin_core.inference.learned_curve import LearnedCurve, learned
from textile_twin_core.inference.measurement import Measurement
from textile_twin_core.inference.parameter import (
    COULOMB,
    DELAY,
    GAIN,
    OFFSET,
    ROTOR,
    VISCOUS,
    ZERO,
    gain_factor,
)
from textile_twin_core.inference.priors import WorkingPoint, parameters
from textile_twin_core.inference.torque_model import TabulatedTorque
from textile_twin_core.machine import Machine

_NORMAL95 = 1.959964
_JUDGED, _LEARNED = 0.5, 0.9
"""Shares of all work at which the verdict and the law end."""


@dataclass(frozen=True)
class CurveIdentification(Identification):
    """An identification with force laws by name."""

    curves: dict[str, LearnedCurve] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """One object of plain lists and numbers."""
        return super().to_json() | {"curves": {name: curve_json(curve) for name, curve in self.curves.items()}}


def identify_curve(readings: Readings, machine: Machine, name: str, begin: Begin = unheard) -> CurveIdentification:
    """Learn the force over a measure, jointly with the sensors, friction and what departs from the file.

    Args:
        readings: the recording.
        machine: the machine.
        name: a load with a measure, or the position of a measure (see `place_of`).
        begin: called at each stage.

    Raises:
        MachineError: for a name that is neither.
        RecordingError: when the recording determines nothing, or a discrete setting of a sensor is wrong.
    """
    place, rest = place_of(machine, name)
    begin("judging", _JUDGED)
    assessment = assess(readings, machine)
    found = assessment.found
    if found is None:
        raise RecordingError("; ".join(assessment.notes))
    check_sensors(assessment, machine)
    begin("learning", _LEARNED)
    if assessment.law is None or assessment.law.curve.name != place.name:
        law = learn_curve(found.posterior, rest, place)
        found = replace(found, posterior=law.posterior, explained=law.posterior.explained)
    begin("weighing", 1.0)
    return _written(readings, machine, found)


def _written(readings: Readings, machine: Machine, found: Judged) -> CurveIdentification:
    p, settled = found.posterior, found.settled
    m, hypothesis = p.measurement, p.hypothesis
    curve = learned(p, settled.tolerant)
    values, fitted = dict[str, float](), dict[str, Estimate]()
    for parameter, public in ALWAYS.items():
        value, sigma = settled.value(parameter), settled.sigma(parameter)
        each = _public(machine, found, parameter, value, sigma)
        values[public] = each.value
        if parameter in settled.free:
            fitted[public] = widened(each, readings.stamped) if parameter == DELAY else each
    missing = tuple(
        NotIdentifiable(public, f"{public} is not identifiable beside the curve; it stays as configured")
        for parameter, public in ALWAYS.items()
        if parameter not in settled.free and parameter != ROTOR
    )
    samples = m.on(record_of(found.evidence))
    after, good = samples.residual(hypothesis, settled.tolerant.x)
    configured = _as_configured(samples, machine)
    before, also = configured.residual(hypothesis_of(machine), configured.nominal)
    both = good & also
    theta = samples.expected(hypothesis, settled.tolerant.x).theta[good]
    gain = hypothesis.gain * gain_factor(settled.value(GAIN))
    rest = unmodelled_torque(
        theta, after[good] / gain, np.floor(theta / TURN).astype(np.int64), machine.sensors.encoder.cycle_turns
    )
    notes = (*notes_of(curve, p, settled.tolerant, machine), *(each.text for each in missing))
    return CurveIdentification(
        parameters=fitted,
        fixed={name: value for name, value in values.items() if name not in fitted},
        not_identifiable=missing,
        rms_before_Nm=float(np.sqrt(np.mean(before[both] ** 2))),
        rms_after_Nm=float(np.sqrt(np.mean(after[both] ** 2))),
        unmodelled=rest,
        machine=_machine_with(machine, curve, values),
        notes=notes,
        curves={key_of(curve, machine): curve},
    )


def _public(machine: Machine, found: Judged, parameter: str, value: float, sigma: float) -> Estimate:
    """Return an estimate in the words of the results."""
    hypothesis = found.posterior.hypothesis
    half = _NORMAL95 * sigma
    low = found.posterior.parameter(parameter).low
    plain = Estimate(value, sigma, (max(value - half, low), max(value + half, low)))
    if parameter == GAIN:
        factor = gain_factor(value)
        ends = sorted(hypothesis.gain * gain_factor(end) for end in plain.interval95)
        return Estimate(hypothesis.gain * factor, abs(hypothesis.gain) * factor**2 * sigma, (ends[0], ends[1]))
    if parameter == ZERO:
        encoder = machine.sensors.encoder
        return plain.scaled(1.0, hypothesis.zero_rad).scaled(1.0 / (encoder.direction * encoder.ratio))
    nominal = found.posterior.parameter(ROTOR).nominal
    shift = {DELAY: hypothesis.delay_s, OFFSET: hypothesis.offset_Nm, ROTOR: -nominal}
    return plain.scaled(1.0, shift.get(parameter, 0.0))


def _as_configured(samples: Measurement, machine: Machine) -> Measurement:
    known, slots = parameters(machine, WorkingPoint(samples.working_torque_Nm, 1.0, 1.0))
    own = tuple(p for p in known if p.name not in slots)
    return Measurement(samples.record, TabulatedTorque(machine, own, {}), own, samples.working_torque_Nm)


def _machine_with(machine: Machine, curve: LearnedCurve, values: dict[str, float]) -> Machine:
    """Return the machine with the law, friction and sensors."""
    written = with_law(machine, curve)
    loads = [load for load in written.loads if not isinstance(load, ShaftFriction)]
    friction = ShaftFriction(*(max(values[ALWAYS[name]], 0.0) for name in (VISCOUS, COULOMB)))
    if friction != ShaftFriction():
        loads.append(friction)
    encoder = dataclasses.replace(written.sensors.encoder, zero_rad=values[ALWAYS[ZERO]])
    gain, offset, delay = (values[ALWAYS[name]] for name in (GAIN, OFFSET, DELAY))
    sensor = dataclasses.replace(written.sensors.torque, gain=gain, offset_Nm=offset, delay_s=delay)
    sensors = dataclasses.replace(written.sensors, encoder=encoder, torque=sensor)
    return replace(written, loads=tuple(loads), sensors=sensors)
