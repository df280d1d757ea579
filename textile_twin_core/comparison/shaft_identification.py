"""Identify stiffness, damping and drive of an elastic main shaft from the torque in one of its pieces."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison.readings import Readings
from textile_twin_core.comparison.result import plain
from textile_twin_core.comparison.shaft_track import TURN
from textile_twin_core.comparison.stage import Begin, unheard
from textile_twin_core.comparison.uncertainty import Estimate, uncertainty_by_turns
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Machine, MainShaft
from textile_twin_core.twin import compile_machine
from textile_twin_core.twin.elastic import ElasticTwin

TORQUE = "balancing_torque_Nm"
STIFFNESS, DAMPING = "shaft_stiffness_Nm_rad", "shaft_damping_Nms_rad"
INERTIA, SLIP = "drive_inertia_kgm2", "drive_slip_Nms_rad"
_NAMES = (STIFFNESS, DAMPING, INERTIA, SLIP)
_FACTORS = np.exp(np.arange(-0.24, 0.241, 0.02))
"""Stiffnesses tried over the configured one: 2 % apart, since the torque's valley about the true one is narrow."""
_SCALES = {STIFFNESS: 0.01, DAMPING: 0.1, INERTIA: 0.05, SLIP: 0.1}
"""Changes of the logarithms that change the torque about alike."""
_STEP = 1e-3
"""Relative step of the numerical slopes."""
_WIDEST = 1.5
"""Largest change of a logarithm in the fit."""
_FEWEST = 256


@dataclass(frozen=True)
class ShaftIdentification:
    """What a recording says of an elastic shaft.

    Attributes:
        parameters: by name; stiffness and damping are those of the whole shaft from end to end.
        rms_before_Nm, rms_after_Nm: residual of the machine as configured, and with the estimates.
        machine: the machine with the estimates. notes: what a reader should know.
    """

    parameters: Mapping[str, Estimate]
    rms_before_Nm: float
    rms_after_Nm: float
    machine: Machine
    notes: tuple[str, ...]

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
        return found


