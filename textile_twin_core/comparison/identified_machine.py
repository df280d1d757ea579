"""Parameters of `identify` in the words of its results: candidates of a machine, values, and the identified machine."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.event_angle import BesideEvent
from textile_twin_core.comparison.identifiable import NotIdentifiable
from textile_twin_core.comparison.shaft_track import TURN
from textile_twin_core.comparison.uncertainty import Estimate
from textile_twin_core.comparison.unmodelled import UnmodelledTorque
from textile_twin_core.dynamics import Body
from textile_twin_core.dynamics.loads import Backing, ShaftFriction, TorqueTable
from textile_twin_core.errors import RecordingError
from textile_twin_core.inference.measurement import Hypothesis, Measurement
from textile_twin_core.inference.parameter import (
    BESIDE,
    COULOMB,
    DELAY,
    GAIN,
    HELD,
    OF_CHAIN,
    OFFSET,
    ROTOR,
    SENSORS,
    VISCOUS,
    ZERO,
    gain_factor,
)
from textile_twin_core.inference.record import Record
from textile_twin_core.inference.torque_model import TabulatedTorque
from textile_twin_core.machine import Machine
from textile_twin_core.machine.slots import slots, write
from textile_twin_core.twin import compile_rigid

_OF_BACKING = {
    "force_N": "backing_force_N",
    "free_force_N": "free_force_N",
    "entry_plane_m": "entry_angle_rad",
    "exit_plane_m": "exit_angle_rad",
}
_EVENTS = {"entry_angle_rad": "enters", "exit_angle_rad": "leaves"}
ALWAYS = {
    VISCOUS: "shaft_viscous_Nms",
    COULOMB: "shaft_coulomb_Nm",
    ROTOR: "added_inertia_kgm2",
    DELAY: "torque_sensor_delay_s",
    GAIN: "torque_sensor_gain",
    OFFSET: "torque_sensor_offset_Nm",
    ZERO: "encoder_zero_rad",
}
_WIDE = 100.0
"""Width of the priors over that of the largest mistakes that occur."""


class Candidates:
    """Numbers of a machine that `identify` estimates where a record determines them.

    Attributes:
        machine: of the file.
        public: name in the results, by parameter of the measurement model; a plane of a backing appears as the angle
            at which the needle passes it.
        planes: parameters that are planes.
        missing: numbers of a backing that no record of this machine determines, with the reason.
    """

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        backings = [k for k, load in enumerate(machine.loads) if isinstance(load, Backing)]
        load = machine.loads[backings[0]] if backings else None
        self._slots = {
            slot.path: slot
            for slot in slots(machine)
            if slot.field == "loads" and slot.entry in backings[:1] and slot.attribute in _OF_BACKING
        }
        self._backing = load if isinstance(load, Backing) else None
        self.missing: tuple[NotIdentifiable, ...] = ()
        if self._backing is not None and (len(backings) > 1 or len(self._events(machine)) < len(_EVENTS)):
            text = (
                f"as configured, '{self._backing.on}' does not pass the planes of its backing; it stays as configured"
            )
            if len(backings) > 1:
                text = f"the machine has {len(backings)} backings; they stay as configured"
            names = _OF_BACKING.values()
            self.missing = tuple(NotIdentifiable(name, f"{name} cannot be determined: {text}") for name in names)
            self._slots = {}
        self.public = {name: _OF_BACKING[slot.attribute] for name, slot in self._slots.items()} | ALWAYS
        self.planes = tuple(name for name in self._slots if self.public[name] in _EVENTS)
        self._phases = [place.phase_rad - machine.linkages[0].phase_rad for place in machine.linkages]

    def measurement(self, whole: Measurement, record: Record) -> Measurement:
        """Measurement model of a record whose parameters are the candidates; all other numbers are those of the file.

        The priors are so wide that the record alone counts. The added inertia may be negative: bodies that are
        lighter than in the file.

        Args:
            whole: measurement with all parameters of the machine. record: the samples to fit.
        """
        names = {*SENSORS, *BESIDE, HELD, *self._slots, *(p.name for p in whole.parameters if p.kind in OF_CHAIN)}
        wide = (replace(p, departure=_WIDE * p.widest, widest=_WIDE * p.widest) for p in whole.parameters)
        known = tuple(replace(p, low=-np.inf) if p.name == ROTOR else p for p in wide if p.name in names)
        model = TabulatedTorque(self.machine, known, self._slots)
        return Measurement(record, model, known, whole.working_torque_Nm)

    def values(self, m: Measurement, hypothesis: Hypothesis, x: FloatArray) -> dict[str, float]:
        """Values of all candidates at values x of the parameters, by public name."""
        angles = {self.public[name]: angle for name, angle in self.event_angles(m, x).items()}
        names = [name for name in m.names if name in self.public and name not in self.planes]
        return {self.public[name]: self.estimate(m, hypothesis, x, name, 0.0, 0.0).value for name in names} | angles

    def estimate(
        self, m: Measurement, hypothesis: Hypothesis, x: FloatArray, name: str, sigma: float, half_width: float
    ) -> Estimate:
        """Estimate of a candidate, other than a plane, as the results have it.

        Args:
            m: the measurement. hypothesis: discrete settings. x: values of its parameters.
            name: of the parameter. sigma, half_width: its standard deviation, and half its 95 % interval.
        """
        parameter, value = m.parameters[m.place[name]], float(x[m.place[name]])
        ends = max(value - half_width, parameter.low), max(value + half_width, parameter.low)
        if name == GAIN:
            factor = gain_factor(value)
            low, high = sorted(hypothesis.gain * gain_factor(end) for end in ends)
            return Estimate(hypothesis.gain * factor, abs(hypothesis.gain) * factor**2 * sigma, (low, high))
        plain = Estimate(value, sigma, ends)
        if name == ZERO:
            encoder = self.machine.sensors.encoder
            return plain.scaled(1.0, hypothesis.zero_rad).scaled(1.0 / (encoder.direction * encoder.ratio))
        return plain.scaled(
            1.0, {DELAY: hypothesis.delay_s, OFFSET: hypothesis.offset_Nm, ROTOR: -parameter.nominal}.get(name, 0.0)
        )

    def machine_with(
        self, m: Measurement, hypothesis: Hypothesis, x: FloatArray, off_nominal: Collection[str] = ()
    ) -> Machine:
        """Return the machine with the values x: loads, friction, inertia, sensors, and departures of their chain.

        A negative added inertia is left out, since no body has one.
        """
        found = self.values(m, hypothesis, x)
        written = self._with_backing(m, x)
        loads = [load for load in written.loads if not isinstance(load, ShaftFriction)]
        friction = ShaftFriction(*(max(found[ALWAYS[name]], 0.0) for name in (VISCOUS, COULOMB)))
        if friction != ShaftFriction():
            loads.append(friction)
        added = found[ALWAYS[ROTOR]]
        bodies = (*written.bodies, Body.flywheel(added)) if added > 0.0 else written.bodies
        encoder = replace(written.sensors.encoder, zero_rad=found[ALWAYS[ZERO]])
        gain, offset, delay = (found[ALWAYS[name]] for name in (GAIN, OFFSET, DELAY))
        sensor = replace(written.sensors.torque, gain=gain, offset_Nm=offset, delay_s=delay)
        sensors = m.chain_sensors(replace(written.sensors, encoder=encoder, torque=sensor), x, off_nominal)
        return replace(written, loads=tuple(loads), bodies=bodies, sensors=sensors)

    def event_angles(self, m: Measurement, x: FloatArray) -> dict[str, float]:
        """Shaft angle at which the needle passes each plane [rad]; a plane that it does not reach is left out."""
        angles = self._events(self._with_backing(m, x)) if self.planes else {}
        return {name: angles[self.public[name]] for name in self.planes if self.public[name] in angles}

    def beside_event(
        self, m: Measurement, hypothesis: Hypothesis, x: FloatArray, plane: str, angle_rad: float, within_rad: float
    ) -> BesideEvent:
        """Samples on either side of an event, and their expected torque before and after it.

        Args:
            m: measurement by single samples. hypothesis: discrete settings. x: values of its parameters.
            plane: that the needle passes at `angle_rad`. within_rad: largest distance of a sample.
        """
        x, apart = x.copy(), 2.0 * within_rad + 0.1
        expected = []
        for side in (1.0, -1.0):  # the event still to come, then past
            beyond = self._travel(angle_rad + side * np.linspace(0.0, apart, 65))
            x[m.place[plane]] = beyond.max() if beyond[1] > beyond[0] else beyond.min()
            expected.append(m.expected(hypothesis, x))
        before, after = expected
        relative = np.full(before.theta.size, np.inf)
        for phase in self._phases:
            here = np.remainder(before.theta + phase - angle_rad + np.pi, TURN) - np.pi
            relative = np.where(np.abs(here) < np.abs(relative), here, relative)
        near = before.good & (np.abs(relative) < within_rad)
        torque = m.record.torque_Nm[near]
        return BesideEvent(relative[near], torque, before.torque_Nm[near], after.torque_Nm[near])

    def plane_at(self, angle_rad: float) -> float:
        """Travel of the needle at a shaft angle [m]: the plane that it passes there."""
        return float(self._travel(np.array([angle_rad]))[0])

    def _travel(self, angle_rad: FloatArray) -> FloatArray:
        assert self._backing is not None
        name = f"{self._backing.on}_position_m"
        return np.asarray(
            compile_rigid(self.machine, [name]).evaluate(angle_rad, 1.0 + 0.0 * angle_rad, 0.0 * angle_rad)[name]
        )

    def _with_backing(self, m: Measurement, x: FloatArray) -> Machine:
        """Return the machine with the values x of its backing."""
        values = {slot.name: float(x[m.place[name]]) for name, slot in self._slots.items() if name in m.place}
        written = write(self.machine, values)
        assert isinstance(written, Machine)
        return written

    def _events(self, machine: Machine) -> dict[str, float]:
        """Angles of the backing's events, by public name; those that the needle does not reach are left out."""
        assert self._backing is not None
        angles = {event.name: event.angle_rad for event in machine.events()}
        names = {public: f"{self._backing.on}_{way}_backing" for public, way in _EVENTS.items()}
        return {public: angles[name] for public, name in names.items() if name in angles}


def with_table(machine: Machine, torque: UnmodelledTorque) -> Machine:
    """Return the machine with the unmodelled torque as an additional load: the drive gives what the load takes.

    Raises RecordingError for a torque over several turns, which no load of a machine can be.
    """
    if torque.cycle_turns > 1:
        raise RecordingError(
            f"the unmodelled torque lasts {torque.cycle_turns} turns, and a machine's table lasts one: take"
            " it from the JSON"
        )
    table = TorqueTable(tuple(torque.angle_rad.tolist()), tuple((-torque.torque_Nm).tolist()))
    return replace(machine, loads=(*machine.loads, table))
