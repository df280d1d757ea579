"""A recording laid over the page's torque: the measured torque by the angle of the shaft."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.alignment import fast_speed
from textile_twin_core.comparison.inputs import usable_measurements
from textile_twin_core.comparison.range_ends import at_range_ends, range_end_note
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Machine
from textile_twin_core.recordings import open_bag
from textile_twin_core.recordings.machine_topics import MachineTopics, unit_notes
from textile_twin_core.recordings.prediction import recompute
from textile_twin_core.recordings.recorded_clock import on_one_clock
from textile_twin_core.recordings.sample_times import evenly_timed

_BINS = 360
_TURNING_SHARE = 0.1
"""Of the fast end of the recorded speeds; a shaft at rest fills one bin with what it takes to hold it."""


@dataclass(frozen=True)
class Overlay:
    """Measured torque over one turn: middle of each bin [rad] and the mean torque in it [N m]; NaN where none fell.

    notes: what a person should know of the recording.
    """

    name: str
    theta_rad: FloatArray
    torque_Nm: FloatArray
    notes: tuple[str, ...] = ()


def overlay(path: str | Path, machine: Machine, topics: MachineTopics | None = None) -> Overlay:
    """The measured torque of a recording by the angle that the machine's encoder gives, sensor delay, gain, offset out.

    Without torques at an end of their sensor's range. Raises RecordingError where the recording cannot be read or
    holds no torque while the shaft moves.
    """
    bag = open_bag(Path(path))
    topics = topics or MachineTopics()
    angles = topics.read_angles(bag, machine.sensors.encoder)
    measured, clocks = on_one_clock(angles, topics.read_torques(bag))
    angles, measured, timings = evenly_timed(angles, measured, machine)
    shaft = recompute(angles, machine, "smooth", None)
    sensor = machine.sensors.torque
    begin = shaft.stamps_ns[0]
    stamps, measured_Nm, _ = usable_measurements(measured.stamps, measured.torque_Nm)
    at = (stamps - begin) * 1e-9 - sensor.delay_s
    known = (shaft.stamps_ns - begin) * 1e-9
    speed = np.abs(np.diff(shaft.theta_rad) / np.diff(known))
    turning = (speed > 0.0) & (speed >= _TURNING_SHARE * fast_speed(speed))
    inside = (at >= known[0]) & (at < known[-1])
    inside[inside] = turning[np.searchsorted(known, at[inside], side="right") - 1]
    cut = at_range_ends(measured_Nm[inside])
    ends_Nm = np.unique(measured_Nm[inside][cut])
    inside[inside] = ~cut
    if not inside.any():
        raise RecordingError(f"{path}: no torque was measured while the shaft turns and its angle is known")
    theta = np.mod(np.interp(at[inside], known, shaft.theta_rad), 2.0 * np.pi)
    torque = (measured_Nm[inside] - sensor.offset_Nm) / sensor.gain
    bins = np.minimum((theta * (_BINS / (2.0 * np.pi))).astype(int), _BINS - 1)
    count = np.bincount(bins, minlength=_BINS)
    with np.errstate(invalid="ignore"):
        mean = np.bincount(bins, torque, minlength=_BINS) / count
    centres = (np.arange(_BINS, dtype=np.float64) + 0.5) * (2.0 * np.pi / _BINS)
    notes = [*bag.notices, *unit_notes(angles), *clocks, *(timing.text for timing in timings)]
    if ends_Nm.size:
        notes.append(range_end_note(int(np.count_nonzero(cut)), ends_Nm, "the curve is"))
    return Overlay(Path(path).name, centres, mean, tuple(notes))
