"""Columns, units and time base of a log: partly given by the user, complete after an import, stored in a file."""

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
    the time since the row before. rate_hz: rows a second, instead of a column.
    """

    column: str = ""
    unit: str = ""
    fraction: str = ""
    fraction_unit: str = ""
    steps: bool = False
    rate_hz: float | None = None


@dataclass(frozen=True)
class Channel:
    """A measured quantity: its column and unit. scale: SI units per unit instead. clock: times of its own."""

    column: str = ""
    unit: str = ""
    scale: float | None = None
    clock: Clock | None = None


@dataclass(frozen=True)
class TextTable:
    """Form of a text table. Lines count from 1; names_line, units_line: 0 if the file has no such line.

    day_first: for dates such as 03/04/2026; None if the cells show it.
    """

    separator: str
    decimal: str
    encoding: str = "utf-8"
    names_line: int = 0
    units_line: int = 0
    first_line: int = 1
    day_first: bool | None = None


@dataclass(frozen=True)
class LongForm:
    """A log with a row for each value: the column that names the signal, and the column of its value."""

    signal: str
    value: str


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

    @property
    def named(self) -> set[str]:
        """All columns that the mapping names."""
        clocks = [self.clock, *(each.clock for each in self.channels if each.clock)]
        names = {each.column for each in self.channels}
        names |= {name for clock in clocks for name in (clock.column, clock.fraction)}
        return names - {"", NO_COLUMN}

    @property
    def channels(self) -> list[Channel]:
        """Angle, torque, speed, the second encoder's angle and the other quantities."""
        return [self.angle, self.torque, self.speed, self.second_angle, *self.quantities.values()]


_HEAD = """\
# How textile-twin import read {log}: columns, units, time base. Correct what is wrong, then give it back:
#   textile-twin import {log} --out BAG --mapping {file}
# The next log of the same logger is read with it, too; nothing is guessed then.
"""
_CHANNELS = ("angle", "torque", "speed")
_SECOND = "second_angle"


def mapping_path(out: Path) -> Path:
    """Path of the mapping of a recording, beside it."""
    return out.with_name(f"{out.name}.mapping.yaml")


def write_mapping(path: Path, mapping: LogMapping, log: str) -> None:
    """Write a mapping as YAML. Raises OutputError."""
    content: dict[str, Any] = {}
    if mapping.text is not None:
        content["text"] = _plain(mapping.text)
    if mapping.signals is not None:
        content["signals"] = _plain(mapping.signals)
    content["time"] = _plain(mapping.clock)
    for kind in _CHANNELS:
        content[kind] = _channel(getattr(mapping, kind))
    if mapping.second_angle.column != NO_COLUMN:
        content[_SECOND] = _channel(mapping.second_angle)
    if mapping.quantities:
        content["quantities"] = {name: _channel(each) for name, each in mapping.quantities.items()}
    with staged(path) as partial:
        partial.write_text(_HEAD.format(log=log, file=path.name) + dump(content), encoding="utf-8")


def read_mapping(path: Path) -> LogMapping:
    """Read a mapping. Raises RecordingError for a file that is missing, no YAML, or has an unknown key."""
    content = read_yaml(path, RecordingError)
    known = {"text", "signals", "time", *_CHANNELS, _SECOND, "quantities"}
    _check(path, "", content, known)
    quantities = content.get("quantities") or {}
    if not isinstance(quantities, dict):
        raise RecordingError(f"{path}: quantities: write OUTPUT: {{column: NAME, unit: UNIT}}")
    text, signals = content.get("text"), content.get("signals")
    return LogMapping(
        _made(path, "time", Clock, content.get("time") or {}),
        **{kind: _read_channel(path, kind, content.get(kind, {})) for kind in _CHANNELS},
        second_angle=_read_channel(path, _SECOND, content.get(_SECOND)),
        quantities={str(name): _read_channel(path, str(name), each) for name, each in quantities.items()},
        text=None if text is None else _made(path, "text", TextTable, text),
        signals=None if signals is None else _made(path, "signals", LongForm, signals),
    )


def _plain(what: Any) -> dict[str, Any]:
    """Non-empty fields."""
    return {key: value for key, value in asdict(what).items() if value not in ("", None, False) and key != "clock"}


def _channel(channel: Channel) -> dict[str, Any] | None:
    """Fields of a channel; None for one that the log does not have."""
    if channel.column in ("", NO_COLUMN):
        return None
    return _plain(channel) | ({"time": _plain(channel.clock)} if channel.clock else {})


def _read_channel(path: Path, kind: str, content: Any) -> Channel:
    if content is None:
        return Channel(NO_COLUMN)
    own = content.get("time") if isinstance(content, dict) else None
    content = {key: value for key, value in content.items() if key != "time"} if own is not None else content
    channel: Channel = _made(path, kind, Channel, content, without="clock")
    return replace(channel, clock=_made(path, f"{kind}.time", Clock, own)) if own is not None else channel


def _made(path: Path, place: str, kind: type[Any], content: Any, without: str = "") -> Any:
    """Make an instance of a class from a mapping of its fields, each of the type of its default."""
    _check(path, place, content, {each.name for each in fields(kind)} - {without})
    values = {}
    for each in fields(kind):
        if each.name not in content:
            continue
        value = content[each.name]
        wanted = str(each.type)
        if wanted == "str":
            value = str(value)  # counts of a turn are a number, and a column may be called 1
        good = {
            "str": isinstance(value, str),
            "bool": isinstance(value, bool),
            "bool | None": value is None or isinstance(value, bool),
            "int": isinstance(value, int) and not isinstance(value, bool) and value >= 0,
        }.get(wanted, value is None or (isinstance(value, (int, float)) and not isinstance(value, bool)))
        if not good:
            raise RecordingError(f"{path}: {place}.{each.name}: '{value}' is no {wanted.partition(' ')[0]}")
        values[each.name] = value
    try:
        return kind(**values)
    except TypeError:
        needed = ", ".join(each.name for each in fields(kind) if each.name not in values)
        raise RecordingError(f"{path}: {place}: incomplete, it needs {needed}") from None


def _check(path: Path, place: str, content: Any, known: set[str]) -> None:
    """Raise RecordingError unless the content is a mapping with known keys only."""
    where = f"{path}: {place}: " if place else f"{path}: "
    if not isinstance(content, dict):
        raise RecordingError(f"{where}no keys and values; keys are {', '.join(sorted(known))}")
    unknown = [str(key) for key in content if key not in known]
    if unknown:
        raise RecordingError(f"{where}unknown key '{unknown[0]}'; keys are {', '.join(sorted(known))}")