class _Observed:
    """Torque of the shaft's observer under values of the parameters, beside the measured one."""

    def __init__(self, readings: Readings, machine: Machine) -> None:
        self._readings, self._machine = readings, machine
        sensor = machine.sensors.torque
        good = np.isfinite(readings.torque)
        self._time_ns = readings.torque_stamps_ns[good] - round(sensor.delay_s * 1e9)
        self.torque = (readings.torque[good] - sensor.offset_Nm) / sensor.gain
        self.turn: IntArray = np.zeros(0, dtype=np.int64)

    def residual(self, machine: Machine, settled: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        """Measured less predicted torque about its mean, and where it counts: where the prediction has settled."""
        session = compile_machine(machine, outputs=(TORQUE,)).session("causal")
        samples = session.step(self._readings.angle_stamps_ns, self._readings.angle, self._readings.velocities)
        stamps = np.asarray(samples.stamps, dtype=np.int64)
        if stamps.size < _FEWEST:
            raise RecordingError(f"only {stamps.size} shaft angles can be used: record longer")
        origin = int(stamps[0])
        time, known = (self._time_ns - origin) * 1e-9, (stamps - origin) * 1e-9
        predicted = np.interp(time, known, samples[TORQUE])
        if settled is None:
            near = np.clip(np.searchsorted(known, time), 1, known.size - 1)
            beside = known[near] - known[near - 1] < 2.5 * float(np.median(np.diff(known)))
            within = (time >= known[0]) & (time <= known[-1]) & samples.settled[near] & samples.settled[near - 1]
            settled = within & beside
            self.turn = np.floor(np.interp(time, known, samples.theta_rad) / TURN).astype(np.int64)
        left = self.torque - predicted
        return left - float(np.mean(left[settled])), settled


def identify_shaft(readings: Readings, machine: Machine, begin: Begin = unheard) -> ShaftIdentification:
    """Fit stiffness and damping of the shaft, inertia and slip of its drive.

    All pieces keep their proportions. The residual is that of the observer's torque, so the encoder at one station is
    enough. The fit starts from the configured values, with stiffnesses up to 27 % around it tried first; sensors, loads
    and masses are as configured. Intervals by `uncertainty_by_turns`.

    Args:
        readings: The recording.
        machine: A machine with a `shaft`; inertia and slip of its drive start from the observer's
            estimates.
        begin: Hears of each stage.

    Returns:
        The estimates, and the machine with them.

    Raises:
        RecordingError: For a recording without enough settled predictions.
    """
    observed = _Observed(readings, machine)
    begin("observing", 0.05)
    before, settled = observed.residual(machine)
    if np.count_nonzero(settled) < _FEWEST:
        raise RecordingError("the shaft's state does not settle in this recording: record longer at working speed")
    begin("trying stiffnesses", 0.3)
    free = _with_unknown_drive(machine)
    stiffness = _values(machine)[STIFFNESS]
    tried = [_changed(free, {STIFFNESS: stiffness * factor}) for factor in _FACTORS]
    left_by = [float(np.mean(np.abs(observed.residual(each, settled)[0][settled]))) for each in tried]
    started = _observed_drive(readings, tried[int(np.argmin(left_by))])
    scale = {name: value for name, value in _values(started).items() if value > 0.0}

    def at(logs: FloatArray) -> Machine:
        return _changed(started, {name: scale[name] * math.exp(x) for name, x in zip(scale, logs, strict=True)})

    def residual(logs: FloatArray) -> FloatArray:
        return np.asarray(observed.residual(at(logs), settled)[0][settled])

    first = np.zeros(len(scale))
    begin("fitting", 0.95)
    noise = float(np.median(np.abs(residual(first)))) / 0.6745
    # The fit's variables are about 1, since the numerical slopes take steps relative to them.
    found = least_squares(
        lambda x: residual(x - 1.0) / noise, 1.0 + first, diff_step=_STEP,
        x_scale=[_SCALES[name] for name in scale], bounds=(first + 1.0 - _WIDEST, first + 1.0 + _WIDEST), xtol=1e-6,
    )  # fmt: skip
    left, logs = found.fun * noise, found.x - 1.0
    slopes = -found.jac * noise
    error = compile_machine(at(logs), outputs=(TORQUE,)).reached_error * float(np.sqrt(np.mean(observed.torque**2)))
    spread = uncertainty_by_turns(slopes, left, observed.turn[settled]).wider(list(_biases(slopes, error)))
    parameters = {}
    for k, name in enumerate(scale):
        value = scale[name] * math.exp(logs[k])
        parameters[name] = spread.estimate(k, 0.0).scaled(value, value)
    return ShaftIdentification(
        parameters,
        float(np.sqrt(np.mean(before[settled] ** 2))),
        float(np.sqrt(np.mean(left**2))),
        at(logs),
        tuple(
            f"{name} is 0 in the machine file: give a first value to estimate it"
            for name in _NAMES
            if name not in scale
        ),
    )


def _biases(slopes: FloatArray, error_Nm: float) -> FloatArray:
    """(k, k) by how much an error of the predicted torque of that root mean square may move each estimate.

    The worst error has the pattern of the estimate's row of the pseudo-inverse; it counts as two standard deviations.
    """
    rows = np.linalg.norm(np.linalg.pinv(slopes), axis=1)
    return np.asarray(np.diag(0.5 * error_Nm * math.sqrt(len(slopes)) * rows))


def _shaft(machine: Machine) -> MainShaft:
    assert machine.shaft is not None
    return machine.shaft


def _end_to_end(values: FloatArray) -> float:
    """Stiffness or damping of pieces in series; 0 where one has none."""
    return float(1.0 / np.sum(1.0 / values)) if (values > 0.0).all() else 0.0


def _values(machine: Machine) -> dict[str, float]:
    """The parameters' values of a machine."""
    shaft = _shaft(machine)
    ratios = np.array(shaft.speed_ratios[1:])
    stiffness, damping = (
        np.array(each) * ratios**2
        for each in ([p.stiffness for p in shaft.pieces], [p.damping_Nms_rad for p in shaft.pieces])
    )
    drive = (shaft.drive.inertia_kgm2 or 0.0, shaft.drive.slip_Nms_rad or 0.0)
    return dict(zip(_NAMES, (_end_to_end(stiffness), _end_to_end(damping), *drive), strict=True))


def _changed(machine: Machine, values: Mapping[str, float]) -> Machine:
    """The machine with other values of some parameters; pieces keep their proportions and their own inertia."""
    shaft, now = _shaft(machine), _values(machine)
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


def _with_unknown_drive(machine: Machine) -> Machine:
    """The machine with a drive whose inertia and slip the observer estimates."""
    shaft = _shaft(machine)
    drive = replace(shaft.drive, inertia_kgm2=None, slip_Nms_rad=None)
    return replace(machine, shaft=replace(shaft, drive=drive))


def _observed_drive(readings: Readings, machine: Machine) -> Machine:
    """The machine with the drive that the observer estimates."""
    twin = compile_machine(machine, outputs=(TORQUE,))
    assert isinstance(twin, ElasticTwin)
    drive = twin.observed_drive(readings.angle_stamps_ns, readings.angle, readings.velocities)
    return replace(machine, shaft=replace(_shaft(machine), drive=drive))
