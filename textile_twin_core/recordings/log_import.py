"""Import of a log: choose columns, convert them to SI and write a recording of stamped messages."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.readings import ANGLE_TURNS
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Machine
from textile_twin_core.recordings.bag_write import BagWriter
from textile_twin_core.recordings.log_cells import LogTable
from textile_twin_core.recordings.log_choice import (
    Ask,
    choose_channel,
    choose_clock,
    has_same_times,
    own_clock,
    refuse_unknown,
)
from textile_twin_core.recordings.log_clocks import clock_seconds
from textile_twin_core.recordings.log_columns import (
    angle_radians,
    choose,
    describe,
    quantity_si,
    torque_newton_metres,
)
from textile_twin_core.recordings.log_mapping import NO_COLUMN, Channel, Clock, LogMapping
from textile_twin_core.recordings.log_shaft import edge_angles, force_torque, tooth_edges
from textile_twin_core.recordings.log_speed import EncoderSpeed, encoder_speed
from textile_twin_core.recordings.log_units import spelled, unit_in_name
from textile_twin_core.recordings.machine_topics import SECOND_ANGLE_TOPIC
from textile_twin_core.recordings.recording import Progress
from textile_twin_core.shaft.count_lattice import count_lattice

_FIRST_NS = 1_000_000_000
"""Stamp of the first row of a log without dates, since 0 means in ROS that there is no stamp."""
_EPOCH_S = 1e8
MEASURED = "measured"
"""Prefix of the topics of quantities other than torque: JointState, position of the joint named as the output."""


@dataclass(frozen=True)
class RawChannels:
    """Voltage of a pickup on a toothed wheel, and a force on a point of the machine.

    machine: gives the teeth of the wheel and the motion of the point. pickup: its column. measure, force: the
    displacement along which the force acts, and its column; empty without a force. newton: per unit of that column.
    zero_at_rad: see `force_torque`.
    """

    machine: Machine
    pickup: str
    measure: str = ""
    force: str = ""
    newton: float = 1.0
    zero_at_rad: float | None = None


def import_log(
    columns: Mapping[str, FloatArray],
    out: BagWriter,
    mapping: LogMapping,
    ask: Ask | None = None,
    progress: Progress = lambda _: None,
    raw: RawChannels | None = None,
) -> tuple[LogMapping, dict[str, str]]:
    """Write angle, and torque and speed if present, into a recording.

    Args:
        columns: of the log, a LogTable or float64 (n,) by name.
        out: the recording.
        mapping: columns, units and times as far as they are known.
        ask: asks a person if several columns may be meant; None: such a log is refused.
        progress: called with the number of rows written of each column.
        raw: a pickup and a force instead of angle and torque.

    Returns:
        The complete mapping, with which the next log of this kind needs no guess, and the choices made, in words.

    Raises:
        RecordingError: a column is ambiguous or its unit unknown.
    """
    table = columns if isinstance(columns, LogTable) else _table(columns)
    return _Import(table, out, mapping, ask, progress).run(raw)


class _Import:
    """Import of one log: its mapping so far, and the choices made, in words."""

    def __init__(
        self, table: LogTable, out: BagWriter, mapping: LogMapping, ask: Ask | None, progress: Progress
    ) -> None:
        self._table, self._out, self._mapping, self._ask, self._progress = table, out, mapping, ask, progress
        self._words: dict[str, str] = {}
        self._first: float | None = None

    def run(self, raw: RawChannels | None) -> tuple[LogMapping, dict[str, str]]:
        """Choose, convert and write the columns."""
        if raw is not None:
            clock = self._main_clock(Channel(raw.pickup))
            seconds, clock = self._seconds(clock, "time", True)
            stamps, here = self._stamps(seconds, clock, "time")
            _write_raw(self._table.rows(here), stamps, raw, self._out, self._words)
            return replace(self._mapping, clock=clock), self._words
        angle = choose_channel("angle", self._table, self._mapping, self._ask, needed=True)
        assert angle is not None
        self._mapping = replace(self._mapping, angle=angle)
        clock = self._main_clock(angle)
        seconds, clock = self._seconds(clock, "time")
        self._words["angle"] = ""  # in this order for people
        torque = choose_channel("torque", self._table, self._mapping, self._ask)
        self._mapping = replace(self._mapping, clock=clock, torque=torque or Channel(NO_COLUMN))
        self._write_angle(angle, seconds, clock)
        if torque is not None:
            self._write_torque(torque, clock)
        if self._mapping.second_angle.column != NO_COLUMN:
            self._write_second_angle(self._mapping.second_angle, clock)
        for output, channel in self._mapping.quantities.items():
            self._write_quantity(output, channel, clock)
        return self._mapping, self._words

    def _main_clock(self, channel: Channel) -> Clock:
        """Return the clock of the angle, or of the pickup."""
        refuse_unknown(channel.column, self._table)
        rate = self._mapping.clock.rate_hz
        if rate is None:
            return choose_clock(self._table, self._mapping, channel, self._ask, self._words)
        several = sorted(set(self._table.times_of.values()))
        if len(several) > 1:
            raise RecordingError(
                f"--rate: columns have times of their own, '{several[0]}' and others; leave --rate out"
            )
        return Clock(rate_hz=rate)

    def _seconds(self, clock: Clock, kind: str, raw: bool = False) -> tuple[FloatArray, Clock]:
        """Return seconds of every row (n,), NaN without a time, and the clock with units; note them under `kind`."""
        if clock.rate_hz is not None:
            rows = max(map(len, self._table.values()))
            self._words[kind] = f"{clock.rate_hz:g} rows a second"
            return np.arange(rows) / clock.rate_hz, clock
        seconds, clock, words = clock_seconds(self._table, clock, raw)
        self._words[kind] = f"column '{clock.column}', {words}{_empty(np.isfinite(seconds))}"
        return seconds, clock

    def _stamps(self, seconds: FloatArray, clock: Clock, kind: str) -> tuple[IntArray, BoolArray]:
        """Return stamps [ns] of the rows with a time, and their mask. Raises RecordingError for falling times."""
        here = np.isfinite(seconds)
        seconds = seconds[here]
        if self._first is None:
            self._first = float(seconds[0])
        first = _FIRST_NS if abs(self._first) < _EPOCH_S else round(self._first * 1e9)
        since_first = np.rint((seconds - self._first) * 1e9).astype(np.int64)
        steps = np.diff(since_first)
        if first + int(since_first.min()) <= 0 or np.count_nonzero(steps < 0) > np.count_nonzero(steps > 0):
            if clock.column != self._mapping.clock.column and self._mapping.clock.column and kind != "time":
                raise RecordingError(f"column '{clock.column}' begins before '{self._mapping.clock.column}'")
            at = int(np.argmax(steps < 0)) + 2
            raise RecordingError(
                f"column '{clock.column}' goes back, first at row {at}: sort the rows by time, or where they are evenly"
                " spaced give --rate; where it holds the time since the row before give --time-steps"
            )
        self._words[kind] += _amiss(steps)
        return np.asarray(first + since_first, dtype=np.int64), here

    def _with_stamps(
        self, values: FloatArray, seconds: FloatArray, clock: Clock, kind: str
    ) -> tuple[IntArray, BoolArray]:
        """Return stamps (m,) of the rows (n,) that have a time and a value, and the mask of these."""
        if values.size != seconds.size:
            raise RecordingError(
                f"{values.size} values, but {seconds.size} times in column '{clock.column}'; name the column of their"
                f" times: {_own_times_option(kind)}"
            )
        known = np.isfinite(values)
        if not known.any():
            raise RecordingError(f"the {kind} has no number in any row; name another column, or import without it")
        if not np.isfinite(seconds[known]).any():
            raise RecordingError(
                f"no row has both a time and a value of the {kind}; name the column of its times:"
                f" {_own_times_option(kind)}"
            )
        stamps, timed = self._stamps(np.where(known, seconds, np.nan), clock, "time" if kind == "angle" else kind)
        return stamps, timed & known

    def _write_angle(self, angle: Channel, seconds: FloatArray, clock: Clock) -> None:
        name = angle.column
        values = self._table[name]
        known = np.isfinite(values)
        converted, unit, words = angle_radians(name, angle.unit, values[known])
        theta = np.full(values.shape, np.nan)
        theta[known], counts = _own_readings(converted, unit)
        self._words["angle"] = f"column '{name}', {words}{counts}{self._without(name, known)}"
        stamps, here = self._with_stamps(theta, seconds, clock, "angle")
        speed, omega = self._speed(stamps, theta, here, clock)
        self._mapping = replace(self._mapping, angle=replace(angle, unit=unit), speed=speed)
        self._out.write_joint_states("main_shaft/angle", stamps, ["main_shaft"], theta[here], omega)
        self._progress(values.size)

    def _write_torque(self, torque: Channel, clock: Clock) -> None:
        name = torque.column
        values, unit, words = torque_newton_metres(name, torque.unit, self._table[name], torque.scale)
        self._words["torque"] = f"column '{name}', {words}{self._without(name, np.isfinite(values))}"
        stamps, here, torque = self._own_stamps(replace(torque, unit=unit), values, clock, "torque")
        self._out.write_wrenches("balancing_torque/measured", stamps, values[here])
        self._mapping = replace(self._mapping, torque=torque)
        self._progress(values.size)

    def _write_second_angle(self, channel: Channel, clock: Clock) -> None:
        """Write the angle of the second encoder, in the first one's unit unless another is given."""
        name = channel.column
        refuse_unknown(name, self._table)
        values = self._table[name].copy()
        known = np.isfinite(values)
        wished = spelled(channel.unit) or unit_in_name(name) or self._mapping.angle.unit
        converted, unit, words = angle_radians(name, wished, values[known])
        values[known], counts = _own_readings(converted, unit)
        self._words["second angle"] = f"column '{name}', {words}{counts}{self._without(name, known)}"
        stamps, here, channel = self._own_stamps(replace(channel, unit=unit), values, clock, "second angle")
        self._out.write_joint_states(SECOND_ANGLE_TOPIC, stamps, ["main_shaft"], values[here])
        self._mapping = replace(self._mapping, second_angle=channel)
        self._progress(values.size)

    def _write_quantity(self, output: str, channel: Channel, clock: Clock) -> None:
        name = channel.column
        refuse_unknown(name, self._table)
        unit = spelled(channel.unit) or unit_in_name(name)
        values, words = quantity_si(name, unit, self._table[name])
        self._words[output] = f"column '{name}', {words}{self._without(name, np.isfinite(values))}"
        stamps, here, channel = self._own_stamps(replace(channel, unit=unit), values, clock, output)
        self._out.write_joint_states(f"{MEASURED}/{output}", stamps, [output], values[here])
        self._mapping = replace(self._mapping, quantities={**self._mapping.quantities, output: channel})
        self._progress(values.size)

    def _own_stamps(
        self, channel: Channel, values: FloatArray, clock: Clock, kind: str
    ) -> tuple[IntArray, BoolArray, Channel]:
        """Return stamps of a channel beside the angle, at its own times if it has any."""
        own = own_clock(self._table, self._mapping, clock, self._mapping.angle, channel, kind)
        words = self._words.pop(kind)
        seconds, own = self._seconds(own, kind)
        at = f"; at {self._words[kind]}" if own != clock else ""
        self._words[kind] = words + at
        earlier = self._words[kind]
        stamps, here = self._with_stamps(values, seconds, own, kind)
        if own == clock:
            self._words[kind] = earlier  # its times are reported once
            return stamps, here, channel
        return stamps, here, replace(channel, clock=own)

    def _without(self, name: str, known: BoolArray) -> str:
        """Describe the rows without a number; in a log in long form they belong to other signals."""
        return "" if name in self._table.signals else _empty(known)

    def _speed(
        self, stamps: IntArray, theta: FloatArray, here: BoolArray, clock: Clock
    ) -> tuple[Channel, FloatArray | None]:
        """Find the column of the encoder's speed, with which the angle turns, and convert it to rad/s."""
        wished, table, none = self._mapping.speed, self._table, Channel(NO_COLUMN)
        if wished.column == NO_COLUMN and NO_COLUMN not in table:
            return none, None
        unit, names = spelled(wished.unit), [wished.column]
        if wished.column:
            refuse_unknown(wished.column, table)
        else:
            names = choose("speed", [each for each in table if each not in self._mapping.named], bool(unit))
        if unit and not names:
            raise RecordingError(
                f"--speed-unit, but which column is the speed? tell it with --speed: {describe(table)}"
            )
        fitting, amiss = [], []
        for name in names:
            found: EncoderSpeed | str = "its times are not those of the angle"
            if has_same_times(table, clock, self._mapping.angle.column, name):
                values = table[name][here]
                found = encoder_speed(name, unit or unit_in_name(name), values, stamps, theta[here])
            if isinstance(found, str):
                amiss.append(f"column '{name}'{'' if wished.column else ' left out'}: {found}")
            else:
                fitting.append(found)
        if not fitting:
            if amiss and (wished.column or unit):
                raise RecordingError(amiss[0])
            if amiss:
                self._words["speed"] = "; ".join(amiss)
            return none, None
        best = min(fitting, key=lambda each: each.error)
        if len(fitting) > 1 and best.error == math.inf:
            self._words["speed"] = "left out: no column is seen to be that of the angle; tell it with --speed"
            return none, None
        others = [f"'{name}'" for name in names if name != best.column]
        not_used = f"; not used: {', '.join(others)}" if others else ""
        self._words["speed"] = f"column '{best.column}', {best.unit}{not_used}"
        return Channel(best.column, best.unit), best.omega


