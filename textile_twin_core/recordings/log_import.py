"""A log becomes a recording: columns chosen, converted to SI and written as messages with their stamps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Machine
from textile_twin_core.recordings.bag_write import BagWriter
from textile_twin_core.recordings.log_cells import LogTable
from textile_twin_core.recordings.log_columns import (
    SPEED_UNITS,
    Column,
    angle_radians,
    choose,
    describe,
    looks_like_time,
    quantity_si,
    spelled,
    times_as_fast,
    torque_newton_metres,
    unit_in_name,
)
from textile_twin_core.recordings.log_makers import UNTIMED
from textile_twin_core.recordings.log_shaft import edge_angles, force_torque, tooth_edges
from textile_twin_core.recordings.log_time import DATED, TIME_UNITS, counts_rows, same_clock, time_seconds
from textile_twin_core.recordings.recording import Progress

_FIRST_NS = 1_000_000_000
"""Stamp of the first row of a log whose time is none of the day: 0 means in ROS that there is no stamp."""
_EPOCH_S = 1e8
_NOT_ITS_SPEED = 0.1
"""Relative difference from which a speed is that of another shaft, or counts the other way."""
MEASURED = "measured"
"""Above the topics of quantities other than torque: JointState, position of the joint named as the output."""
Ask = Callable[[str, list[str]], str]
"""Asks a person which of several columns is meant: (kind, names) -> name."""


@dataclass(frozen=True)
class RawChannels:
    """Voltage of a pickup on a toothed wheel, and a force on a point of the machine.

    machine: says how many teeth the wheel has, and how the point moves. pickup: its column. measure, force: the
    displacement along which the force acts, and its column; empty without a force. newton: per unit of that column.
    zero_at_rad: see `force_torque`.
    """

    machine: Machine
    pickup: str
    measure: str = ""
    force: str = ""
    newton: float = 1.0
    zero_at_rad: float | None = None


@dataclass(frozen=True)
class Wishes:
    """What the user tells of a log; what is empty is found out.

    columns, units: by kind (time, angle, torque, speed). rate_hz: rows a second, for a log without times.
    torque_scale: N m per unit of the torque column. quantities: columns by the output that they are measurements of.
    raw: a pickup and a force instead of angle and torque.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    rate_hz: float | None = None
    torque_scale: float | None = None
    quantities: Mapping[str, str] = field(default_factory=dict)
    raw: RawChannels | None = None


def import_log(
    columns: Mapping[str, FloatArray],
    out: BagWriter,
    wishes: Wishes,
    ask: Ask | None = None,
    progress: Progress = lambda _: None,
) -> dict[str, str]:
    """Write angle, and torque and speed where there are any, into a recording; what was taken for what, in words.

    `progress` is called with the number of rows as those of a column are written.

    Raises RecordingError when a column cannot be told or its unit is not known.
    """
    taken: dict[str, str] = {}
    columns = columns if isinstance(columns, LogTable) else _log(columns)
    stamps, columns = _stamps(columns, wishes, ask, taken)
    if wishes.raw is not None:
        _write_raw(columns, stamps, wishes.raw, out, taken)
        return taken
    angle = _column("angle", columns, wishes, ask, needed=True)
    assert angle is not None
    theta, unit = angle_radians(angle, columns[angle.name])
    taken["angle"] = f"column '{angle.name}', {unit}"
    omega = _speed(columns, stamps, theta, wishes, taken)
    here = np.isfinite(theta)
    taken["angle"] += _empty(here)
    out.write_joint_states(
        "main_shaft/angle", stamps[here], ["main_shaft"], theta[here], None if omega is None else omega[here]
    )
    progress(here.size)
    torque = _column("torque", columns, wishes, ask, needed=False)
    if torque is not None:
        values, unit = torque_newton_metres(torque, columns[torque.name], wishes.torque_scale)
        here = np.isfinite(values)
        out.write_wrenches("balancing_torque/measured", stamps[here], values[here])
        progress(here.size)
        taken["torque"] = f"column '{torque.name}', {unit}{_empty(here)}"
    for output, name in wishes.quantities.items():
        _refuse_unknown(name, columns)
        unit = spelled(wishes.units.get("quantity", "")) or unit_in_name(name)
        values, unit = quantity_si(Column(name, unit), columns[name])
        here = np.isfinite(values)
        out.write_joint_states(f"{MEASURED}/{output}", stamps[here], [output], values[here])
        progress(here.size)
        taken[output] = f"column '{name}', {unit}{_empty(here)}"
    return taken


