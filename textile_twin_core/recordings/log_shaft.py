"""Raw channels of a test rig: pickup voltage to edges of a toothed wheel, force on a point to torque."""

from __future__ import annotations

import numpy as np
import scipy

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Machine
from textile_twin_core.recordings.machine_topics import referred
from textile_twin_core.recordings.samples import AngleSamples
from textile_twin_core.twin import compile_machine
from textile_twin_core.twin.encoder_reference import reference_of

_PASSED = 2.7
"""Low-pass frequency of the pickup over the rate of the teeth: removes noise without moving the edges."""
_NEAREST = 0.4
_FEWEST_EDGES = 16
_ABOUT_ZERO_RAD = np.deg2rad(45.0)


def tooth_edges(time_s: FloatArray, volts: FloatArray) -> FloatArray:
    """Times [s] at which a pickup's voltage (n,), evenly sampled, rises through its middle, one for each tooth.

    The voltage passes a second-order zero-phase low-pass at 2.7 times the rate of the teeth. The middle lies between
    the 5th and 95th percentile; crossings closer than 0.4 of the median interval are the same tooth. Raises
    RecordingError with too few edges.
    """
    low, high = np.percentile(volts, [5.0, 95.0])
    middle, rate = 0.5 * (low + high), 1.0 / float(np.median(np.diff(time_s)))
    wave = volts - middle
    found = _rising(time_s, wave)
    if found.size > _FEWEST_EDGES:
        cutoff = _PASSED / float(np.median(np.diff(_apart(found))))
        if cutoff < 0.4 * rate:
            low_pass = scipy.signal.butter(2, cutoff, fs=rate, output="sos")
            found = _rising(time_s, np.asarray(scipy.signal.sosfiltfilt(low_pass, wave)))
    if found.size < _FEWEST_EDGES:
        raise RecordingError(f"only {found.size} teeth pass the pickup: is that its column, and does the shaft turn?")
    return _apart(found)


def _rising(time_s: FloatArray, wave: FloatArray) -> FloatArray:
    """Rising crossings of zero, interpolated."""
    i = np.flatnonzero((wave[:-1] < 0.0) & (wave[1:] >= 0.0))
    return np.asarray(time_s[i] - wave[i] / (wave[i + 1] - wave[i]) * (time_s[i + 1] - time_s[i]))


def _apart(time_s: FloatArray) -> FloatArray:
    """Drop times that follow another too soon."""
    if time_s.size < 2:
        return time_s
    least = _NEAREST * float(np.percentile(np.diff(time_s), 75.0))
    kept = [float(time_s[0])]
    for one in time_s[1:].tolist():
        if one - kept[-1] >= least:
            kept.append(one)
    return np.array(kept)


def force_torque(
    machine: Machine,
    measure: str,
    angles: tuple[IntArray, FloatArray],
    stamps_ns: IntArray,
    force_N: FloatArray,
    zero_at_rad: float | None,
) -> tuple[IntArray, FloatArray]:
    """Torque [N m] with which a force along a measure drives the shaft: force times travel per radian.

    Args:
        machine: with the measure and the encoder. measure: name of a displacement, such as piston.
        angles: stamps [ns] and encoder angles [rad], unwrapped. stamps_ns, force_N: (m,) the force, positive along the
            measure.
        zero_at_rad: shaft angle without a force, for sensors that drift: the median within 45 degrees of it is
            subtracted, in a cycle of several turns that of the turn with the least force.

    Returns:
        Stamps and torque, where the angle is known.
    """
    name = f"{measure}_velocity_m_s"
    if name not in machine.outputs:
        there = ", ".join(each.name for each in machine.measures) or "none"
        raise RecordingError(f"machine '{machine.name}' has no measure '{measure}'; there are: {there}")
    encoder = machine.sensors.encoder
    origin = int(angles[0][0])
    time, known = (stamps_ns - origin) * 1e-9, (angles[0] - origin) * 1e-9
    inside = (time >= known[0]) & (time <= known[-1]) & np.isfinite(force_N)
    measured = np.interp(time[inside], known, angles[1])
    theta = encoder.shaft_angle(measured)
    travel = compile_machine(machine, [name]).evaluate(theta, np.ones_like(theta), np.zeros_like(theta))[name]
    force = force_N[inside]
    if zero_at_rad is not None:
        force = force - _force_zero(theta, force, zero_at_rad, encoder.cycle_turns)
    return stamps_ns[inside], np.asarray(force * travel)


def _force_zero(theta: FloatArray, force: FloatArray, zero_at_rad: float, cycle_turns: int) -> float:
    """Median force about an angle, in the turn of the cycle with the smallest one."""
    turn, place = np.divmod(theta - zero_at_rad + np.pi, 2.0 * np.pi)
    near = np.abs(place - np.pi) < _ABOUT_ZERO_RAD
    levels = [
        float(np.median(force[near & (np.mod(turn, cycle_turns) == k)]))
        for k in range(cycle_turns)
        if (near & (np.mod(turn, cycle_turns) == k)).any()
    ]
    if not levels:
        raise RecordingError("the record does not pass the angle at which the force is none")
    usual = float(np.median(force))
    return min(levels, key=lambda level: abs(level - usual))


def edge_angles(machine: Machine, stamps_ns: IntArray) -> tuple[IntArray, FloatArray]:
    """Return stamps and encoder angles of the edges of this machine's wheel. Raises SceneError, RecordingError."""
    reference = reference_of(machine.sensors.encoder, True, False)
    angles = AngleSamples("main_shaft/angle", stamps_ns, np.zeros(stamps_ns.size), None)
    assert reference is not None
    counted = referred(angles, reference, np.empty(0, np.int64))
    return counted.stamps, counted.angles_rad
