"""Readings of an elastic shaft: prepared for its observer, and converted to those of a rigid one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.alignment import fast_speed
from textile_twin_core.comparison.evidence import REST_SHARE
from textile_twin_core.comparison.expected_reading import filtered_at
from textile_twin_core.comparison.readings import AngleUnit, Readings
from textile_twin_core.comparison.shaft_track import ShaftTrack
from textile_twin_core.driveline import elastic_shaft
from textile_twin_core.driveline.observer import ShaftObserver
from textile_twin_core.driveline.observer_step import NEW_STRETCH, shaft_readings
from textile_twin_core.inference.elastic_torque import ElasticTorque
from textile_twin_core.inference.priors import WorkingPoint, parameters, shaft_parameters
from textile_twin_core.machine import AnyMachine, Machine, TorqueFilter
from textile_twin_core.shaft import create_estimator
from textile_twin_core.twin import compile_rigid
from textile_twin_core.twin.session import encoder_settings

_TORQUE = "balancing_torque_Nm"
_FEWEST, _FEWEST_ANGLES = 16, 256
_RUNS, _RUN_ANGLES = 2, 6000
"""Number of runs of a long recording, and readings in each: from the start on, with a run-up, and in the middle."""


def elastic_torque(readings: Readings, unit: AngleUnit, machine: Machine) -> ElasticTorque | None:
    """Prepare the prediction for a recording, or for two runs of a long one; None for too few usable angles.

    A drive whose inertia or slip the machine file leaves out is estimated first.
    """
    encoder = machine.sensors.encoder
    angle = readings.angle * unit.to_radians
    speeds = None if readings.velocities is None else encoder.shaft_speed(angle, readings.velocities * unit.to_radians)
    estimator = create_estimator("causal", **encoder_settings(encoder))
    states = estimator.step(readings.angle_stamps_ns, encoder.shaft_angle(angle), speeds)
    if len(states) < _FEWEST_ANGLES:
        return None
    chosen, begins = _in_runs(states.omega_rad_s)
    rows = states.rows[chosen]
    rows["cut"][begins] = NEW_STRETCH
    accepted, shaft = shaft_readings(rows), machine.shaft
    assert shaft is not None
    since_ns = np.asarray(states.stamps, np.int64)[chosen] - int(readings.angle_stamps_ns[0])
    time: FloatArray = np.asarray(since_ns * 1e-9, np.float64)
    learned = None in (shaft.drive.inertia_kgm2, shaft.drive.slip_Nms_rad)
    if learned:
        observer = ShaftObserver(elastic_shaft(machine), machine.nominal_speed_rad_s)
        observer.take(accepted)
        inertia, slip = observer.drive_inertia_kgm2, max(observer.drive_slip_Nms_rad, 0.0)
        machine = replace(
            machine, shaft=replace(shaft, drive=replace(shaft.drive, inertia_kgm2=inertia, slip_Nms_rad=slip))
        )
    known, _ = parameters(machine, WorkingPoint(1.0, machine.nominal_speed_rad_s, 1.0))
    of_shaft = shaft_parameters(machine, learned)
    return ElasticTorque(machine, accepted, time, known, of_shaft)


def _in_runs(omega_rad_s: FloatArray) -> tuple[IntArray, IntArray]:
    """Rows of the runs, and the places of their first readings among these."""
    turning = np.flatnonzero(np.abs(omega_rad_s) > REST_SHARE * fast_speed(omega_rad_s))
    if omega_rad_s.size <= _RUNS * _RUN_ANGLES or not turning.size:
        return np.arange(omega_rad_s.size), np.zeros(1, np.int64)
    first = int(turning[0])
    second = max(int(turning[turning.size // 2]) - _RUN_ANGLES // 2, first + _RUN_ANGLES)
    chosen = np.concatenate([np.arange(first, first + _RUN_ANGLES), np.arange(second, second + _RUN_ANGLES)])
    chosen = chosen[chosen < omega_rad_s.size]
    return chosen, np.array([0, _RUN_ANGLES] if second > first + _RUN_ANGLES else [0])


def without_elasticity(
    readings: Readings,
    machine: AnyMachine,
    track: ShaftTrack | None,
    stamps_ns: IntArray,
    torque_Nm: FloatArray,
    settled: BoolArray,
) -> Readings:
    """Subtract the difference between the elastic and the rigid shaft from the measured torque.

    The residual against the rigid equation then equals that against the elastic prediction. Torques without a settled
    prediction become NaN.

    Args:
        readings: The recording.
        machine: Its machine; with a rigid shaft the readings are returned unchanged.
        track: Motion of the encoder's station, with the encoder's own direction and zero.
        stamps_ns, torque_Nm, settled: (n,) predictions of the elastic shaft.

    Returns:
        The readings, unchanged where the rigid equation correlates better with them than the elastic prediction.
    """
    rigid_shaft = replace(readings, as_rigid=True)
    if not isinstance(machine, Machine) or machine.shaft is None or track is None or stamps_ns.size < _FEWEST:
        return rigid_shaft
    encoder, sensor = machine.sensors.encoder, machine.sensors.torque
    origin = int(readings.angle_stamps_ns[0])
    time: FloatArray = np.asarray((readings.torque_stamps_ns - origin) * 1e-9 - sensor.delay_s, np.float64)
    known: FloatArray = np.asarray((stamps_ns - origin) * 1e-9, np.float64)
    torque_filter = TorqueFilter.of(sensor)
    at = time if torque_filter.is_identity else known
    theta, omega, alpha, inside = track.at(at)
    theta = encoder.direction * (theta - encoder.zero_rad * encoder.ratio)
    rigid = compile_rigid(machine, [_TORQUE]).evaluate(theta, encoder.direction * omega, encoder.direction * alpha)
    rigid_Nm, elastic = rigid[_TORQUE], torque_Nm
    nearest = np.clip(np.searchsorted(known, time), 0, known.size - 1)
    good = settled[nearest] & np.isfinite(readings.torque)
    if torque_filter.is_identity:
        elastic = np.interp(time, known, torque_Nm)
        good &= inside & np.isfinite(rigid_Nm) & np.isfinite(elastic)
    else:
        usable = inside & np.isfinite(rigid_Nm) & np.isfinite(elastic)
        if np.count_nonzero(usable) < _FEWEST:
            return rigid_shaft
        columns = [rigid_Nm[usable], elastic[usable]]
        jumps = [event.angle_rad for event in machine.events()]
        (rigid_Nm, elastic), clear = filtered_at(torque_filter, known[usable], columns, theta[usable], jumps, time)
        good &= clear
    if np.count_nonzero(good) < _FEWEST:
        return rigid_shaft
    measured, by_elastic, by_rigid = (each[good] for each in (readings.torque, elastic, rigid_Nm))
    if abs(_correlation(measured, by_elastic)) <= abs(_correlation(measured, by_rigid)):
        return rigid_shaft
    gain = float(np.cov(measured, by_elastic)[0, 1] / np.var(by_elastic, ddof=1))
    torque = np.full(readings.torque.size, np.nan)
    torque[good] = measured - gain * (by_elastic - by_rigid)
    return replace(rigid_shaft, torque=torque)


def _correlation(one: FloatArray, other: FloatArray) -> float:
    if not (np.ptp(one) > 0.0 and np.ptp(other) > 0.0):
        return 0.0
    return float(np.corrcoef(one, other)[0, 1])