def _speed(
    columns: LogTable, stamps: IntArray, theta: FloatArray, wishes: Wishes, taken: dict[str, str]
) -> FloatArray | None:
    """The encoder's speed [rad/s] where a column holds it; a column that holds another is left out, in words."""
    column = _column("speed", columns, wishes, None, needed=False)
    if column is None:
        return None
    omega, amiss = None, ""
    if column.unit not in SPEED_UNITS:
        what = f"speed in '{column.unit}'?" if column.unit else "its name has no unit;"
        amiss = f"{what} tell --speed-unit: {', '.join(SPEED_UNITS)}"
    else:
        omega = columns[column.name] * SPEED_UNITS[column.unit]
        times = times_as_fast(stamps, theta, omega)
        if abs(times - 1.0) > _NOT_ITS_SPEED:
            amiss = f"the angle turns {times:.3g} times as fast: no speed of this encoder"
    if amiss and "speed" in {**wishes.columns, **wishes.units}:
        raise RecordingError(f"column '{column.name}': {amiss}")
    taken["speed"] = f"column '{column.name}' left out: {amiss}" if amiss else f"column '{column.name}', {column.unit}"
    return None if amiss else omega


def _write_raw(columns: LogTable, stamps: IntArray, raw: RawChannels, out: BagWriter, taken: dict[str, str]) -> None:
    """Edges of the wheel, and the torque with which the force drives the shaft."""
    for name in filter(None, (raw.pickup, raw.force)):
        _refuse_unknown(name, columns)
    since = (stamps - stamps[0]) * 1e-9
    edges = stamps[0] + np.rint(tooth_edges(since, columns[raw.pickup]) * 1e9).astype(np.int64)
    out.write_events("main_shaft/angle", edges)
    taken["angle"] = f"column '{raw.pickup}', {edges.size} edges of a toothed wheel"
    if raw.force:
        known = edge_angles(raw.machine, edges)
        force = columns[raw.force] * raw.newton
        at, torque = force_torque(raw.machine, raw.measure, known, stamps, force, raw.zero_at_rad)
        out.write_wrenches("balancing_torque/measured", at, torque)
        taken["torque"] = f"column '{raw.force}', {raw.newton:g} N per unit along {raw.measure}"


def _stamps(columns: LogTable, wishes: Wishes, ask: Ask | None, taken: dict[str, str]) -> tuple[IntArray, LogTable]:
    """Stamp of each row [ns], and the columns without the rows that have no time."""
    rows = len(next(iter(columns.values())))
    several = sorted(set(columns.times_of.values()))
    if wishes.rate_hz is not None and len(several) > 1:
        raise RecordingError(
            f"--rate: columns have times of their own, '{several[0]}' and others; name one with --time"
        )
    if wishes.rate_hz is not None:
        taken["time"] = f"{wishes.rate_hz:g} rows a second"
        return np.asarray(_FIRST_NS + np.rint(np.arange(rows) * (1e9 / wishes.rate_hz)), dtype=np.int64), columns
    column = _finer_clock(columns, wishes, taken) or _column("time", columns, wishes, ask, needed=False)
    if column is None:
        column = _rising(columns, wishes)
    given, columns = columns, columns.at_times(column.name)
    apart = [name for name in given if name in columns.left_out]
    if apart:
        taken["note"] = (
            f"{len(apart)} columns are left out, first '{apart[0]}', which holds {columns.left_out[apart[0]]}; export"
            " all channels with one sample time to use them"
        )
    unit = DATED if column.name in columns.dated else column.unit
    seconds, words = time_seconds(column.name, unit, columns[column.name], wishes.raw is not None)
    taken["time"] = f"column '{column.name}', {words}"
    here = np.isfinite(seconds)
    if not here.all():
        taken["time"] += _empty(here)
        seconds, columns = seconds[here], columns.rows(here)
    first = _FIRST_NS if abs(float(seconds[0])) < _EPOCH_S else round(float(seconds[0]) * 1e9)
    since_first = np.rint((seconds - seconds[0]) * 1e9).astype(np.int64)
    steps = np.diff(since_first)
    if first + int(since_first.min()) <= 0 or np.count_nonzero(steps < 0) > np.count_nonzero(steps > 0):
        at = int(np.argmax(steps < 0)) + 2
        raise RecordingError(
            f"column '{column.name}' goes back, first at row {at}: sort the rows by time, or where"
            " they are evenly spaced give --rate"
        )
    taken["time"] += _amiss(steps)
    return np.asarray(first + since_first, dtype=np.int64), columns


