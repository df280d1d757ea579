"""Heads of text logs of known makers: TwinCAT Scope, LabVIEW Measurement, SIMATIC panels."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from textile_twin_core.errors import RecordingError

TIMES = ("Time [ms]", "Time [s]")
"""Names for columns of times without a name, or named X_Value, in the log; a second one gets a number."""
FILETIME = "Time [100 ns since 1601]"
"""The same for TwinCAT Scope's full time stamps."""
UNTIMED = "no times, and the file's head has no Delta_X, the time from row to row"
"""Reason for an empty column of times in a LabVIEW file without this key."""
_END_OF_HEAD = "***End_of_Header***"
_SEPARATOR = re.compile(r"Separator[\t,]\s*(\w+)")
_SEPARATORS = {"tab": "\t", "comma": ","}
_NUMBER = re.compile(r"[+-]?[\d.,]*\d[\d.,]*([eE][+-]?\d+)?")
"""A number with either decimal sign."""
_LONGEST_HEAD = 60
"""Lines that are searched for a head."""
_FULL = 1e17
"""Ticks of 100 ns since 1601, up to the year 1917, which no export reaches in milliseconds."""


@dataclass(frozen=True)
class KnownHead:
    """Description of the rows by the head above them.

    names: of the columns, with their units. skipped: lines before the first row. separator, decimal: of the rows.
    interval_s: from row to row, if the rows have no times; NaN if the head does not state it either.
    """

    names: tuple[str, ...]
    skipped: int
    separator: str
    decimal: str
    interval_s: float | None = None


def known_head(path: str, lines: Sequence[str], decimal: str | None) -> KnownHead | None:
    """Read the head of a log of a known maker; None for any other log.

    Args:
        path: of the log, for messages. lines: its beginning. decimal: configured, if the head does not state it.

    Raises RecordingError for a log with a row for each value, which is no table.
    """
    if lines and lines[0].replace('"', "").startswith("VarName;TimeString;VarValue"):
        raise RecordingError(
            f"{path}: a panel's log with a row for each value; bring it into a table, a row for each time and a column"
            " for each tag, or record with the controller's trace instead"
        )
    return _labview(lines) or _twincat(lines, decimal)


def _labview(lines: Sequence[str]) -> KnownHead | None:
    """Read a LabVIEW Measurement file (.lvm): up to two heads of keys, then a line of names."""
    end = _end_of_labview_heads(lines)
    if end is None or end + 1 >= len(lines):
        return None
    separator_line = next((found for found in map(_SEPARATOR.match, lines[:end]) if found), None)
    separator = _SEPARATORS.get(separator_line[1].lower(), "\t") if separator_line else "\t"
    cells = [line.split("\t" if "\t" in line else separator) for line in lines[:end]]
    keys = {row[0].strip(): row[1].strip() for row in cells if len(row) > 1}
    names = [name.strip().strip('"') for name in lines[end + 1].rstrip("\r\n").split(separator)]
    names = [TIMES[1] if name == "X_Value" else name for name in names if name != "Comment"]
    decimal = "," if keys.get("Decimal_Separator", ".") == "," else "."
    interval = None
    if keys.get("X_Columns", "One") == "No":
        interval = _number(keys.get("Delta_X", ""), decimal, math.nan)
    return KnownHead(tuple(names), end + 2, separator, decimal, interval)


def _end_of_labview_heads(lines: Sequence[str]) -> int | None:
    """Find the last line of the file's head, or of its first segment's head if it has one; None without any."""
    end = None
    for k, line in enumerate(lines[:_LONGEST_HEAD]):
        if line.startswith(_END_OF_HEAD):
            if end is not None:
                return k
            end = k
        first = next((cell.strip() for cell in re.split("[\t,]", line) if cell.strip()), "")
        if end is not None and _NUMBER.fullmatch(first):
            break
    return end


def _twincat(lines: Sequence[str], decimal: str | None) -> KnownHead | None:
    """Read a text export of TwinCAT Scope: a line for each property of the channels, labelled above the columns of
    times.
    """
    for separator in ("\t", ";", ","):
        rows = [[cell.strip() for cell in line.split(separator)] for line in lines[:_LONGEST_HEAD]]
        labels = {row[0]: k for k, row in enumerate(rows) if row}
        if "Name" not in labels:
            continue
        named, last = rows[labels["Name"]], max(k for label, k in labels.items() if _is_label(label))
        started = next((k for label, k in labels.items() if label.lower().startswith("starttime")), labels["Name"])
        # Newer exports have fewer lines: the start and the names, or names alone, once for each column of times.
        if "SampleTime[ms]" not in labels and started >= labels["Name"] and named.count("Name") < 2:
            continue
        first = next((k for k in range(last + 1, len(rows)) if any(rows[k])), None)
        if first is None:
            return None
        commas = separator != "," and any("," in cell for row in rows[first:] for cell in row)
        point = decimal or ("," if commas else ".")
        full = _number(rows[first][0], point) > _FULL
        units = rows[labels["Unit"]] if "Unit" in labels else []
        names = [
            (FILETIME if full else TIMES[0]) if name == "Name" else _with_unit(name, units[k] if k < len(units) else "")
            for k, name in enumerate(named)
        ]
        return KnownHead(tuple(names), first, separator, point)
    return None


def _is_label(text: str) -> bool:
    return bool(text) and not _NUMBER.fullmatch(text) and text != "EOF"


def _number(text: str, decimal: str, otherwise: float = 0.0) -> float:
    try:
        return float(text.replace(decimal, "."))
    except ValueError:
        return otherwise


def _with_unit(name: str, unit: str) -> str:
    """Name of a channel with its unit, from `deg (Angle)`."""
    plain = unit.partition(" (")[0]
    return name if plain in ("", "(None)") else f"{name} [{plain}]"
