"""Conversion of a log by a complete mapping: stamps, radians, N m and SI units, and the recording of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.readings import ANGLE_TURNS, radians_of
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.bag_write import BagWriter
from textile_twin_core.recordings.count_lattice import count_lattice
from textile_twin_core.recordings.counter import unwrap_counter
from textile_twin_core.recordings.log_mapping import NO_COLUMN, Channel, Clock, LogMapping
from textile_twin_core.recordings.log_table import describe
from textile_twin_core.recordings.log_units import (
    COUNTS,
    QUANTITY_UNITS,
    SPEED_UNITS,
    TIME_UNITS,
    TORQUE_UNITS,
    spelled,
    unit_factor,
    unit_in_name,
)
from textile_twin_core.recordings.machine_topics import ANGLE_TOPIC, MEASURED_TOPIC, SECOND_ANGLE_TOPIC
from textile_twin_core.recordings.recording import Progress

MEASURED = "measured"
"""Prefix of the topics of quantities other than torque: JointState, position of the joint named as the output."""
DATED, FILETIME = "date", "filetime"
"""Units of columns that are seconds since 1970 after reading, and of ticks of 100 ns since 1601."""
PARTS = {"ns": 1e9, "us": 1e6, "ms": 1e3}
"""Parts of a second."""
_1601_S = 11_644_473_600.0
_EXCEL_DAYS, _EXCEL_1970 = (20_000.0, 80_000.0), 25569.0
"""Excel's numbers of the days from 1954 to 2119; it counts from 30 December 1899."""
_LATEST_S = 9.2e9
"""Nanoseconds since 1970 end in 2262."""
_PIECE = 4096
"""Rows of the angle that are written together."""
_CLOSE, _FAR = 0.5, 100.0
"""Shortest and longest step, over the usual one, of rows out of order that are sorted by time."""
_FIRST_NS, _EPOCH_S, _BEFORE_S = 1_000_000_000, 1e8, 0.9
"""Stamp of the first row of a log without dates, since 0 means in ROS that there is no stamp,
and the time before it from which another log is used."""


@dataclass(frozen=True)
class LoggedChannel:
    """Samples of a channel: stamps (n,) [ns] and values (n,) in SI units, with remarks for people."""

    stamps: IntArray
    values: FloatArray
    note: str = ""