def _finer_clock(columns: LogTable, wishes: Wishes, taken: dict[str, str]) -> Column | None:
    """Of one column of dates beside one of times with a unit, which go on alike, that with more moments; else None."""
    if "time" in {**wishes.columns, **wishes.units}:
        return None
    found = choose("time", [name for name in columns if name not in wishes.columns.values()])
    dated = [name for name in found if name in columns.dated]
    timers = [name for name in found if name not in columns.dated and unit_in_name(name) in TIME_UNITS]
    if len(found) != 2 or len(dated) != 1 or len(timers) != 1:
        return None
    (date,), (timer,) = dated, timers
    unit = unit_in_name(timer)
    if not same_clock(columns[date], columns[timer] * TIME_UNITS[unit]):
        return None
    if np.unique(columns[date]).size >= np.unique(columns[timer]).size:
        taken["clock"] = f"column '{timer}' goes on as '{date}' and is not used"
        return Column(date, DATED)
    taken["clock"] = f"column '{date}' goes on as '{timer}', in larger steps, and is not used"
    return Column(timer, unit)


def _rising(columns: LogTable, wishes: Wishes) -> Column:
    """The one column of dates, or that rises evenly and is nothing else, where no name speaks of time."""
    others = {*wishes.columns.values(), *wishes.quantities.values()}
    others |= {name for kind in ("angle", "torque", "speed") for name in choose(kind, columns)}
    dated = [name for name in columns if name in columns.dated]
    if len(dated) == 1:
        return Column(dated[0], DATED)
    rising = [name for name, values in columns.items() if name not in others and looks_like_time(values)]
    left_out = [name for name in choose("time", columns.left_out) if name not in columns]
    if left_out and columns.left_out[left_out[0]] == UNTIMED:
        raise RecordingError(f"column '{left_out[0]}' holds {UNTIMED}; give --rate HZ")
    if left_out:
        raise RecordingError(
            f"column '{left_out[0]}' holds {columns.left_out[left_out[0]]}, no times; write dates as"
            " 2026-10-25 23:59:50.5 or give --rate"
        )
    if len(rising) != 1:
        without = "".join(f"; '{name}' holds {what}" for name, what in columns.left_out.items())
        raise RecordingError(f"no column of times; give --time or --rate. Columns: {describe(columns)}{without}")
    (name,) = rising
    if not unit_in_name(name) and counts_rows(name, columns[name]):
        raise RecordingError(
            f"no column of times: '{name}' seems to count the rows; give --rate HZ, or --time '{name}' with --time-unit"
        )
    return Column(name, unit_in_name(name))


def _empty(here: BoolArray) -> str:
    """How many rows (n,) of a column have no number, in words; empty when all have."""
    without = np.flatnonzero(~here)
    return f"; {without.size} rows without a number are not used, first row {without[0] + 1}" if without.size else ""


def _log(columns: Mapping[str, FloatArray]) -> LogTable:
    log = LogTable()
    log.update(columns)
    return log


def _refuse_unknown(name: str, columns: LogTable) -> None:
    """Raises RecordingError for a column that is not there, or holds no numbers."""
    if name in columns.left_out:
        raise RecordingError(
            f"column '{name}' holds {columns.left_out[name]}, no numbers of use; there are: {describe(columns)}"
        )
    if name not in columns:
        raise RecordingError(f"no column '{name}'; there are: {describe(columns)}")


def _amiss(steps: IntArray) -> str:
    """What is wrong with times that stand or go back from row to row, in words; empty when they rise."""
    back, stands = np.flatnonzero(steps < 0), int(np.count_nonzero(steps == 0))
    told = f"; goes back at {back.size} rows, first at row {back[0] + 2}" if back.size else ""
    told += f"; {stands} rows have the time of the row before" if stands else ""
    what = "such rows are in the recording, and are left out where it is used"
    return f"{told}: {what}; where rows are evenly spaced give --rate" if told else ""


def _column(kind: str, columns: LogTable, wishes: Wishes, ask: Ask | None, needed: bool) -> Column | None:
    """The column of a kind: as told, the only one whose name speaks of it, or as a person answers."""
    unit = spelled(wishes.units.get(kind, ""))
    name = wishes.columns.get(kind, "")
    if name:
        _refuse_unknown(name, columns)
        return Column(name, unit or unit_in_name(name))
    others = set(wishes.columns.values())
    told = bool(unit) or (kind == "torque" and wishes.torque_scale is not None)
    found = choose(kind, [each for each in columns if each not in others], told)
    if len(found) != 1 and ask is not None and (found or needed):
        answer = ask(kind, found or list(columns))
        found = [answer] if answer else []
    if len(found) == 1:
        return Column(found[0], unit or unit_in_name(found[0]))
    if unit and not found:
        raise RecordingError(
            f"--{kind}-unit, but which column is the {kind}? tell it with --{kind}: {describe(columns)}"
        )
    held = choose(kind, columns.left_out) if needed and not found else []
    if held:
        _refuse_unknown(held[0], columns)
    if found or needed:
        raise RecordingError(f"which column is the {kind}? tell it with --{kind}. Columns: {describe(columns)}")
    return None
