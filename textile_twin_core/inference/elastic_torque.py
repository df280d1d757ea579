"""Torque of an elastic shaft over a record, by its observer, and its slopes by the numbers of the machine file."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.driveline import ElasticShaft, elastic_shaft
from textile_twin_core.driveline.drive_bank import MEMORIES
from textile_twin_core.driveline.observer import ObserverScales, ShaftObserver
from textile_twin_core.driveline.observer_step import ShaftReadings
from textile_twin_core.dynamics.loads import ShaftFriction
from textile_twin_core.errors import MachineError
from textile_twin_core.inference.parameter import COULOMB, ROTOR, VISCOUS, ZERO, ModelParameter
from textile_twin_core.machine import Machine, MainShaft
from textile_twin_core.machine.main_shaft import ShaftDrive
from textile_twin_core.machine.slots import slots, write

STIFFNESS = "shaft.pieces.0.stiffness_Nm_rad"
DAMPING = "shaft.pieces.0.damping_Nms_rad"
INERTIA, SLIP = "shaft.drive.inertia_kgm2", "shaft.drive.slip_Nms_rad"
OF_SHAFT = (STIFFNESS, DAMPING, INERTIA, SLIP)
"""Parameters of an elastic shaft: stiffness and damping from end to end, whose pieces keep their proportions."""
_STEP, _ANGLE_STEP = 1e-3, 5e-4
"""Steps of the numerical slopes: as a share of a departure's standard deviation, and of an angle [rad]."""
_FINER = 2
"""Time steps per time step of the live observer."""
_APART = 2.5
"""Distance of neighbouring readings, in usual ones, beyond which the torque between them is not used."""


Run: TypeAlias = tuple[FloatArray, FloatArray, BoolArray, FloatArray]
"""Torque of the sensor's piece, its rate, a mask of the settled states, and the torque's standard deviation."""


@dataclass(frozen=True)
class LinearisedTorque:
    """Torque of the sensor's piece at the times of the readings (n,), linear about values of its parameters.

    Attributes:
        time_s: of the readings. torque_Nm, rate_Nm_s: torque and its slope over time.
        usable: (n - 1,) intervals between neighbouring readings with a settled state.
        parameters: those of the shaft itself.
        about: values by name. slopes, rates: (n, k) of torque and rate by these.
        start: values of all parameters from which a fit starts.
        uncertain_Nm: standard deviation of the torque by the observer.
    """

    time_s: FloatArray
    torque_Nm: FloatArray
    rate_Nm_s: FloatArray
    usable: BoolArray
    parameters: tuple[ModelParameter, ...]
    about: Mapping[str, float]
    slopes: FloatArray
    rates: FloatArray
    start: Mapping[str, float]
    uncertain_Nm: float

    def at(
        self, time_s: FloatArray, values: Mapping[str, float], slopes: bool
    ) -> tuple[FloatArray, FloatArray, BoolArray, dict[str, FloatArray]]:
        """Torque, its slope over time, and a mask of the usable ones at times (m,); slopes by parameter if asked for.

        Between readings by the cubic through both ends' torques and rates.
        """
        away = np.array([values[name] - about for name, about in self.about.items()])
        torque, rate = self.torque_Nm + self.slopes @ away, self.rate_Nm_s + self.rates @ away
        after = np.clip(np.searchsorted(self.time_s, time_s, side="right"), 1, self.time_s.size - 1)
        before = after - 1
        step = self.time_s[after] - self.time_s[before]
        u = (time_s - self.time_s[before]) / step
        good = self.usable[before] & (u >= 0.0) & (u <= 1.0)
        u = np.clip(u, 0.0, 1.0)
        v = 1.0 - u
        weights = v * v * (1.0 + 2.0 * u), u * u * (1.0 + 2.0 * v), step * u * v * v, -step * u * u * v
        bends = 6.0 * u * v / step, v * (1.0 - 3.0 * u), u * (1.0 - 3.0 * v)
        found = sum(
            w * part
            for w, part in zip(weights, (torque[before], torque[after], rate[before], rate[after]), strict=True)
        )
        slope = bends[0] * (torque[after] - torque[before]) + bends[1] * rate[before] + bends[2] * rate[after]
        columns: dict[str, FloatArray] = {}
        if slopes:
            parts = self.slopes[before], self.slopes[after], self.rates[before], self.rates[after]
            matrix = sum(w[:, None] * part for w, part in zip(weights, parts, strict=True))
            columns = {name: np.asarray(matrix)[:, k] for k, name in enumerate(self.about)}
        return np.asarray(found), np.asarray(slope), good, columns


