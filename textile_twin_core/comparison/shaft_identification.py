"""Identification of stiffness, damping and drive of an elastic main shaft from the torque in one of its pieces."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import least_squares

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison.readings import Readings, SecondAngle
from textile_twin_core.comparison.result import plain
from textile_twin_core.comparison.shaft_track import TURN
from textile_twin_core.comparison.stage import Begin, unheard
from textile_twin_core.comparison.uncertainty import Estimate, uncertainty_by_turns
from textile_twin_core.driveline import elastic_shaft
from textile_twin_core.driveline.drive_bank import MEMORIES
from textile_twin_core.driveline.observer import ShaftObserver
from textile_twin_core.driveline.observer_step import shaft_readings
from textile_twin_core.errors import RecordingError
from textile_twin_core.inference import elastic_torque
from textile_twin_core.inference.robust import robust_scale
from textile_twin_core.machine import Machine, MainShaft, TorqueFilter
from textile_twin_core.machine.main_shaft import ShaftDrive
from textile_twin_core.shaft import create_estimator
from textile_twin_core.twin.session import encoder_settings

STIFFNESS, DAMPING = "shaft_stiffness_Nm_rad", "shaft_damping_Nms_rad"
INERTIA, SLIP = "drive_inertia_kgm2", "drive_slip_Nms_rad"
_NAMES = (STIFFNESS, DAMPING, INERTIA, SLIP)
_FACTORS = np.exp(np.arange(-0.24, 0.241, 0.02))
"""Stiffnesses tried over the configured one: 2 % apart, since the minimum about the true one is narrow."""
_DAMPINGS = (1.0, 0.5, 0.7, 1.4, 2.0)
"""Dampings tried over the configured one, at the best stiffness."""
_SCALES = {STIFFNESS: 0.01, DAMPING: 0.1, INERTIA: 0.05, SLIP: 0.1}
"""Changes of the logarithms that change the torque by similar amounts."""
_STEP = 1e-3
"""Relative step of the numerical slopes."""
_WIDEST = 1.5
"""Largest change of a logarithm in the fit."""
_FEWEST = 256
_FINER = 2
"""Time steps of the fit per time step of the live observer."""


@dataclass(frozen=True)
class ShaftIdentification:
    """Parameters of an elastic shaft, identified from a recording.

    Attributes:
        parameters: by name; stiffness and damping are those of the whole shaft from end to end.
        rms_before_Nm, rms_after_Nm: residual of the machine as configured, and with the estimates.
        machine: the machine with the estimates. notes: remarks for the reader.
        second_rms_rad: residual of a second encoder's angle before and after; NaN without one.
    """

    parameters: Mapping[str, Estimate]
    rms_before_Nm: float
    rms_after_Nm: float
    machine: Machine
    notes: tuple[str, ...]
    second_rms_rad: tuple[float, float]

    def to_json(self) -> dict[str, Any]:
        """One object of plain lists and numbers."""
        found: dict[str, Any] = plain(
            {
                "parameters": {name: dataclasses.asdict(each) for name, each in self.parameters.items()},
                "fixed": {},
                "not_identifiable": [],
                "rms_before_Nm": self.rms_before_Nm,
                "rms_after_Nm": self.rms_after_Nm,
                "notes": list(self.notes),
            }
        )
        if math.isfinite(self.second_rms_rad[0]):
            found["second_encoder"] = dict(zip(("rms_before_rad", "rms_after_rad"), self.second_rms_rad, strict=True))
        return found


class _Observed:
    """Residuals of the shaft's observer under values of the parameters: torque, and angle at a second encoder.

    The readings pass the shaft estimator once; each evaluation observes them with a rescaled chain and the time step
    of the configured machine, so that the torque is smooth in the parameters.
    """

    def __init__(self, readings: Readings, machine: Machine) -> None:
        self._elastic = elastic_shaft(machine)
        self._speed, self.configured = machine.nominal_speed_rad_s, shaft_values(machine)
        self.scales = ShaftObserver(self._elastic, self._speed).scales
        encoder, sensor = machine.sensors.encoder, machine.sensors.torque
        velocities = None if readings.velocities is None else encoder.shaft_speed(readings.angle, readings.velocities)
        estimator = create_estimator("causal", **encoder_settings(encoder))
        states = estimator.step(readings.angle_stamps_ns, encoder.shaft_angle(readings.angle), velocities)
        stamps = np.asarray(states.stamps, dtype=np.int64)
        if stamps.size < _FEWEST:
            raise RecordingError(f"only {stamps.size} shaft angles can be used: record longer")
        self._rows, origin = shaft_readings(states.rows), int(stamps[0])
        self._turns = states.rows["origin"].copy()
        good = np.isfinite(readings.torque)
        torque_ns = readings.torque_stamps_ns[good] - round(sensor.delay_s * 1e9)
        self._time: FloatArray = (torque_ns - origin).astype(np.float64) * 1e-9
        self._known: FloatArray = (stamps - origin).astype(np.float64) * 1e-9
        self.torque = (readings.torque[good] - sensor.offset_Nm) / sensor.gain
        near = np.clip(np.searchsorted(self._known, self._time), 1, self._known.size - 1)
        beside = self._known[near] - self._known[near - 1] < 2.5 * float(np.median(np.diff(self._known)))
        self._near = near
        self._within = (self._time >= self._known[0]) & (self._time <= self._known[-1]) & beside
        self._turn = np.floor(np.interp(self._time, self._known, states.theta_rad) / TURN).astype(np.int64)
        self._filter = TorqueFilter.of(sensor)
        self._within &= self._time >= self._known[0] + self._filter.settling_s
        self.settled = self._within
        self._second: FloatArray | None = None
        if readings.second is not None:
            self._second_time, self._second = _second_angles(readings.second, machine, origin, self._known)
            self._nearest = np.searchsorted(self._known, self._second_time)
            self._second_turn = np.floor(np.interp(self._second_time, self._known, states.theta_rad) / TURN)
            self._second_settled = np.ones(self._second.size, np.bool_)

    @property
    def turns(self) -> IntArray:
        """Turn of the shaft of each residual (n + m,)."""
        if self._second is None:
            return np.asarray(self._turn[self.settled])
        return np.concatenate([self._turn[self.settled], self._second_turn[self._second_settled].astype(np.int64)])

    def observer(
        self, values: Mapping[str, float | None], finer: int = 1, memories: FloatArray = MEMORIES
    ) -> ShaftObserver:
        """Create an observer with values of the parameters (None: the drive's are estimated) and finer time steps."""
        stiffness, damping = (
            (values[name] or 0.0) / self.configured[name] if self.configured[name] > 0.0 else 1.0
            for name in (STIFFNESS, DAMPING)
        )
        elastic = self._elastic.rescaled(stiffness, damping, ShaftDrive(None, values[INERTIA], values[SLIP]))
        scales = replace(self.scales, substep_s=self.scales.substep_s / finer)
        return ShaftObserver(elastic, self._speed, scales, memories)

    def residual(self, observer: ShaftObserver, first: bool = False) -> tuple[FloatArray, FloatArray]:
        """Return torques (n,) [N m] and second angles (m,) [rad] less the converged predictions, about their means.

        `first`: find where the prediction has converged.
        """
        observed, shaft = observer.take(self._rows), self._elastic.shaft
        piece, sign = shaft.torque_piece
        torque = self._filtered(sign * self._elastic.piece_torques(observed.motion.pieces)[:, piece])
        if first:
            settled = observed.found["rung"] > 0.5
            self.settled = self._within & settled[self._near] & settled[self._near - 1]
        error = (self.torque - np.interp(self._time, self._known, torque))[self.settled]
        if self._second is None or shaft.second_encoder_station is None:
            return _about_mean(error), np.empty(0)
        if first:
            self._second_settled = settled[self._nearest]
        motion, station = observed.motion, shaft.second_encoder_station
        angle = observed.found["angle"] + TURN * self._turns
        angle = angle + motion.psi[:, station] - motion.psi[:, shaft.encoder_station]
        at = CubicHermiteSpline(self._known, angle, motion.omega[:, station])(self._second_time)
        return _about_mean(error), _about_mean((self._second - at)[self._second_settled])

    def _filtered(self, torque: FloatArray) -> FloatArray:
        """Return the torque (n,) at the known times as it passes the filter of the sensor."""
        if self._filter.is_identity:
            return torque
        torque = np.nan_to_num(torque)
        cubics = np.stack([torque[:-1], torque[1:], *[np.diff(torque) / np.diff(self._known)] * 2])
        filtered = self._filter.apply_to_cubics(np.diff(self._known), cubics, np.zeros(torque.size - 1, np.bool_))
        return np.append(filtered[0], filtered[1, -1])


def _about_mean(values: FloatArray) -> FloatArray:
    return np.asarray(values - np.mean(values) if values.size else values)


def _second_angles(
    second: SecondAngle, machine: Machine, origin_ns: int, known: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Times [s], within the known ones, and unwrapped angles [rad] of the second encoder, reduced to the main shaft."""
    encoder = machine.sensors.second_encoder
    good = np.isfinite(second.angle)
    good[good] = np.diff(second.stamps_ns[good], prepend=np.iinfo(np.int64).min // 2) > 0
    time = (second.stamps_ns[good] - origin_ns) * 1e-9
    angle = encoder.shaft_angle(second.angle[good])
    within = (time >= known[0]) & (time <= known[-1])
    return time[within], np.unwrap(angle, period=TURN * encoder.ratio)[within]


def identify_shaft(readings: Readings, machine: Machine, begin: Begin = unheard) -> ShaftIdentification:
    """Fit stiffness and damping of the shaft, inertia and slip of its drive.

    All pieces keep their proportions. The residual is that of the observer's torque, so the encoder at one station is
    enough; a second encoder adds the residual of its angle, whose zero is free, each over its own scale. The fit starts
    from the best of the stiffnesses up to 27 % and of the dampings up to twice around; sensors, loads and masses are as
    configured. Intervals by `uncertainty_by_turns`, widened by the change of the estimates at half the time step.

    Args:
        readings: The recording.
        machine: A machine with a `shaft`; inertia and slip of its drive start from the observer's
            estimates.
        begin: Called at each stage.

    Returns:
        The estimates, and the machine with them.

    Raises:
        RecordingError: For a recording without enough converged predictions.
    """
    begin("observing", 0.1)
    observed, drive = _Observed(readings, machine), _shaft(machine).drive
    configured, known = observed.configured, {INERTIA: drive.inertia_kgm2, SLIP: drive.slip_Nms_rad}
    before, second_before = observed.residual(observed.observer({**configured, **known}), first=True)
    if before.size < _FEWEST:
        if observed.scales.damping_ratio == 0.0:
            raise RecordingError("a shaft without any damping never settles: give its pieces damping_Nms_rad")
        raise RecordingError("the shaft's state does not settle in this recording: record longer at working speed")
    begin("trying stiffnesses", 0.5)
    unknown: dict[str, float | None] = {INERTIA: None, SLIP: None}

    def left(values: Mapping[str, float | None]) -> float:
        return float(np.mean(np.abs(observed.residual(observed.observer({**configured, **unknown, **values}))[0])))

    stiffness = min((configured[STIFFNESS] * factor for factor in _FACTORS), key=lambda each: left({STIFFNESS: each}))
    dampings = (configured[DAMPING] * factor for factor in _DAMPINGS)
    damping = min(dampings, key=lambda each: left({STIFFNESS: stiffness, DAMPING: each}))
    started: dict[str, float | None] = {**configured, STIFFNESS: stiffness, DAMPING: damping}
    learner = observed.observer(started | {name: value for name, value in known.items() if value is None})
    observed.residual(learner)
    started |= {INERTIA: learner.drive_inertia_kgm2, SLIP: max(learner.drive_slip_Nms_rad, 0.0)}
    scale = {name: value for name, value in started.items() if value is not None and value > 0.0}

    def at(logs: FloatArray) -> dict[str, float | None]:
        return started | {name: scale[name] * math.exp(x) for name, x in zip(scale, logs, strict=True)}

    def parts(x: FloatArray, memory: FloatArray, finer: int = _FINER) -> tuple[FloatArray, FloatArray]:
        return observed.residual(observed.observer(at(x - 1.0), finer, memory))

    def residual(x: FloatArray, memory: FloatArray, weight: float, finer: int = _FINER) -> FloatArray:
        torque, angle = parts(x, memory, finer)
        return np.concatenate([torque, weight * angle])

    begin("fitting", 0.95)
    x = np.ones(len(scale))
    for _ in range(2):
        # One filter of the bank: the weights of several change abruptly with the parameters.
        filters = [np.array([each]) for each in MEMORIES]
        memory = min(filters, key=lambda each: float(np.sum(parts(x, each)[0] ** 2)))
        torque, angle = parts(x, memory)
        weight = robust_scale(torque) / robust_scale(angle) if angle.size else 0.0
        # The fit's variables are about 1, since the steps of the numerical slopes are relative.
        found = least_squares(
            residual, x, args=(memory, weight), diff_step=_STEP, x_scale=[_SCALES[name] for name in scale],
            bounds=(1.0 - _WIDEST, 1.0 + _WIDEST), xtol=1e-6,
        )  # fmt: skip
        x = found.x
    logs, error, slopes = x - 1.0, found.fun, -found.jac
    moved = np.linalg.pinv(slopes) @ (residual(x, memory, weight, 2 * _FINER) - error)
    spread = uncertainty_by_turns(slopes, error, observed.turns).wider([moved])
    parameters = {}
    for k, name in enumerate(scale):
        value = scale[name] * math.exp(logs[k])
        parameters[name] = spread.estimate(k, 0.0).scaled(value, value)
    torque, angle = parts(x, memory)
    return ShaftIdentification(
        parameters,
        _rms(before),
        _rms(torque),
        _changed(machine, {name: each.value for name, each in parameters.items()}),
        tuple(
            f"{name} is 0 in the machine file: give a first value to estimate it"
            for name in _NAMES
            if name not in scale
        ),
        (_rms(second_before), _rms(angle)),
    )


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else math.nan


def _shaft(machine: Machine) -> MainShaft:
    assert machine.shaft is not None
    return machine.shaft


def shaft_values(machine: Machine) -> dict[str, float]:
    """Values of the parameters of a machine."""
    return dict(zip(_NAMES, elastic_torque.shaft_values(machine).values(), strict=True))


def _changed(machine: Machine, values: Mapping[str, float]) -> Machine:
    """Return the machine with other values of some parameters; pieces keep their proportions and own inertia."""
    paths = dict(zip(_NAMES, elastic_torque.OF_SHAFT, strict=True))
    return elastic_torque.with_shaft_values(machine, {paths[name]: value for name, value in values.items()})
