"""Dialect of a text table: separator, decimal sign and header, detected from its beginning."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.log_columns import choose
from textile_twin_core.recordings.log_dates import HOW, MOMENT, OTHER_MOMENT
from textile_twin_core.recordings.log_makers import known_head
from textile_twin_core.recordings.log_mapping import TextTable
from textile_twin_core.recordings.log_text import decoded
from textile_twin_core.recordings.log_thousands import DOUBT, has_thousands, may_have_thousands
from textile_twin_core.recordings.log_units import is_unit

EMPTY = {"", "nan", "NaN", "NAN", "null", "inf", "-inf"}
"""Contents of a cell without a number."""
_HEAD_BYTES = 65536
_SEPARATORS = (";", "\t", ",", "|")
_NUMBER = re.compile(r"[+\-\u2212]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$")
COMMENT = re.compile(r"^\s*(#+|%+|//+)\s*(?=\S)")
"""Marks of a comment line, which often has the names of the columns."""
_NUMERAL, _OTHER_SIGN, _MOMENT, _NOTHING, _WORD = "number", "number of the other sign", "date", "nothing", "word"
_LOOKED_AT = 40


@dataclass(frozen=True)
class Dialect:
    """Dialect of a text table. decimal: point or comma. skipped: lines before the first row of data.

    names: of the columns, with their units if the file has them; column_1 and so on without names.
    encoding: of its characters, by Python's name. interval_s: from row to row, if the head states it instead of
    the rows. names_at, units_at: lines of names and units, from 0. heads: the cells of such lines.
    known: true for the head of a known maker.
    """

    separator: str
    decimal: str
    skipped: int
    names: tuple[str, ...]
    encoding: str = "utf-8"
    interval_s: float | None = None
    names_at: int | None = None
    units_at: int | None = None
    heads: tuple[tuple[str, ...], ...] = ()
    known: bool = False


def sniff(path: Path, separator: str | None = None, decimal: str | None = None) -> Dialect:
    """Detect the dialect in which most of the file's beginning is rows of equal length. Raises RecordingError."""
    with path.open("rb") as file:
        begin = file.read(_HEAD_BYTES)
    text, encoding = decoded(path, begin)
    lines = text.splitlines()
    if len(begin) == _HEAD_BYTES:
        lines = lines[:-1]  # it may be cut
    head = known_head(str(path), lines, decimal)
    if head is not None:
        names = tuple(_distinct(list(head.names)))
        return Dialect(
            separator or head.separator, head.decimal, head.skipped, names, encoding, head.interval_s, known=True
        )
    best: tuple[int, int, Dialect] | None = None
    for point in (decimal,) if decimal else (".", ","):
        for mark in (separator,) if separator else (*_SEPARATORS, " "):
            if mark == point and '"' not in text:
                continue
            found = _try(lines, mark, point)
            if found is not None and (best is None or found[:2] > best[:2]):
                best = found
    if best is None:
        _refuse_dates(path, lines)
        _refuse_mixed_signs(path, lines)
        raise RecordingError(
            f"{path}: no table of numbers found at its beginning; tell --separator and --decimal, or convert it to CSV"
        )
    return replace(best[2], encoding=encoding)


def _refuse_dates(path: Path, lines: list[str]) -> None:
    """Raise RecordingError for a log whose dates hide its numbers."""
    for number, line in enumerate(lines, 1):
        found = OTHER_MOMENT.search(line)
        if found:
            raise RecordingError(
                f"{path}, line {number}: '{found[0]}': dates and times are read as {HOW}; write them so, or leave the"
                " column out and give --rate HZ"
            )


def _refuse_mixed_signs(path: Path, lines: list[str]) -> None:
    """Raise RecordingError for a log in which one sign is decimal, and another may separate thousands."""
    for number, line in enumerate(lines, 1):
        for separator in (";", "\t", "|"):
            cells = cells_of(line, separator)
            doubtful = next((cell for cell in cells if may_have_thousands(cell)), None)
            if doubtful and any("." in cell for cell in cells) and any("," in cell for cell in cells):
                raise RecordingError(
                    f"{path}, line {number}: '{doubtful}': {DOUBT}; write numbers without thousands separators"
                )


