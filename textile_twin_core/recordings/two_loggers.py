"""Torque from the file of a second logger, whose clock is brought to that of the angle by what both files hold."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.clock_offset import ClockOffset, Undetermined, find_clock_offset
from textile_twin_core.comparison.expected_reading import expected_readings
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Machine
from textile_twin_core.recordings.log_apply import LoggedChannel, newton_metres, radians, seconds_of
from textile_twin_core.recordings.log_mapping import Channel, LogMapping, OtherLogger
from textile_twin_core.recordings.log_table import Columns
from textile_twin_core.recordings.log_units import COUNTS, SPEED_UNITS, base_unit
from textile_twin_core.recordings.prediction import recompute
from textile_twin_core.recordings.samples import AngleSamples

_ADVICE = "record a start, a stop or a change of speed with both loggers, or give --torque-offset"


@dataclass(frozen=True)
class ClocksOnOne:
    """Mapping of the second log with the offset of its clock, and how it was found, for people."""

    torque_log: OtherLogger
    text: str


def on_clock_of_angle(
    mapping: LogMapping,
    columns: Columns,
    angle: LoggedChannel,
    torque_log: OtherLogger,
    other: Columns,
    shared: list[Channel],
    machine: Machine | None,
) -> ClocksOnOne:
    """Estimate the offset of a second log's clock: by a speed or an angle of both, or by the predicted torque.

    Args:
        mapping, columns, angle: of the first log, and its angle.
        torque_log, other: torque and clock of the second log, and its columns.
        shared: columns of the second log that may be the speed or the angle of the shaft.
        machine: predicts the torque where the second log has neither; None: such a log is refused.

    Raises:
        RecordingError: The offset is not determined.
    """
    seconds = seconds_of(torque_log.clock, other)
    first = _first_second(mapping, columns)
    theta = np.unwrap(angle.values)
    time_s = first + (angle.stamps - angle.stamps[0]) * 1e-9
    rises = np.append(True, np.diff(time_s) > 0.0)
    time_s, theta = time_s[rises], theta[rises]
    found: list[tuple[ClockOffset, Channel, str]] = []
    speed = np.gradient(theta, time_s)
    for channel in shared:
        known = _rising(seconds, values := _speed(channel, other[channel.column], seconds))
        offset = find_clock_offset(time_s, speed, seconds[known], values[known])
        found.append((offset, channel, f"column '{channel.column}' and the speed of the angle"))
    if not found and machine is not None:
        torque = newton_metres(torque_log.torque, other)
        known = _rising(seconds, torque)
        samples = AngleSamples("main_shaft/angle", angle.stamps, angle.values, None)
        predicted = recompute(samples, machine, "smooth")
        sensor, good = machine.sensors.torque, predicted.settled
        reading = expected_readings(sensor, predicted.stamps_ns, predicted.torque_Nm, predicted.theta_rad)
        at = first + sensor.delay_s + (predicted.stamps_ns[good] - angle.stamps[0]) * 1e-9
        offset = find_clock_offset(at, reading[good], seconds[known], torque[known])
        found.append(
            (offset, Channel(), "the torque and the prediction, with the file's encoder zero and torque sensor")
        )
    if not found:
        raise RecordingError(
            "the torque's log has no speed and no angle of the shaft, so the offset of its clock is unknown: give"
            " --machine, whose predicted torque shows it, or --torque-offset"
        )
    best, channel, by = max(found, key=lambda each: (each[0].undetermined is None, abs(each[0].correlation)))
    if best.undetermined is not None:
        raise RecordingError(f"the offset of the torque's clock is not determined by {by}: {_reason(best)}; {_ADVICE}")
    begin = float(seconds[np.isfinite(seconds)][0])  # from which OtherLogger counts the drift
    offset_s = best.offset_s + best.drift * (begin - best.origin_s)
    text = (
        f"the torque's times {offset_s:+.4f} s +- {best.half_width_s * 1e3:.2g} ms, drift {best.drift * 1e6:+.1f}"
        f" +- {best.drift_half_width * 1e6:.1f} ppm, by {by} (correlation {best.correlation:.4f})"
    )
    done = replace(torque_log, shared=channel, offset_s=offset_s, drift=best.drift)
    return ClocksOnOne(done, text)


def _reason(found: ClockOffset) -> str:
    if found.undetermined is Undetermined.TOO_SHORT:
        return "the logs have too short a part in common"
    if found.undetermined is Undetermined.UNRELATED:
        return f"the two do not agree at any offset (correlation {found.correlation:.2f} at most)"
    if found.undetermined is Undetermined.AMBIGUOUS:
        return f"{found.offset_s:.4f} s and {found.other_offset_s:.4f} s fit alike"
    return f"{found.offset_s:.4f} s is known to +- {found.half_width_s * 1e3:.2g} ms only"


def _first_second(mapping: LogMapping, columns: Columns) -> float:
    """Time of the first angle on its own clock."""
    seconds, values = seconds_of(mapping.clock, columns), columns[mapping.angle.column]
    return float(seconds[np.isfinite(seconds) & np.isfinite(values)][0])


def _rising(seconds: FloatArray, values: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Mask of the rows (n,) with a value and a time later than all before."""
    known = np.isfinite(seconds) & np.isfinite(values)
    latest = np.maximum.accumulate(np.where(known, seconds, -np.inf))
    return known & (np.append(-np.inf, latest[:-1]) < seconds)


def _speed(channel: Channel, values: FloatArray, seconds: FloatArray) -> FloatArray:
    """Return the speed of a column of speeds, in any unit, or of angles."""
    if not channel.unit or base_unit(channel.unit) in SPEED_UNITS or base_unit(channel.unit) == COUNTS:
        return values
    angle = radians(channel, values)
    known = _rising(seconds, angle)
    speed = np.full(values.shape, np.nan)
    speed[known] = np.gradient(np.unwrap(angle[known]), seconds[known])
    return speed
