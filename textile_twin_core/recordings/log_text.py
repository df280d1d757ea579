"""Text logs: encoding, separator, decimal sign and header from the beginning, and rows that label each value."""

from __future__ import annotations

import codecs
import csv
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.log_mapping import TextTable
from textile_twin_core.recordings.log_table import EMPTY, HOW, Head, distinct
from textile_twin_core.recordings.log_units import choose, is_unit

LABELS = "labels"
"""Separator of a table whose rows label each value."""
_SIGNATURES = (
    (b"PK\x03\x04", "a ZIP archive, as Excel's workbooks are (.xlsx)", "save its table as CSV"),
    (b"\xd0\xcf\x11\xe0", "a workbook of an old Excel (.xls)", "save its table as CSV"),
    (b"\x1f\x8b", "compressed by gzip", "unpack it first"),
    (b"PAR1", "a Parquet file", "let its name end in .parquet"),
    (b"MATLAB 5.0 MAT-file", "a MATLAB file", "let its name end in .mat"),
    (b"\x89HDF", "an HDF5 file", "let its name end in .h5, or in .mat where MATLAB wrote it"),
    (b"TDSm", "a TDMS file of LabVIEW", "let its name end in .tdms"),
    (b"MDF ", "a measurement file (MDF)", "let its name end in .mf4"),
    (b"\x89MCAP0", "a recording already", "give it to compare, calibrate or the other commands as it is"),
    (b"SQLite format 3", "a database, as a recording's .db3 is", "give the recording's folder to the other commands"),
    (b"#ROSBAG V", "a ROS 1 bag", "convert it first (rosbags-convert --src FILE --dst FOLDER)"),
)
"""First bytes, kind of the file, and advice."""
_CHINESE = re.compile("时间|时刻|角度|转角|扭矩|转矩|力矩|转速|速度")
_ZEROS = 0.3
"""Share of zeros in one of the two bytes of each character above which text is UTF-16."""
_HEAD_BYTES = 65536
_SEPARATORS = (";", "\t", ",", "|")
_DIGITS = re.compile(r"[+\-\u2212]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$")
_ON_CLOCK = r"\d{1,2}:\d\d(:\d\d([.,]\d+|:\d{3})?)?( ?[AaPp]\.?[Mm]\.?)?"
_DATE = re.compile(
    rf"((\d{{4}}[-/]\d\d?[-/]\d\d?|\d\d?([-/.])\d\d?\3\d{{4}})([T ,]+({_ON_CLOCK})(Z|[+-]\d\d:?\d\d)?)?|{_ON_CLOCK})$"
)
_OTHER_DATE = re.compile(r"\d{1,4}/\d{1,2}/\d{1,4}( \d[\d:.,]+)?|\d{1,2}-\d{1,2}-\d{2,4}\b|\d{1,2}:\d\d[\d:]*( [AP]M)?")
"""A date or time in a form that is not read."""
_COMMENT = re.compile(r"^\s*(#+|%+|//+)\s*(?=\S)")
"""Marks of a comment line, which often has the names of the columns."""
_NUMERAL, _OTHER_SIGN, _MOMENT, _NOTHING, _WORD = "number", "number of the other sign", "date", "nothing", "word"
_LOOKED_AT = 40
_BY_SPACES = 1.05
"""Least number of cells split at spaces over that of another separator."""
_FILETIME = 1e17
"""Ticks of 100 ns since 1601, up to the year 1917, which no export reaches in milliseconds."""
_LABEL = re.compile(
    r"\s*(?P<name>[^\W\d_][\w./°%\[\]() -]*?)\s*[:=]\s*"
    r"(?P<value>\d{1,2}:\d\d:\d\d(?:[.,]\d+)?|[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|nan|NaN|-?inf)"
    r"(?:\s*(?P<unit>[^\W\d][\w/^·°*]*|°)(?![\w/^·°*]|\s*[:=]))?\s*(?:[,;|\t]|(?<=\s)|$)"
)
_STAMP = re.compile(rf"\[?(?P<stamp>(\d{{4}}-\d\d-\d\d[T ])?{_ON_CLOCK})\]?\s*(->|[-:>,;])?\s+")
"""Time before the labels of a row, as a terminal program writes it."""
_MOSTLY = 0.8
"""Least share of the lines that label all of their values."""


@dataclass(frozen=True)
class _Layout:
    """Form of a table, names of its columns, cells of its header lines, and the rows a second, if stated."""

    table: TextTable
    names: tuple[str, ...]
    heads: tuple[tuple[str, ...], ...] = ()
    rate_hz: float | None = None