class ElasticTorque:
    """The observer of an elastic shaft, run over a record's readings with any values of the parameters.

    One filter of the observer's bank runs, since the weights of several change abruptly with the parameters.

    Args:
        machine: with a `shaft`, whose drive has inertia and slip.
        readings: of the encoder, in shaft angle by the machine's own sensors. time_s: (n,) of these.
        parameters: of the machine (see `priors.parameters`).
        of_shaft: of the shaft itself.
    """

    def __init__(
        self,
        machine: Machine,
        readings: ShaftReadings,
        time_s: FloatArray,
        parameters: Collection[ModelParameter],
        of_shaft: tuple[ModelParameter, ...],
    ) -> None:
        self.machine, self.readings, self.time_s = machine, readings, time_s
        self.of_shaft = of_shaft
        self.parameters = {p.name: p for p in (*parameters, *of_shaft)}
        beside = (COULOMB, VISCOUS, ROTOR)
        self._slots = {slot.path: slot.name for slot in slots(machine) if slot.path not in beside}
        self.memory = MEMORIES
        self._elastic: dict[tuple[tuple[str, float], ...], ElasticShaft] = {}
        self._known: dict[str, tuple[float, FloatArray, FloatArray]] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters on which the predicted torque depends, in the order of the machine's."""
        beside = (ZERO, COULOMB, VISCOUS, ROTOR, *OF_SHAFT)
        return tuple(name for name in self.parameters if name in beside or name in self._slots)

    @cached_property
    def scales(self) -> ObserverScales:
        """Times and errors of the file's observer, whose time step serves all others."""
        return ShaftObserver(elastic_shaft(self.machine), self.machine.nominal_speed_rad_s).scales

    def run(self, values: Mapping[str, float], rows: slice = slice(None), finer: int = _FINER) -> Run:
        """Torque of the sensor's piece, its rate, a mask of settled states, and the torque's sigma at the readings.

        Args:
            values: by name; those not given are as in the file. rows: of the readings.
            finer: time steps per time step of the live observer.
        """
        elastic = self._shaft_with(values)
        scales = replace(self.scales, substep_s=self.scales.substep_s / finer)
        observer = ShaftObserver(elastic, self.machine.nominal_speed_rad_s, scales, self.memory)
        off, r = values.get(ZERO, 0.0), self.readings
        moved = r._replace(reading=r.reading - off, angle=r.angle - off)
        observed = observer.take(ShaftReadings(*(np.ascontiguousarray(column[rows]) for column in moved)))
        piece, sign = elastic.shaft.torque_piece
        motion, chain, factor = observed.motion, elastic.chain, sign / elastic.ratios[piece + 1]
        turn, bend = (each[:, piece] - each[:, piece + 1] for each in (motion.omega, motion.alpha))
        rate = chain.stiffness[piece] * turn + chain.damping[piece] * bend
        sigma = abs(float(factor)) * observed.found["sigma"]
        return factor * motion.pieces[:, piece], factor * rate, observed.found["rung"] > 0.5, sigma

    def linearised(self, values: Mapping[str, float], names: Collection[str]) -> LinearisedTorque:
        """Predict about these values, with new slopes by the named parameters and the last known ones by others."""
        here = {name: values.get(name, self.parameters[name].nominal) for name in self.names}
        torque, rate, settled, sigma = self.run(here)
        coarse = self.run(here, finer=1) if names else (torque, rate, settled, sigma)
        for name in names:
            p = self.parameters[name]
            step = _ANGLE_STEP if name == ZERO else _STEP * p.departure
            if name == ZERO:  # central: its slope has the curvature of all orders
                low, high = (self.run({**here, name: here[name] + side}, finer=1) for side in (-step, step))
                slope, bend = (0.5 * (high[k] - low[k]) / step for k in (0, 1))
            else:
                try:
                    moved = self.run({**here, name: here[name] + step}, finer=1)
                except MachineError:  # a linkage of these lengths does not close
                    continue
                slope, bend = (moved[0] - coarse[0]) / step, (moved[1] - coarse[1]) / step
            self._known[name] = here[name], slope, bend
        about = {name: value for name, value in here.items() if name in self._known}
        slopes, rates = np.empty((2, torque.size, len(about)))
        for k, name in enumerate(about):
            _, slopes[:, k], rates[:, k] = self._known[name]
        apart = np.diff(self.time_s)
        usable = settled[1:] & settled[:-1] & (apart < _APART * float(np.median(apart)))
        uncertain = float(np.median(sigma[1:][usable])) if usable.any() else 0.0
        start = {**values, **about}
        return LinearisedTorque(
            self.time_s, torque, rate, usable, self.of_shaft, about, slopes, rates, start, uncertain
        )

    def _shaft_with(self, values: Mapping[str, float]) -> ElasticShaft:
        """The shaft with these values of the parameters."""
        p = self.parameters
        own = {self._slots[n]: v for n, v in values.items() if n in self._slots and v != p[n].nominal}
        dry = values.get(COULOMB, p[COULOMB].nominal)
        key = (*sorted(own.items()), (COULOMB, dry))
        if key not in self._elastic:
            machine = write(self.machine, own)
            assert isinstance(machine, Machine)
            if dry != p[COULOMB].nominal:
                loads = tuple(load for load in machine.loads if not isinstance(load, ShaftFriction))
                machine = replace(
                    machine, loads=(*loads, ShaftFriction(viscous_Nms=p[VISCOUS].nominal, coulomb_Nm=dry))
                )
            if len(self._elastic) > 4:
                self._elastic.clear()
            self._elastic[key] = elastic_shaft(machine)
        found, configured = self._elastic[key], shaft_values(self.machine)
        stiffness, damping = (
            values.get(name, configured[name]) / configured[name] if configured[name] > 0.0 else 1.0
            for name in (STIFFNESS, DAMPING)
        )
        drive = ShaftDrive(None, *(values.get(n, configured[n]) for n in (INERTIA, SLIP)))
        found = found.rescaled(stiffness, damping, drive)
        station = found.hanger_stations[0]
        rotor, viscous = (values.get(name, p[name].nominal) - p[name].nominal for name in (ROTOR, VISCOUS))
        if rotor or viscous:
            inertia, drag = found.chain.inertia.copy(), found.chain.viscous.copy()
            inertia[station] += rotor
            drag[station] += viscous
            found = replace(found, chain=found.chain._replace(inertia=inertia, viscous=drag))
        return found