@dataclass(frozen=True)
class LoggedSamples:
    """Samples of a log: shaft angle with speed, torque, second encoder, and other quantities by output."""

    angle: LoggedChannel
    omega: FloatArray | None = None
    torque: LoggedChannel | None = None
    second_angle: LoggedChannel | None = None
    quantities: Mapping[str, LoggedChannel] = field(default_factory=dict)
    clock_note: str = ""

    def write(self, out: BagWriter, progress: Progress = lambda _: None) -> None:
        """Write the topics of a recording, in pieces of equal time, so that a part of its file has all of them."""
        pieces = self.angle.values.size // _PIECE + 1
        for k in range(pieces):

            def piece(channel: LoggedChannel, k: int = k) -> tuple[IntArray, FloatArray]:
                here = slice(k * channel.values.size // pieces, (k + 1) * channel.values.size // pieces)
                return channel.stamps[here], channel.values[here]

            stamps, angles = piece(self.angle)
            omega = None if self.omega is None else piece(LoggedChannel(self.angle.stamps, self.omega))[1]
            out.write_joint_states(ANGLE_TOPIC, stamps, ["main_shaft"], angles, omega)
            progress(stamps.size)
            if self.torque is not None:
                stamps, torques = piece(self.torque)
                out.write_wrenches(MEASURED_TOPIC, stamps, torques)
                progress(stamps.size)
            if self.second_angle is not None:
                stamps, angles = piece(self.second_angle)
                out.write_joint_states(SECOND_ANGLE_TOPIC, stamps, ["main_shaft"], angles)
            for output, channel in self.quantities.items():
                stamps, values = piece(channel)
                out.write_joint_states(f"{MEASURED}/{output}", stamps, [output], values)
                progress(stamps.size)


def apply(
    mapping: LogMapping, columns: Mapping[str, FloatArray], torque_log: Mapping[str, FloatArray] | None = None
) -> LoggedSamples:
    """Convert the columns of a log by a mapping without gaps; nothing is guessed.

    Args:
        mapping: complete, as `guess` returns it.
        columns: of the log. torque_log: of the second logger's file, if the mapping has one with its offset.

    Raises:
        RecordingError: A column is missing or has no values, a unit is unknown, or the times fall.
    """
    rows = _Rows(mapping, columns)
    theta = radians(mapping.angle, _column(columns, mapping.angle))
    theta, counts = _own_readings(theta, mapping.angle.unit)
    angle, here = rows.channel(mapping.angle, theta, "angle")
    omega = None
    if mapping.speed.column not in ("", NO_COLUMN):
        omega = rad_per_s(mapping.speed, _column(columns, mapping.speed))
        if omega.size != theta.size:
            raise RecordingError(f"column '{mapping.speed.column}' has other rows than the angle; leave --speed out")
        omega = omega[here]
    torque = second = None
    if mapping.torque.column not in ("", NO_COLUMN) and mapping.torque_log is None:
        torque, _ = rows.channel(mapping.torque, newton_metres(mapping.torque, columns), "torque")
    other = mapping.torque_log
    if other is not None and other.offset_s is not None and torque_log is not None:
        seconds = seconds_of(other.clock, torque_log)
        begin = float(seconds[np.isfinite(seconds)][0])
        seconds = seconds + other.offset_s + other.drift * (seconds - begin)
        torque, _ = rows.channel(other.torque, newton_metres(other.torque, torque_log), "torque", seconds=seconds)
    if mapping.second_angle.column not in ("", NO_COLUMN):
        theta, its_counts = _own_readings(
            radians(mapping.second_angle, _column(columns, mapping.second_angle)), mapping.second_angle.unit
        )
        second, _ = rows.channel(mapping.second_angle, theta, "second angle", its_counts)
    quantities = {}
    for output, channel in mapping.quantities.items():
        quantities[output], _ = rows.channel(channel, si_units(channel, columns), output)
    angle = LoggedChannel(angle.stamps, angle.values, counts + angle.note)
    return LoggedSamples(angle, omega, torque, second, quantities, rows.clock_note)


class _Rows:
    """Stamps of the rows of a log; those of all channels count from the first one of the angle."""

    def __init__(self, mapping: LogMapping, columns: Mapping[str, FloatArray]) -> None:
        self._mapping, self._columns = mapping, columns
        self._first: float | None = None
        self.clock_note = ""

    def channel(
        self, channel: Channel, values: FloatArray, kind: str, note: str = "", seconds: FloatArray | None = None
    ) -> tuple[LoggedChannel, IntArray]:
        """Return the samples of a channel that have a time and a value, and their rows; `seconds`: of another log."""
        clock = channel.clock or self._mapping.clock
        if seconds is None:
            seconds = seconds_of(clock, self._columns)
        elif self._first is not None and values.size == seconds.size:
            values = np.where(seconds > self._first - _BEFORE_S, values, np.nan)
        if values.size != seconds.size:
            raise RecordingError(
                f"{values.size} values, but {seconds.size} times in column '{clock.column}'; name the column of their"
                f" times: {own_times_option(kind)}"
            )
        known = np.isfinite(values)
        if not known.any():
            raise RecordingError(f"the {kind} has no number in any row; name another column, or import without it")
        here = np.flatnonzero(known & np.isfinite(seconds))
        if not here.size:
            raise RecordingError(
                f"no row has both a time and a value of the {kind}; name the column of its times:"
                f" {own_times_option(kind)}"
            )
        order, disorder = _in_order(seconds[here])
        here = here[order]
        stamps, late = self._stamps(seconds[here], clock, kind)
        late = disorder + late
        if kind == "angle":
            self.clock_note = _rows_without(np.isfinite(seconds)) + late
        elif clock != self._mapping.clock:
            note += late
        return LoggedChannel(stamps, values[here], note + _rows_without(known)), here

    def _stamps(self, seconds: FloatArray, clock: Clock, kind: str) -> tuple[IntArray, str]:
        if self._first is None:
            self._first = float(seconds[0])
        first = _FIRST_NS if abs(self._first) < _EPOCH_S else round(self._first * 1e9)
        since_first = np.rint((seconds - self._first) * 1e9).astype(np.int64)
        steps = np.diff(since_first)
        falls = np.count_nonzero(steps < 0) > np.count_nonzero(steps > 0)
        if not falls and first + int(since_first.min()) <= 0 and kind != "angle":
            raise RecordingError(
                f"column '{clock.column}' begins before the angle; name the column of the {kind}'s times:"
                f" {own_times_option(kind)}"
            )
        if falls or first + int(since_first.min()) <= 0:
            at = int(np.argmax(steps < 0)) + 2
            raise RecordingError(
                f"column '{clock.column}' decreases, first at row {at}: sort the rows by time, or where they are evenly"
                " spaced give --rate; where it holds the time since the row before give --time-steps"
            )
        return np.asarray(first + since_first, dtype=np.int64), _late_rows(steps)


def own_times_option(kind: str) -> str:
    """Describe how to name the column of the times of a channel."""
    if kind == "angle":
        return "--time COLUMN"
    return "--torque-time COLUMN" if kind == "torque" else f"`time: {{column: NAME}}` of '{kind}' in the --mapping file"


def seconds_of(clock: Clock, columns: Mapping[str, FloatArray]) -> FloatArray:
    """Return the times of a clock in seconds (n,), NaN where a row has none. Raises RecordingError."""
    if clock.rate_hz is not None:
        return np.arange(max(map(len, columns.values()))) / clock.rate_hz
    values = _column(columns, Channel(clock.column))
    if clock.wraps_at is not None:
        values = unwrap_counter(values, clock.wraps_at)
    if clock.steps:
        values = np.where(np.isfinite(values), np.nancumsum(values), np.nan)
    unit = spelled(clock.unit)
    if unit == FILETIME:
        values, factor = values * 1e-7 - _1601_S, 1.0
    else:
        factor = 1.0 if unit == DATED else unit_factor(unit, TIME_UNITS) or math.nan
    if math.isnan(factor):
        raise RecordingError(f"column '{clock.column}': time in '{clock.unit}'? available: {', '.join(TIME_UNITS)}")
    finite = values[np.isfinite(values)]
    if unit == "days" and finite.size and _EXCEL_DAYS[0] <= finite[0] <= _EXCEL_DAYS[1]:
        values = values - _EXCEL_1970
    seconds = np.asarray(values * factor)
    latest = float(np.abs(finite * factor).max(initial=0.0))
    if latest > _LATEST_S:
        raise RecordingError(
            f"column '{clock.column}': {latest:.6g} s in the unit '{clock.unit}' is no time; give --time-unit:"
            f" {', '.join(TIME_UNITS)}"
        )
    if not clock.fraction:
        return seconds
    parts = PARTS.get(spelled(clock.fraction_unit))
    if parts is None:
        raise RecordingError(f"column '{clock.fraction}': no parts of a second; {', '.join(PARTS)} are read")
    return np.asarray(seconds + _column(columns, Channel(clock.fraction)) / parts)


def angle_factor(channel: Channel) -> float:
    """Return radians per unit of an angle: a unit, a multiple of one, or the counts of a turn."""
    unit = spelled(channel.unit)
    factor = unit_factor(unit, {short: radians_of(short) for short in ANGLE_TURNS})
    try:
        return radians_of(unit) if factor is None else factor
    except ValueError:
        counts = unit == COUNTS or unit_factor(unit, {COUNTS: 1.0}) is not None
        known = (
            "how many make a turn? give --angle-unit 4096"
            if counts
            else ", ".join([*ANGLE_TURNS, "or the counts of a turn"])
        )
        raise RecordingError(
            f"column '{channel.column}': angle in '{unit}'? {'' if counts else 'available: '}{known}"
        ) from None


def radians(channel: Channel, values: FloatArray) -> FloatArray:
    """Convert an angle to radians, with the wraps of a counter undone."""
    values = values if channel.wraps_at is None else unwrap_counter(values, channel.wraps_at)
    return np.asarray(values * angle_factor(channel))


def rad_per_s(channel: Channel, values: FloatArray) -> FloatArray:
    """Convert a speed to rad/s."""
    factor = unit_factor(spelled(channel.unit), SPEED_UNITS)
    if factor is None:
        raise RecordingError(
            f"column '{channel.column}': speed in '{channel.unit}'? give --speed-unit: {', '.join(SPEED_UNITS)}"
        )
    return np.asarray(values * factor)


def newton_metres(channel: Channel, columns: Mapping[str, FloatArray]) -> FloatArray:
    """Convert a torque to N m."""
    factor = channel.scale if channel.scale is not None else unit_factor(spelled(channel.unit), TORQUE_UNITS)
    if factor is None:
        raise RecordingError(
            f"column '{channel.column}': torque in '{channel.unit}'? available: {', '.join(TORQUE_UNITS)}; for any"
            " other give --torque-scale, N m per unit"
        )
    return np.asarray(_column(columns, channel) * factor)


def si_units(channel: Channel, columns: Mapping[str, FloatArray]) -> FloatArray:
    """Convert a displacement, angle, speed or force to SI units."""
    unit = spelled(channel.unit) or unit_in_name(channel.column)
    factor = channel.scale if channel.scale is not None else unit_factor(unit, QUANTITY_UNITS) if unit else 1.0
    if factor is None:
        raise RecordingError(
            f"column '{channel.column}': a quantity in '{unit}'? available: {', '.join(QUANTITY_UNITS)}"
        )
    return np.asarray(_column(columns, channel) * factor)


def _column(columns: Mapping[str, FloatArray], channel: Channel) -> FloatArray:
    if channel.column not in columns:
        raise RecordingError(f"no column '{channel.column}'; available: {describe(columns)}")
    return columns[channel.column]


def _own_readings(angle: FloatArray, unit: str) -> tuple[FloatArray, str]:
    """Recover the encoder's readings from angles (n,) [rad] rounded in the log, and describe its counts."""
    known = np.isfinite(angle)
    turn = ANGLE_TURNS.get(spelled(unit))
    lattice = None if turn is None else count_lattice(np.unwrap(angle[known]), turn)
    if lattice is None:
        return angle, ""
    restored = angle.copy()
    restored[known] = lattice.restored(angle[known])
    return restored, f", rounded readings of an encoder of {lattice.counts} counts a turn: restored"


def _rows_without(here: BoolArray) -> str:
    """Describe the number of rows (n,) without a number; empty if all have one."""
    without = np.flatnonzero(~here)
    return f"; {without.size} rows without a number are not used, first row {without[0] + 1}" if without.size else ""


def _in_order(seconds: FloatArray) -> tuple[IntArray, str]:
    """Return the order (n,) of rows by time, and its description where it differs from that of the file.

    Rows whose times would lie closer together than usual belong to a clock that was set back, far ones to another time,
    and a time that mostly falls may count down: they keep their places.
    """
    order = np.argsort(seconds, kind="stable")
    steps, falls = np.diff(seconds[order]), np.flatnonzero(np.diff(seconds) < 0.0)
    usual = float(np.median(steps)) if steps.size else 0.0
    if not 0 < falls.size <= 0.5 * steps.size or steps.min() < _CLOSE * usual or steps.max() > _FAR * usual:
        return np.arange(seconds.size), ""
    return order, f"; {falls.size} rows come before an earlier one, first at row {falls[0] + 1}: sorted by time"


def _late_rows(steps: IntArray) -> str:
    """Describe times that repeat or fall from row to row; empty if they rise."""
    back, stands = np.flatnonzero(steps < 0), int(np.count_nonzero(steps == 0))
    text = f"; decreases at {back.size} rows, first at row {back[0] + 2}" if back.size else ""
    text += f"; {stands} rows have the time of the row before" if stands else ""
    what = "such rows are in the recording, and are left out where it is used; for evenly spaced rows give --rate, for"
    return f"{text}: {what} parts of a second in another column --time-fraction" if text else ""
