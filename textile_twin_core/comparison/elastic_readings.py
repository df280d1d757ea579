"""Measured torque of an elastic shaft, converted to that of a rigid one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.expected_reading import filtered_at
from textile_twin_core.comparison.readings import Readings
from textile_twin_core.comparison.shaft_track import ShaftTrack
from textile_twin_core.machine import AnyMachine, Machine, TorqueFilter
from textile_twin_core.twin import compile_rigid

_TORQUE = "balancing_torque_Nm"
_FEWEST = 16


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
    if not isinstance(machine, Machine) or machine.shaft is None or track is None or stamps_ns.size < _FEWEST:
        return readings
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
            return readings
        columns = [rigid_Nm[usable], elastic[usable]]
        jumps = [event.angle_rad for event in machine.events()]
        (rigid_Nm, elastic), clear = filtered_at(torque_filter, known[usable], columns, theta[usable], jumps, time)
        good &= clear
    if np.count_nonzero(good) < _FEWEST:
        return readings
    measured, by_elastic, by_rigid = (each[good] for each in (readings.torque, elastic, rigid_Nm))
    if abs(_correlation(measured, by_elastic)) <= abs(_correlation(measured, by_rigid)):
        return readings
    gain = float(np.cov(measured, by_elastic)[0, 1] / np.var(by_elastic, ddof=1))
    torque = np.full(readings.torque.size, np.nan)
    torque[good] = measured - gain * (by_elastic - by_rigid)
    return replace(readings, torque=torque)


def _correlation(one: FloatArray, other: FloatArray) -> float:
    if not (np.ptp(one) > 0.0 and np.ptp(other) > 0.0):
        return 0.0
    return float(np.corrcoef(one, other)[0, 1])