def _end_to_end(values: FloatArray) -> float:
    """Stiffness or damping of pieces in series; 0 where one has none."""
    return float(1.0 / np.sum(1.0 / values)) if (values > 0.0).all() else 0.0


def shaft_values(machine: Machine) -> dict[str, float]:
    """Values of a machine's parameters of its elastic shaft; 0 for a drive that is not given."""
    shaft = machine.shaft
    assert isinstance(shaft, MainShaft)
    ratios = np.array(shaft.speed_ratios[1:])
    stiffness, damping = (
        np.array(each) * ratios**2
        for each in ([p.stiffness for p in shaft.pieces], [p.damping_Nms_rad for p in shaft.pieces])
    )
    drive = (shaft.drive.inertia_kgm2 or 0.0, shaft.drive.slip_Nms_rad or 0.0)
    return dict(zip(OF_SHAFT, (_end_to_end(stiffness), _end_to_end(damping), *drive), strict=True))


def with_shaft_values(machine: Machine, values: Mapping[str, float]) -> Machine:
    """Return the machine with other values of some parameters; pieces keep their proportions and own inertia."""
    shaft, now = machine.shaft, shaft_values(machine)
    assert isinstance(shaft, MainShaft)
    factors = {name: values.get(name, now[name]) / now[name] for name in (STIFFNESS, DAMPING) if now[name] > 0.0}
    pieces = tuple(
        replace(
            piece,
            stiffness_Nm_rad=piece.stiffness * factors[STIFFNESS],
            diameter_m=None,
            length_m=None,
            damping_Nms_rad=piece.damping_Nms_rad * factors.get(DAMPING, 1.0),
        )
        for piece in shaft.pieces
    )
    bars = np.array([piece.bar_inertia_kgm2 for piece in shaft.pieces])
    ends = 0.5 * (np.append(bars, 0.0) + np.append(0.0, bars))
    stations = tuple(
        replace(station, inertia_kgm2=station.inertia_kgm2 + float(end))
        for station, end in zip(shaft.stations, ends, strict=True)
    )
    drive = replace(
        shaft.drive,
        inertia_kgm2=values.get(INERTIA, shaft.drive.inertia_kgm2),
        slip_Nms_rad=values.get(SLIP, shaft.drive.slip_Nms_rad),
    )
    return replace(machine, shaft=replace(shaft, stations=stations, pieces=pieces, drive=drive))
