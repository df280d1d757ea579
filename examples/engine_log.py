"""Recording from the raw channels of an engine rig: the voltage of a pickup on a toothed wheel, and a pressure.

python examples/engine_log.py LOG.txt MACHINE.yaml RECORDING [--pickup 1 --pressure 2 --newton -4674.6]

The machine file gives the teeth of the wheel and, by its measure `piston`, the travel along which the force acts. The
rows of the log are evenly sampled at RATE_HZ. Change the constants for a rig of your own.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import scipy

from textile_twin_core import compile, load_machine
from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Machine
from textile_twin_core.recordings import BagWriter
from textile_twin_core.recordings.machine_topics import referred
from textile_twin_core.recordings.samples import AngleSamples
from textile_twin_core.twin.encoder_reference import reference_of

RATE_HZ = 100_000.0
MEASURE = "piston"
ZERO_RAD, ABOUT_ZERO_RAD = np.deg2rad(270.0), np.deg2rad(45.0)
"""Shaft angle of the exhaust stroke, about which the gas force is zero: the sensor drifts."""
PASSED = 2.7
"""Low-pass frequency of the pickup over the rate of the teeth: removes noise without moving the edges."""
NEAREST = 0.4
"""Least distance of two teeth over the usual one."""


def tooth_edges(time_s: FloatArray, volts: FloatArray) -> FloatArray:
    """Find the times [s] at which a pickup's voltage (n,) rises through its middle, one for each tooth."""
    low, high = np.percentile(volts, [5.0, 95.0])
    wave, rate = volts - 0.5 * (low + high), 1.0 / float(np.median(np.diff(time_s)))
    found = _apart(_rising(time_s, wave))
    if found.size < 16:
        raise RecordingError(f"only {found.size} teeth pass the pickup: is that its column, and does the shaft turn?")
    cutoff = PASSED / float(np.median(np.diff(found)))
    if cutoff < 0.4 * rate:
        low_pass = scipy.signal.butter(2, cutoff, fs=rate, output="sos")
        found = _apart(_rising(time_s, np.asarray(scipy.signal.sosfiltfilt(low_pass, wave))))
    return found


def _rising(time_s: FloatArray, wave: FloatArray) -> FloatArray:
    i = np.flatnonzero((wave[:-1] < 0.0) & (wave[1:] >= 0.0))
    return np.asarray(time_s[i] - wave[i] / (wave[i + 1] - wave[i]) * (time_s[i + 1] - time_s[i]))


def _apart(time_s: FloatArray) -> FloatArray:
    """Drop times that follow another too soon."""
    if time_s.size < 2:
        return time_s
    least = NEAREST * float(np.percentile(np.diff(time_s), 75.0))
    kept = [float(time_s[0])]
    for one in time_s[1:].tolist():
        if one - kept[-1] >= least:
            kept.append(one)
    return np.array(kept)


def gas_torque(
    machine: Machine, edges_ns: IntArray, stamps_ns: IntArray, force_N: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Convert a force along the measure to the torque [N m] with which it drives the shaft."""
    encoder = machine.sensors.encoder
    reference = reference_of(encoder, True, False)
    if reference is None:
        raise RecordingError("the machine file's encoder has no teeth")
    counted = referred(
        AngleSamples("main_shaft/angle", edges_ns, np.zeros(edges_ns.size), None), reference, edges_ns[:0]
    )
    inside = (stamps_ns >= counted.stamps[0]) & (stamps_ns <= counted.stamps[-1])
    origin = int(edges_ns[0])
    measured = np.interp(stamps_ns[inside] - origin, counted.stamps - origin, counted.angles_rad)
    theta = encoder.shaft_angle(measured)
    velocity = f"{MEASURE}_velocity_m_s"
    travel = compile(machine, outputs=[velocity]).evaluate(theta, np.ones_like(theta), np.zeros_like(theta))[velocity]
    force = force_N[inside]
    turn, place = np.divmod(theta - ZERO_RAD + np.pi, 2.0 * np.pi)
    near, turns = np.abs(place - np.pi) < ABOUT_ZERO_RAD, encoder.cycle_turns
    levels = [float(np.median(force[near & (np.mod(turn, turns) == k)])) for k in range(turns)]
    zero = min(levels, key=lambda level: abs(level - float(np.median(force))))  # of the turn that exhausts
    return stamps_ns[inside], np.asarray((force - zero) * travel)


def main() -> None:
    """Read the log and write the recording."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("log", type=Path)
    parser.add_argument("machine")
    parser.add_argument("out", type=Path)
    parser.add_argument("--pickup", type=int, default=1, help="column of the pickup, from 0")
    parser.add_argument("--pressure", type=int, default=2)
    parser.add_argument("--newton", type=float, default=-4674.6, help="force along the measure per volt")
    arguments = parser.parse_args()
    machine = load_machine(arguments.machine)
    table = np.loadtxt(arguments.log)
    time_s = np.arange(len(table)) / RATE_HZ
    stamps = 1_000_000_000 + np.rint(time_s * 1e9).astype(np.int64)
    edges = 1_000_000_000 + np.rint(tooth_edges(time_s, table[:, arguments.pickup]) * 1e9).astype(np.int64)
    at, torque = gas_torque(machine, edges, stamps, arguments.newton * table[:, arguments.pressure])
    with BagWriter(arguments.out) as out:
        out.write_events("main_shaft/angle", edges)
        out.write_wrenches("balancing_torque/measured", at, torque)
    print(f"{arguments.out}: {edges.size} teeth, {at.size} torques")


if __name__ == "__main__":
    main()
