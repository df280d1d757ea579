"""Overlay of a recording on the torque of the page: measured torque by shaft angle."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.alignment import fast_speed
from textile_twin_core.comparison.inputs import usable_measurements
from textile_twin_core.comparison.range_ends import at_range_ends, range_end_note
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Machine, TorqueFilter
from textile_twin_core.recordings.logged_run import open_run
from textile_twin_core.recordings.machine_topics import MachineTopics, unit_notes
from textile_twin_core.recordings.prediction import recompute

_BINS = 360
_TURNING_SHARE = 0.1
"""Least speed over the fast recorded speeds; a shaft at standstill would fill one bin with its holding torque."""


@dataclass(frozen=True)
class Overlay:
    """Measured torque over one turn: mean torque [N m] by bin of the angle [rad]; NaN in empty bins.

    `notes` are remarks on the recording for the user.
    """

    name: str
    theta_rad: FloatArray
    torque_Nm: FloatArray
    notes: tuple[str, ...] = ()


def overlay(path: str | Path, machine: Machine, topics: MachineTopics | None = None) -> Overlay:
    """Average the measured torque of a recording by shaft angle, corrected for sensor delay, gain and offset.

    The filter of the sensor is not undone. Torques at the limits of the sensor's range are excluded.

    Raises:
        RecordingError: The recording cannot be read, or has no torque while the shaft turns.
    """
    run = open_run(Path(path), topics or MachineTopics(), machine)
    angles, measured = run.angles, run.measured
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
    notes = [*run.notes, *unit_notes(angles)]
    if not TorqueFilter.of(sensor).is_identity:
        notes.append("the curve is the torque behind the filter of its sensor")
    if ends_Nm.size:
        notes.append(range_end_note(int(np.count_nonzero(cut)), ends_Nm, "the curve is"))
    return Overlay(Path(path).name, centres, mean, tuple(notes))
