"""How to read a log: columns, units and clocks. Partly given by the user, completed by `guess`, stored in a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from textile_twin_core.errors import RecordingError
from textile_twin_core.files.atomic import staged
from textile_twin_core.files.strict_yaml import read_yaml
from textile_twin_core.recordings.rosbag2_metadata import dump

NO_COLUMN = "none"
"""Name that a user gives for a column that the log does not have."""


@dataclass(frozen=True)
class Clock:
    """Times of the rows: a column and its unit, or an even rate.

    fraction, fraction_unit: column of the parts of a second beside one of whole seconds. steps: true if the column is
    the time since the row before. rate_hz: rows a second, instead of a column. wraps_at: range of a counter that passes
    its end, in the column's unit.
    """

    column: str = ""
    unit: str = ""
    fraction: str = ""
    fraction_unit: str = ""
    steps: bool = False
    rate_hz: float | None = None
    wraps_at: float | None = None


@dataclass(frozen=True)
class Channel:
    """A measured quantity: its column and unit.

    scale: SI units per unit instead. wraps_at: range of a counter that passes its end, in the column's unit; a turn or
    several need no mention. clock: times of its own.
    """

    column: str = ""
    unit: str = ""
    scale: float | None = None
    wraps_at: float | None = None
    clock: Clock | None = None


@dataclass(frozen=True)
class TextTable:
    """Form of a text table. Lines count from 1; names_line, units_line: 0 if the file has no such line.

    separator: `labels` for rows that label each value. day_first: for dates such as 03/04/2026; None if the cells show
    it. thousands: sign between groups of three digits.
    """

    separator: str
    decimal: str = "."
    encoding: str = "utf-8"
    names_line: int = 0
    units_line: int = 0
    first_line: int = 1
    day_first: bool | None = None
    thousands: str = ""


@dataclass(frozen=True)
class LongForm:
    """A log with a row for each value: the column that names the signal, and the column of its value."""

    signal: str
    value: str


@dataclass(frozen=True)
class OtherLogger:
    """Log of a second logger with the torque, on a clock of its own.

    Its time + offset_s + drift * (its time since its first row) is the time of the angle; None to estimate the offset.

    shared: column of a speed (or of an angle, where its unit is one) that the first log measures, too. torque, clock,
    text: as in `LogMapping`.
    """

    clock: Clock = Clock()
    torque: Channel = Channel()
    shared: Channel = Channel()
    text: TextTable | None = None
    offset_s: float | None = None
    drift: float = 0.0


@dataclass(frozen=True)
class LogMapping:
    """Columns, units and time base of a log; empty fields are detected from the log."""

    clock: Clock = Clock()
    angle: Channel = Channel()
    torque: Channel = Channel()
    speed: Channel = Channel()
    second_angle: Channel = Channel(NO_COLUMN)
    quantities: Mapping[str, Channel] = field(default_factory=dict)
    text: TextTable | None = None
    signals: LongForm | None = None
    torque_log: OtherLogger | None = None

    @property
    def named(self) -> set[str]:
        """All columns that the mapping names."""
        channels = [self.angle, self.torque, self.speed, self.second_angle, *self.quantities.values()]
        clocks = [self.clock, *(each.clock for each in channels if each.clock)]
        names = {each.column for each in channels}
        names |= {name for clock in clocks for name in (clock.column, clock.fraction)}
        return names - {"", NO_COLUMN}


_HEAD = """\
# How textile-twin import read {log}: columns, units, time base. Correct what is wrong, then give it back:
#   textile-twin import {log} --out BAG --mapping {file}
# The next log of the same logger is read with it, too; nothing is guessed then.
"""
_CHANNELS = ("angle", "torque", "speed")
_KEYS = {
    "text": TextTable,
    "signals": LongForm,
    "time": Clock,
    **dict.fromkeys((*_CHANNELS, "second_angle", "shared"), Channel),
    "torque_log": OtherLogger,
}


def mapping_path(out: Path) -> Path:
    """Path of the mapping of a recording, beside it."""
    return out.with_name(f"{out.name}.mapping.yaml")


def write_mapping(path: Path, mapping: LogMapping, log: str) -> None:
    """Write a mapping with a head that says what to do with it, without the offset of two clocks of this pair."""
    content: dict[str, Any] = {}
    if mapping.text is not None:
        content["text"] = _plain(mapping.text)
    if mapping.signals is not None:
        content["signals"] = _plain(mapping.signals)
    content["time"] = _plain(mapping.clock)
    content |= {kind: _channel(getattr(mapping, kind)) for kind in _CHANNELS}
    if mapping.second_angle.column != NO_COLUMN:
        content["second_angle"] = _channel(mapping.second_angle)
    if mapping.quantities:
        content["quantities"] = {name: _channel(each) for name, each in mapping.quantities.items()}
    other = mapping.torque_log
    if other is not None:
        form = {} if other.text is None else {"text": _plain(other.text)}
        channels = {"torque": _channel(other.torque), "shared": _channel(other.shared)}
        content["torque_log"] = {**form, "time": _plain(other.clock), **channels}
    with staged(path) as partial:
        partial.write_text(_HEAD.format(log=log, file=path.name) + dump(content), encoding="utf-8")


def read_mapping(path: Path) -> LogMapping:
    """Read a mapping. Raises RecordingError for a file that is missing, no YAML, or has an unknown key."""
    content = read_yaml(path, RecordingError)
    quantities = content.get("quantities") or {} if isinstance(content, dict) else {}
    if not isinstance(quantities, dict):
        raise RecordingError(f"{path}: quantities: write OUTPUT: {{column: NAME, unit: UNIT}}")
    read = {str(name): _read(path, str(name), Channel, each) for name, each in quantities.items()}
    content = {key: value for key, value in content.items() if key != "quantities"} if quantities else content
    mapping: LogMapping = _read(path, "", LogMapping, content)
    return replace(mapping, quantities=read)


def _plain(what: Any) -> dict[str, Any]:
    """Non-empty fields."""
    return {key: value for key, value in asdict(what).items() if value not in ("", None, False) and key != "clock"}


def _channel(channel: Channel) -> dict[str, Any] | None:
    """Fields of a channel; None for one that the log does not have."""
    if channel.column in ("", NO_COLUMN):
        return None
    return _plain(channel) | ({"time": _plain(channel.clock)} if channel.clock else {})


def _read(path: Path, place: str, kind: type[Any], content: Any) -> Any:
    """Make an instance of a class from a mapping of its fields, each of the type of its default."""
    if content is None and kind is Channel:
        return Channel(NO_COLUMN)
    where = f"{path}: {place}: " if place else f"{path}: "
    names = {("time" if each.name == "clock" else each.name): each for each in fields(kind)}
    known = ", ".join(sorted(names))
    if not isinstance(content, dict):
        raise RecordingError(f"{where}no keys and values; keys are {known}")
    unknown = [str(key) for key in content if key not in names]
    if unknown:
        raise RecordingError(f"{where}unknown key '{unknown[0]}'; keys are {known}")
    values: dict[str, Any] = {}
    for key, value in content.items():
        inner = f"{place}.{key}" if place else key
        if key in _KEYS:
            values[names[key].name] = None if value is None and key == "text" else _read(path, inner, _KEYS[key], value)
        elif not _fits(value, str(names[key].type)):
            raise RecordingError(f"{path}: {inner}: '{value}' is no {str(names[key].type).partition(' ')[0]}")
        else:  # counts of a turn are a number, and a column may be called 1
            values[key] = str(value) if names[key].type == "str" else value
    try:
        return kind(**values)
    except TypeError:
        needed = ", ".join(each.name for each in fields(kind) if each.name not in values)
        raise RecordingError(f"{where}incomplete, it needs {needed}") from None


def _fits(value: object, wanted: str) -> bool:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if value is None:
        return "None" in wanted
    if wanted.startswith("bool"):
        return isinstance(value, bool)
    if wanted == "int":
        return isinstance(value, int) and number and value >= 0
    return isinstance(value, (str, int, float)) if wanted == "str" else number