def _write_raw(table: LogTable, stamps: IntArray, raw: RawChannels, out: BagWriter, taken: dict[str, str]) -> None:
    """Write edges of the wheel, and the torque with which the force drives the shaft."""
    for name in filter(None, (raw.pickup, raw.force)):
        refuse_unknown(name, table)
    since = (stamps - stamps[0]) * 1e-9
    edges = stamps[0] + np.rint(tooth_edges(since, table[raw.pickup]) * 1e9).astype(np.int64)
    out.write_events("main_shaft/angle", edges)
    taken["angle"] = f"column '{raw.pickup}', {edges.size} edges of a toothed wheel"
    if raw.force:
        known = edge_angles(raw.machine, edges)
        force = table[raw.force] * raw.newton
        at, torque = force_torque(raw.machine, raw.measure, known, stamps, force, raw.zero_at_rad)
        out.write_wrenches("balancing_torque/measured", at, torque)
        taken["torque"] = f"column '{raw.force}', {raw.newton:g} N per unit along {raw.measure}"


def _own_times_option(kind: str) -> str:
    """Describe how to name the column of the times of a channel."""
    if kind == "angle":
        return "--time COLUMN"
    return "--torque-time COLUMN" if kind == "torque" else f"`time: {{column: NAME}}` of '{kind}' in the --mapping file"