def read_text(
    path: Path, separator: str | None, decimal: str | None, form: TextTable | None, head: Head
) -> tuple[dict[str, Any], Callable[[str, str], str]]:
    """Read a text log to Arrow columns of numbers or text by name; its form and notes on skipped rows go to `head`.

    Args:
        path: of the log. separator, decimal: given by the user. form: of a mapping; None to detect it.
        head: takes `text`, `rate_hz` and notes.

    Returns:
        The columns, and a function that finds the line of a cell: (column, cell) -> words.

    Raises:
        RecordingError: The file is no text, or no table of numbers.
    """
    with path.open("rb") as file:
        begin = file.read(_HEAD_BYTES)
    if form is None:
        text, encoding = _decoded(path, begin)
    else:
        encoding = form.encoding
        try:
            text = begin.decode(encoding, errors="replace").removeprefix("\ufeff")
        except LookupError:
            raise RecordingError(f"{path}: encoding '{encoding}' of the mapping is not known") from None
    lines = text.splitlines()
    if len(begin) == _HEAD_BYTES:
        lines = lines[:-1]  # it may be cut
    if form.separator == LABELS if form else separator is None and _is_labelled(lines):
        head.text = TextTable(LABELS, encoding=encoding)
        return _labelled(path, encoding, head), lambda *_: "a line"
    layout = _given(path, form, lines) if form else _sniffed(path, lines, encoding, separator, decimal)
    table, layout = _arrow(path, layout, head)
    names = [*layout.names, *(f"column_{k + 1}" for k in range(len(layout.names), table.num_columns))]
    table = _without_heads(path, table, layout, head)
    head.text, head.rate_hz, head.day_first = layout.table, layout.rate_hz, layout.table.day_first

    def line_of(name: str, cell: str) -> str:
        return _line_of(path, layout, names.index(name), cell) if name in names else "a line"

    return dict(zip(names, table.columns, strict=False)), line_of


def _decoded(path: Path, begin: bytes) -> tuple[str, str]:
    """Return the text at the beginning of a file, and the encoding in which Python reads all of it."""
    for signature, what, then in _SIGNATURES:
        if begin.startswith(signature):
            raise RecordingError(f"{path}: is no text but {what}; {then}")
    encoding = _encoding(begin)
    text = begin.decode("cp1252" if encoding == "latin-1" else encoding, errors="replace").removeprefix("\ufeff")
    if "\0" in text:
        raise RecordingError(f"{path}: is no text (it has zero bytes); export the log as CSV, Parquet or MATLAB file")
    return text, encoding


def _encoding(begin: bytes) -> str:
    """Detect UTF-16 by its mark or its zeros, then valid UTF-8, then Chinese by its words."""
    if begin.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    for first, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
        zeros, others = begin[first::2].count(0), begin[1 - first :: 2].count(0)
        if zeros > _ZEROS * len(begin) / 2 and not others:
            return encoding
    if "\ufffd" not in begin.decode("utf-8", errors="replace").rstrip("\ufffd"):  # the last character may be cut
        return "utf-8"
    return "gb18030" if _CHINESE.search(begin.decode("gb18030", errors="replace")) else "latin-1"


# A table with a separator ---------------------------------------------------------------------------------------------


def _sniffed(path: Path, lines: list[str], encoding: str, separator: str | None, decimal: str | None) -> _Layout:
    """Detect the layout in which most of the beginning is rows of equal length. Raises RecordingError."""
    ends = [k for k, line in enumerate(lines) if line.startswith("***End_of_Header***")][:2]  # of LabVIEW
    start = ends[-1] + 1 if ends and not any(_DIGITS.match(line.split("\t")[0]) for line in lines[: ends[-1]]) else 0
    start = ends[0] + 1 if ends and not start else start
    best: tuple[int, int, _Layout] | None = None
    for point in (decimal,) if decimal else (".", ","):
        for mark in (separator,) if separator else (*_SEPARATORS, " "):
            if mark == point and '"' not in "".join(lines):
                continue
            found = _try(lines, mark, point, start)
            # Other separators may have spaces in cells of their header.
            least = -1.0 if best is None else best[0] * (_BY_SPACES if mark == " " else 1.0)
            if found is not None and (best is None or found[0] > least or (found[0] == least and found[1] > best[1])):
                best = found
    if best is None:
        when = next((match for match in map(_OTHER_DATE.search, lines) if match), None)
        then = "give --separator and --decimal, or a --mapping with `text`, or convert it to CSV"
        if when:
            then = f"'{when[0]}' is no date that is read; write {HOW}, or leave the column out and give --rate HZ"
        raise RecordingError(f"{path}: no table of numbers found at its beginning; {then}")
    stated = re.findall(r"\d+[.,]\d+(?:[eE][+-]?\d+)?", " ".join(each for each in lines[:start] if "Delta_X" in each))
    steps = [step for each in stated if (step := float(each.replace(",", "."))) > 0.0]
    return replace(best[2], table=replace(best[2].table, encoding=encoding), rate_hz=1.0 / steps[0] if steps else None)


