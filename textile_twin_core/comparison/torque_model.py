"""Measured torque as a function of the parameters of `identify`: forces, friction, inertia, event angles, sensors."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
import scipy

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.event_angle import BesideEvent
from textile_twin_core.comparison.evidence import Evidence
from textile_twin_core.comparison.identifiable import NotIdentifiable
from textile_twin_core.comparison.shaft_track import TURN
from textile_twin_core.dynamics.loads import Backing, ShaftFriction
from textile_twin_core.machine import Machine
from textile_twin_core.twin import Twin, compile_rigid

FORCES = ("backing_force_N", "free_force_N")
EVENTS = ("entry_angle_rad", "exit_angle_rad")
FRICTION = ("shaft_viscous_Nms", "shaft_coulomb_Nm")
SENSOR = ("torque_sensor_delay_s", "torque_sensor_gain", "torque_sensor_offset_Nm")
INERTIA, ZERO, DELAY = "added_inertia_kgm2", "encoder_zero_rad", "torque_sensor_delay_s"
GAIN, OFFSET = "torque_sensor_gain", "torque_sensor_offset_Nm"
NOT_NEGATIVE = (*FORCES, *FRICTION)
_ZERO_STEP, _DELAY_STEP = 1e-4, 1e-5
_ROOT_2PI = float(np.sqrt(2.0 * np.pi))


@dataclass(frozen=True)
class Parts:
    """Torque per unit of each linear parameter at m samples [N m], and the part without a parameter.

    per_event: by event angle, its derivative of the torque per unit of force in the backing less force above it.
    """

    fixed: FloatArray
    per_unit: dict[str, FloatArray]
    per_event: dict[str, FloatArray]
    theta: FloatArray
    good: BoolArray

    def total(self, values: Mapping[str, float]) -> FloatArray:
        """Torque in the shaft."""
        torque = self.fixed.copy()
        for name, column in self.per_unit.items():
            torque += values[name] * column
        return torque


class TorqueModel:
    """Prediction of the torque sensor's reading at each measured sample of a record.

    `spread_rad`: angle (a standard deviation) over which a force sets in, since needle points are not quite level and
    stamps not exact. Zero is in shaft angle, of the evidence's track; `direction` is the encoder's. Event angles are
    fixed if no needle passes the backing, or if there are several backings, which are not distinguishable;
    `not_there` states the reason.
    """

    def __init__(self, evidence: Evidence, machine: Machine, direction: int, spread_rad: float) -> None:
        self.evidence, self.machine, self.direction, self.spread_rad = evidence, machine, direction, spread_rad
        backings = [load for load in machine.loads if isinstance(load, Backing)]
        self._events = {event.name: event.angle_rad for event in machine.events()}
        self.backing = backings[0] if len(backings) == 1 and self._passes(backings[0]) else None
        self.not_there: tuple[NotIdentifiable, ...] = ()
        if backings and self.backing is None:
            text = f"as configured, '{backings[0].on}' does not pass the planes of its backing; it stays as configured"
            if len(backings) > 1:
                text = f"the machine has {len(backings)} backings; they stay as configured"
            self.not_there = tuple(
                NotIdentifiable(name, f"{name} cannot be told: {text}") for name in (*FORCES, *EVENTS)
            )
        fitted = (ShaftFriction, *((Backing,) if self.backing else ()))
        others = tuple(load for load in machine.loads if not isinstance(load, fitted))
        self._others = compile_rigid(
            replace(machine, loads=others), ["torque_inertial_Nm", "torque_gravity_Nm", "torque_load_Nm"]
        )
        self._travel: Twin | None = None
        if self.backing is not None:
            self._travel = compile_rigid(machine, [f"{self.backing.on}_velocity_m_s"])
        self._phases = [place.phase_rad - machine.linkages[0].phase_rad for place in machine.linkages]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters of this machine."""
        backing = (*FORCES, *EVENTS) if self.backing is not None else ()
        return (*backing, *FRICTION, INERTIA, *SENSOR, ZERO)

    def with_spread(self, spread_rad: float) -> TorqueModel:
        """Return a copy with another spread of the events."""
        other = copy(self)
        other.spread_rad = spread_rad
        return other

    def with_evidence(self, evidence: Evidence) -> TorqueModel:
        """Return a copy for other evidence."""
        other = copy(self)
        other.evidence = evidence
        return other

    def start(self) -> dict[str, float]:
        """Start values as the machine declares them; the caller improves zero and delay."""
        encoder, sensor = self.machine.sensors.encoder, self.machine.sensors.torque
        frictions = [load for load in self.machine.loads if isinstance(load, ShaftFriction)]
        values = {
            "shaft_viscous_Nms": sum(load.viscous_Nms for load in frictions),
            "shaft_coulomb_Nm": sum(load.coulomb_Nm for load in frictions),
            INERTIA: 0.0,
            DELAY: sensor.delay_s,
            GAIN: sensor.gain,
            OFFSET: sensor.offset_Nm,
            ZERO: encoder.zero_rad * encoder.direction * encoder.ratio,
        }
        if self.backing is not None:
            values |= {
                "backing_force_N": self.backing.force_N,
                "free_force_N": self.backing.free_force_N,
                "entry_angle_rad": self._events[f"{self.backing.on}_enters_backing"],
                "exit_angle_rad": self._events[f"{self.backing.on}_leaves_backing"],
            }
        return values

    def parts(self, values: Mapping[str, float]) -> Parts:
        """Evaluate the parts of the torque at the instants of the samples less the delay."""
        theta, omega, alpha, good = self.evidence.track.at(self.evidence.time_s - values[DELAY])
        theta, omega, alpha = self.direction * theta - values[ZERO], self.direction * omega, self.direction * alpha
        parts = self._others.evaluate(theta, omega, alpha)
        fixed = parts["torque_inertial_Nm"] + parts["torque_gravity_Nm"] + parts["torque_load_Nm"]
        way = np.sign(omega)
        units = {"shaft_viscous_Nms": omega, "shaft_coulomb_Nm": way, INERTIA: alpha}
        events: dict[str, FloatArray] = {}
        if self.backing is not None:
            units |= {name: np.zeros_like(theta) for name in FORCES}
            events = {name: np.zeros_like(theta) for name in EVENTS}
            for phase in self._phases:
                inside, torque = self._inside(theta + phase, values), way * self._lever(theta + phase)
                units["backing_force_N"] += torque * inside
                units["free_force_N"] += torque * (1.0 - inside)
                for name, sense in zip(EVENTS, (-1.0, 1.0), strict=True):
                    away = _apart(theta + phase, values[name]) / self.spread_rad
                    events[name] += torque * sense * np.exp(-0.5 * away**2) / (_ROOT_2PI * self.spread_rad)
        moving = np.abs(omega) > self.evidence.slow_rad_s
        return Parts(fixed, units, events, theta, good & moving & np.isfinite(fixed))

    def expected(self, values: Mapping[str, float]) -> FloatArray:
        """Expected reading of the sensor [N m]."""
        return values[GAIN] * self.parts(values).total(values) + values[OFFSET]

    def jacobian(self, values: Mapping[str, float], names: tuple[str, ...]) -> FloatArray:
        """Slopes (m, k) of the expected torque by the named parameters."""
        parts = self.parts(values)
        columns = []
        for name in names:
            if name == GAIN:
                columns.append(parts.total(values))
            elif name == OFFSET:
                columns.append(np.ones_like(parts.fixed))
            elif name in parts.per_unit:
                columns.append(values[GAIN] * parts.per_unit[name])
            elif name in parts.per_event:
                force = values["backing_force_N"] - values["free_force_N"]
                columns.append(values[GAIN] * force * parts.per_event[name])
            else:
                step = _ZERO_STEP if name == ZERO else _DELAY_STEP
                low, high = ({**values, name: values[name] + side * step} for side in (-1.0, 1.0))
                columns.append((self.expected(high) - self.expected(low)) / (2.0 * step))
        return np.stack(columns, axis=1)

    def turn(self, values: Mapping[str, float]) -> IntArray:
        """Turn of the shaft of each sample."""
        return np.floor(self.parts(values).theta / TURN).astype(np.int64)

    def near_event(self, theta: FloatArray, values: Mapping[str, float], within_rad: float) -> BoolArray:
        """Return true for angles near the entry or the exit of a needle."""
        near = np.zeros(theta.size, dtype=np.bool_)
        if self.backing is not None:
            for phase in self._phases:
                for name in EVENTS:
                    near |= np.abs(_apart(theta + phase, values[name])) < within_rad
        return near

    def beside_event(self, values: Mapping[str, float], name: str, within_rad: float) -> BesideEvent:
        """Samples on either side of an event."""
        parts, apart = self.parts(values), 2.0 * within_rad + 0.1
        past, coming = (self.expected({**values, name: values[name] + away}) for away in (-apart, apart))
        relative = np.full(parts.theta.size, np.inf)
        for phase in self._phases:
            here = _apart(parts.theta + phase, values[name])
            relative = np.where(np.abs(here) < np.abs(relative), here, relative)
        # Turning forward the event comes from below.
        near = parts.good & (np.abs(relative) < 1.2 * within_rad)
        return BesideEvent(relative[near], self.evidence.torque_Nm[near], coming[near], past[near])

    def _passes(self, backing: Backing) -> bool:
        """Return true if the needle enters and leaves the backing as configured."""
        return all(f"{backing.on}_{way}_backing" in self._events for way in ("enters", "leaves"))

    def _inside(self, theta: FloatArray, values: Mapping[str, float]) -> FloatArray:
        """1 between entry and exit, 0 outside, smooth over the spread."""
        after_entry = scipy.special.ndtr(_apart(theta, values["entry_angle_rad"]) / self.spread_rad)
        after_exit = scipy.special.ndtr(_apart(theta, values["exit_angle_rad"]) / self.spread_rad)
        # The step of an event wraps half a turn away from it; there the step of the other event counts.
        span = float(np.remainder(values["exit_angle_rad"] - values["entry_angle_rad"], TURN))
        since = np.remainder(theta - values["entry_angle_rad"], TURN)
        near_entry = np.minimum(since, TURN - since) <= np.abs(since - span)
        return np.asarray(np.where(near_entry, after_entry, 1.0 - after_exit))

    def _lever(self, theta: FloatArray) -> FloatArray:
        """|travel's slope| [m/rad]: torque per unit of force against the travel."""
        assert self._travel is not None and self.backing is not None
        slope = self._travel.evaluate(theta, np.ones_like(theta), np.zeros_like(theta))
        return np.asarray(np.abs(slope[f"{self.backing.on}_velocity_m_s"]))


def _apart(theta: FloatArray, angle: float) -> FloatArray:
    """Difference of theta and an angle, within half a turn."""
    return np.asarray(np.remainder(theta - angle + np.pi, TURN) - np.pi)