def _empty(here: BoolArray) -> str:
    """Describe the number of rows (n,) without a number; empty if all have one."""
    without = np.flatnonzero(~here)
    return f"; {without.size} rows without a number are not used, first row {without[0] + 1}" if without.size else ""


def _table(columns: Mapping[str, FloatArray]) -> LogTable:
    table = LogTable()
    table.update(columns)
    return table


def _amiss(steps: IntArray) -> str:
    """Describe times that repeat or fall from row to row; empty if they rise."""
    back, stands = np.flatnonzero(steps < 0), int(np.count_nonzero(steps == 0))
    text = f"; goes back at {back.size} rows, first at row {back[0] + 2}" if back.size else ""
    text += f"; {stands} rows have the time of the row before" if stands else ""
    what = "such rows are in the recording, and are left out where it is used"
    return f"{text}: {what}; where rows are evenly spaced give --rate" if text else ""


def _own_readings(angle: FloatArray, unit: str) -> tuple[FloatArray, str]:
    """Recover the encoder's readings from angles (n,) [rad] rounded in the log, and describe its counts."""
    lattice = count_lattice(np.unwrap(angle), ANGLE_TURNS[unit]) if unit in ANGLE_TURNS else None
    if lattice is None:
        return angle, ""
    return lattice.restored(angle), f", rounded readings of an encoder of {lattice.counts} counts a turn: restored"