def _try(lines: list[str], separator: str, decimal: str) -> tuple[int, int, Dialect] | None:
    """Count the numbers and columns of a dialect, and return it with its header."""
    near_end = [[_kind(cell, decimal) for cell in cells_of(line, separator)] for line in lines[-_LOOKED_AT:]]
    width = max((len(row) for row in near_end if _is_data(row, range(len(row)))), default=0)
    cells = [[_kind(cell, decimal) for cell in cells_of(line, separator, width)] for line in lines]
    near_end = [row for row in cells[-_LOOKED_AT:] if len(row) == width]
    counted = [k for k in range(width) if sum(row[k] == _WORD for row in near_end) <= len(near_end) // 2]
    data = [k for k, row in enumerate(cells) if len(row) == width and _is_data(row, counted)]
    if not data:
        return None
    # Above the names there may be a line of keys and values; below them are two rows, at least one without words.
    pairs = [k for k, after in pairwise(data) if after == k + 1]
    clean = next((k for k in pairs if all(cells[k][each] != _WORD for each in counted)), data[0])
    names_at = [k for k, row in enumerate(cells[:clean]) if len(row) == width and _is_words(row, counted)]
    data = [k for k in data if not names_at or k > names_at[-1]]
    first = data[0]
    # Names often stand in a comment.
    above = [(k, cells_of(COMMENT.sub("", line, count=1), separator, width)) for k, line in enumerate(lines[:first])]
    above = [(k, row) for k, row in above if len(row) == width and any(row)]
    at = [above[-1][0]] if above else []
    if len(above) > 1 and _are_units(above[-1][1]):
        at.insert(0, above[-2][0])
    head_lines: tuple[int | None, int | None] = (at[0] if at else None, at[1] if len(at) > 1 else None)
    names, heads = _names(lines, separator, width, *head_lines)
    found = sum(cells[k].count(_NUMERAL) for k in data)
    return (
        found,
        width,
        Dialect(separator, decimal, first, names, names_at=head_lines[0], units_at=head_lines[1], heads=heads),
    )


def _names(
    lines: Sequence[str], separator: str, width: int, names_at: int | None, units_at: int | None
) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """Names of columns with their units, and the cells of both lines; numbered names without such lines."""
    made_up = [f"column_{k + 1}" for k in range(width)]
    rows = [
        cells_of(COMMENT.sub("", lines[k], count=1), separator, width) for k in (names_at, units_at) if k is not None
    ]
    if not rows:
        return tuple(made_up), ()
    names = [cell or name for cell, name in zip(rows[0], made_up, strict=False)]
    if len(rows) > 1:
        names = [_with_unit(name, unit) for name, unit in zip(rows[0], rows[1], strict=False)]
    return tuple(_distinct(names)), tuple(map(tuple, rows))


def as_written(path: Path, table: TextTable) -> Dialect:
    """Return the dialect of a mapping, with the names of the columns of this file. Raises RecordingError."""
    with path.open("rb") as file:
        begin = file.read(_HEAD_BYTES)
    try:
        lines = begin.decode(table.encoding, errors="replace").removeprefix("\ufeff").splitlines()
    except LookupError:
        raise RecordingError(f"{path}: encoding '{table.encoding}' of the mapping is not known") from None
    first = table.first_line - 1
    if not 0 <= first < len(lines) or max(table.names_line, table.units_line) > first:
        raise RecordingError(f"{path}: has {len(lines)} lines, and the mapping's text.first_line is {table.first_line}")
    names_at, units_at = (line - 1 if line else None for line in (table.names_line, table.units_line))
    width = len(cells_of(lines[first], table.separator))
    if names_at is not None:
        width = max(width, len(cells_of(COMMENT.sub("", lines[names_at], count=1), table.separator)))
    names, heads = _names(lines, table.separator, width, names_at, units_at)
    return Dialect(table.separator, table.decimal, first, names, table.encoding, None, names_at, units_at, heads)


def _with_unit(name: str, unit: str) -> str:
    """Append the unit below a column's name, which may already be in brackets."""
    return name if not unit else f"{name} {unit}" if unit[0] in "[(" else f"{name} [{unit}]"


def cells_of(line: str, separator: str, width: int = 0) -> list[str]:
    """Split a line into cells, without surrounding spaces and quotation marks; quoted separators do not split.

    An empty last one of several cells is only a separator at the line's end, unless it is number `width`.
    """
    if '"' in line and separator != " ":
        parts = next(csv.reader([line.rstrip("\r\n")], delimiter=separator))
    else:
        parts = line.split() if separator == " " else line.split(separator)
    if separator != " " and 1 < len(parts) != width and not parts[-1].strip():
        parts = parts[:-1]
    return [part.strip().strip('"').strip() for part in parts]


def _kind(cell: str, decimal: str) -> str:
    """Kind of a cell: a number of this decimal sign or the other, a date, nothing, or a word."""
    other = "," if decimal == "." else "."
    if cell in EMPTY:
        return _NOTHING
    if (_NUMBER.match(cell) and other not in cell) or has_thousands(cell, decimal):
        return _NUMERAL
    if _NUMBER.match(cell):
        return _OTHER_SIGN
    return _MOMENT if MOMENT.match(cell) else _WORD


def _is_data(row: list[str], counted: Sequence[int]) -> bool:
    """Return true if the counted cells have numbers, with dates more than words, and none of the other decimal sign.

    Equally many are enough if the first cell is no word: then a reading is missing, and it is no key with its value.
    """
    kinds = [row[k] for k in counted]
    if _OTHER_SIGN in kinds:
        return False
    words = kinds.count(_WORD)
    known = kinds.count(_NUMERAL) + kinds.count(_MOMENT)
    return _NUMERAL in kinds and (known > words or (known == words and kinds[0] != _WORD))


def _is_words(row: list[str], counted: Sequence[int]) -> bool:
    """Return true if some of the counted cells are words, and none is a number or a date."""
    return {row[k] for k in counted} - {_NOTHING} == {_WORD}


def _are_units(row: list[str]) -> bool:
    """Return true if cells are as short as units and no names, or half of the non-empty ones are known units."""
    filled = [cell for cell in row if cell]
    unknown = [cell for cell in filled if not is_unit(cell)]
    if 2 * len(unknown) <= len(filled):
        return True
    return all(len(cell) <= 8 for cell in filled) and not any(
        choose(kind, unknown) for kind in ("time", "angle", "torque", "speed")
    )


def _distinct(names: list[str]) -> list[str]:
    seen: dict[str, int] = {}
    out = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        out.append(name if seen[name] == 1 else f"{name}_{seen[name]}")
    return out