def _try(lines: list[str], separator: str, decimal: str, start: int) -> tuple[int, int, _Layout] | None:
    """Count numbers less words, and columns, of a layout whose rows begin at line `start` at the earliest."""
    near_end = [[_kind(cell, decimal) for cell in _cells(line, separator)] for line in lines[-_LOOKED_AT:]]
    width = max((len(row) for row in near_end if _is_data(row, range(len(row)))), default=0)
    full = 0 if separator == " " else max((line.count(separator) + 1 for line in lines[-_LOOKED_AT:]), default=0)
    if full == width + 1 and any(len(_cells(line, separator)) == full for line in lines[:_LOOKED_AT]):
        width = full  # the last column has a name and is empty
    text = [_cells(line, separator, width) for line in lines]
    cells = [[_kind(cell, decimal) for cell in row] for row in text]
    near_end = [row for row in cells[-_LOOKED_AT:] if len(row) == width]
    counted = [k for k in range(width) if sum(row[k] == _WORD for row in near_end) <= len(near_end) // 2]
    data = [k for k, row in enumerate(cells) if k >= start and len(row) == width and _is_data(row, counted)]
    if not data:
        return None
    # Above the names there may be a line of keys and values; below them are two rows, at least one without words.
    pairs = [k for k, after in pairwise(data) if after == k + 1]
    clean = next((k for k in pairs if all(cells[k][each] != _WORD for each in counted)), data[0])
    labels = {text[k][0]: k for k in range(clean) if len(text[k]) == width and text[k][0]}
    at: list[int]
    if "Name" in labels and cells[clean][0] == _NUMERAL:  # TwinCAT Scope, a line for each property of the channels
        first, at = clean, [labels["Name"], *([labels["Unit"]] if "Unit" in labels else [])]
    elif start:
        first, at = data[0], [start]
    else:
        words = [k for k, row in enumerate(cells[:clean]) if len(row) == width and _is_words(row, counted)]
        first = next(k for k in data if not words or k > words[-1])
        # Names often stand in a comment.
        above = [(k, _cells(_COMMENT.sub("", line, count=1), separator, width)) for k, line in enumerate(lines[:first])]
        above = [(k, row) for k, row in above if len(row) == width and any(row)]
        at = [above[-1][0]] if above else []
        if len(above) > 1 and _are_units(above[-1][1]):
            at.insert(0, above[-2][0])
    names, heads = _names(lines, separator, width, at, first, decimal)
    names_line, units_line = (at[k] + 1 if len(at) > k else 0 for k in range(2))
    found = sum(cells[k].count(_NUMERAL) - cells[k].count(_WORD) for k in data if k >= first)
    table = TextTable(separator, decimal, "utf-8", names_line, units_line, first + 1)
    return found, width, _Layout(table, names, heads)


def _given(path: Path, form: TextTable, lines: list[str]) -> _Layout:
    """Return the layout of a mapping, with the names of the columns of this file. Raises RecordingError."""
    first = form.first_line - 1
    if not 0 <= first < len(lines) or max(form.names_line, form.units_line) > first:
        raise RecordingError(f"{path}: has {len(lines)} lines, and the mapping's text.first_line is {form.first_line}")
    at = [line - 1 for line in (form.names_line, form.units_line) if line]
    width = len(_cells(lines[first], form.separator))
    if form.names_line:
        width = max(width, len(_cells(_COMMENT.sub("", lines[at[0]], count=1), form.separator)))
    return _Layout(form, *_names(lines, form.separator, width, at, first, form.decimal))


def _names(
    lines: Sequence[str], separator: str, width: int, at: Sequence[int], first: int, decimal: str
) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """Names of columns with their units, from the lines of names and units, and the cells of both."""
    made_up = [f"column_{k + 1}" for k in range(width)]
    rows = [_cells(_COMMENT.sub("", lines[k], count=1), separator, width)[:width] for k in at]
    given = [cell or name for cell, name in zip(rows[0], made_up, strict=False)] if rows else made_up
    begin = _cells(lines[first], separator, width)[0] if first < len(lines) else ""
    if rows and rows[0][0] == "Name" and _kind(begin, decimal) == _NUMERAL:  # times of TwinCAT Scope are called so
        time = "Time [filetime]" if float(begin.replace(decimal, ".")) > _FILETIME else "Time [ms]"
        units = [unit.partition(" (")[0] for unit in rows[1]] if len(rows) > 1 else [""] * width
        given = [time if name == "Name" else _united(name, unit) for name, unit in zip(rows[0], units, strict=False)]
    elif len(rows) > 1:
        given = [_united(name, unit) for name, unit in zip(rows[0], rows[1], strict=False)]
    names: list[str] = []
    for name in given:
        names.append(distinct(name, set(names)))
    return tuple(names), tuple(map(tuple, rows))


def _united(name: str, unit: str) -> str:
    """Append the unit below a column's name, which may already be in brackets."""
    return name if not unit or unit.startswith("(None") else f"{name} {unit}" if unit[0] in "[(" else f"{name} [{unit}]"


def _cells(line: str, separator: str, width: int = 0) -> list[str]:
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
    if cell in EMPTY:
        return _NOTHING
    if _DIGITS.match(cell):
        return _OTHER_SIGN if ("," if decimal == "." else ".") in cell else _NUMERAL
    return _MOMENT if _DATE.match(cell) else _WORD


def _is_data(row: list[str], counted: Sequence[int]) -> bool:
    """Return true if the counted cells have numbers, with dates more than words, and none of the other decimal sign.

    Equally many are enough if the first cell is a number: a reading is then missing from the row.
    """
    kinds = [row[k] for k in counted]
    words, known = kinds.count(_WORD), kinds.count(_NUMERAL) + kinds.count(_MOMENT)
    if _NUMERAL not in kinds or _OTHER_SIGN in kinds:
        return False
    return known > words or (known == words and kinds[0] != _WORD)


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


def _arrow(path: Path, layout: _Layout, head: Head) -> tuple[Any, _Layout]:
    """Read the rows of a layout by Arrow; return the table, and the layout with the encoding of all of it."""
    from pyarrow import ArrowInvalid, csv, string, types

    form, torn = layout.table, 0

    def leave_out(_: object) -> str:
        nonlocal torn
        torn += 1
        return "skip"

    # Below the lines that showed kinds and encoding, a cell may be no number, or no UTF-8.
    spaced = form.separator == " "
    strings = {f"f{k}": string() for k in range(len(layout.names))}
    encoding = "utf-8" if spaced else form.encoding
    tries = ((encoding, None), (encoding, strings), ("latin-1" if encoding == "utf-8" else encoding, strings))
    for used, kinds in tries:
        torn, encoding = 0, used
        try:
            table = csv.read_csv(
                _tabbed(path, form.encoding) if spaced else path,
                csv.ReadOptions(
                    skip_rows=form.first_line - 1,
                    autogenerate_column_names=True,
                    encoding=encoding,
                    block_size=1 << 24,
                ),
                csv.ParseOptions(delimiter="\t" if spaced else form.separator, invalid_row_handler=leave_out),
                csv.ConvertOptions(
                    column_types=kinds,
                    decimal_point=form.decimal,
                    null_values=list(EMPTY),
                    strings_can_be_null=True,
                ),
            )
        except (ArrowInvalid, UnicodeDecodeError) as error:
            if (used, kinds) == tries[-1]:
                raise RecordingError(f"{path}: {str(error).splitlines()[0]}") from error
            continue
        if not any(types.is_binary(kind) for kind in table.schema.types):
            break
    if torn:
        rows, width = torn + table.num_rows, table.num_columns
        head.notes.append(f"{torn} of {rows} rows have other than {width} cells and are left out")
    return table, layout if spaced else replace(layout, table=replace(form, encoding=encoding))


def _tabbed(path: Path, encoding: str) -> BytesIO:
    """Replace the spaces between the columns of a log by tabs."""
    with path.open(encoding="utf-8-sig" if encoding == "utf-8" else encoding, errors="replace") as lines:
        return BytesIO("".join("\t".join(_COMMENT.sub("", line, count=1).split()) + "\n" for line in lines).encode())


def _without_heads(path: Path, table: Any, layout: _Layout, head: Head) -> Any:
    """Drop the rows that repeat the names or the units of the columns, as in joined logs, and note them."""
    import pyarrow
    from pyarrow import ArrowInvalid, compute, types

    kept, again = table, 0
    for cells in layout.heads:
        named = [k for k, cell in enumerate(cells) if cell]
        if not named or not all(types.is_string(kept.schema.types[k]) for k in named if k < kept.num_columns):
            continue  # a column of numbers alone does not repeat its name
        same = None
        for k in named:
            trimmed = compute.utf8_trim(compute.fill_null(kept.column(k), ""), ' \t"#%/')
            equal = compute.equal(trimmed, cells[k].strip(' \t"#%/'))
            same = equal if same is None else compute.and_(same, equal)
        rows = int(compute.sum(same).as_py() or 0)
        if rows and rows < kept.num_rows:
            again += rows if cells is layout.heads[0] else 0
            kept = kept.filter(compute.invert(same))
    if not again:
        return table
    place = _line_of(path, layout, 0, layout.heads[0][0])
    head.notes.append(f"{place}: the header once more, in {again} row{'s' * (again > 1)} of joined logs, dropped")
    columns = []
    for column in kept.columns:
        try:
            columns.append(column.cast("float64") if types.is_string(column.type) else column)
        except ArrowInvalid:
            columns.append(column)
    return pyarrow.table(columns, names=kept.column_names)


def _line_of(path: Path, layout: _Layout, place: int, cell: str) -> str:
    """Find the line of a cell below the header."""
    encoding = layout.table.encoding
    with path.open(encoding="utf-8-sig" if encoding == "utf-8" else encoding, errors="replace") as file:
        for number, line in enumerate(file, 1):
            cells = _cells(line, layout.table.separator) if number >= layout.table.first_line else []
            if place < len(cells) and cells[place] == cell:
                return f"line {number}"
    return "a line"


# Rows that label each value -------------------------------------------------------------------------------------------


def _values(line: str) -> dict[str, Any] | None:
    """Return the values of a line by label: `Time: 5001 Position: 596`, `a=1 b=2`, an object; None for another line."""
    line = line.strip().rstrip(",")
    line = line.removeprefix("[") if line.startswith("[{") else line
    line = line.removesuffix("]") if line.endswith("}]") else line
    if line.startswith("{") and line.endswith("}"):
        try:
            return _flat("", json.loads(line))
        except ValueError:
            return None
    stamp = _STAMP.match(line)
    found: dict[str, Any] = {} if stamp is None else {"stamp": stamp["stamp"]}
    at = 0 if stamp is None else stamp.end()
    while at < len(line):
        match = _LABEL.match(line, at)
        if match is None or match.end() == at:
            return None
        name = match["name"].strip()
        found[f"{name} [{match['unit']}]" if match["unit"] else name] = match["value"]
        at = match.end()
    return found or None


def _flat(above: str, value: Any) -> dict[str, Any]:
    """Values of nested objects and lists by path."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else None
    if inner is None:
        return {above: value}
    paths = {k: f"{above}[{k}]" if isinstance(value, list) else f"{above}.{k}".lstrip(".") for k, _ in inner}
    items = value.items() if isinstance(value, dict) else enumerate(value)
    return {path: each for k, one in items for path, each in _flat(paths[k], one).items()}


def _is_labelled(lines: list[str]) -> bool:
    filled = [line for line in lines if line.strip()]
    found = [each for each in map(_values, filled) if each]
    labels = {label for each in found for label in each}
    return len(found) >= max(2.0, _MOSTLY * len(filled)) and len(labels) > 1 and len(found) >= 2 * len(labels)


def _labelled(path: Path, encoding: str, head: Head) -> dict[str, Any]:
    """Read the columns of rows that label each value; a label alone in its line ends no row."""
    import pyarrow

    rows: list[dict[str, Any]] = []
    torn = 0
    with path.open(encoding="utf-8-sig" if encoding == "utf-8" else encoding, errors="replace") as file:
        for line in file:
            values = _values(line) if line.strip(" \t\r\n[],") else {}
            if values is None:
                torn += 1
            elif rows and len(values) == 1 and not rows[-1].keys() & values.keys():
                rows[-1] |= values
            elif values:
                rows.append(values)
    if torn:
        head.notes.append(f"{torn} lines without a label for each value are left out")
    columns = {}
    for name in dict.fromkeys(label for row in rows for label in row):
        cells = [row.get(name) for row in rows]
        if all(isinstance(cell, (int, float)) or cell is None for cell in cells):
            columns[name] = pyarrow.chunked_array([pyarrow.array(cells, "float64", from_pandas=True)])
        else:
            text = pyarrow.chunked_array([pyarrow.array([None if cell is None else str(cell) for cell in cells])])
            columns[name] = text
    return columns
