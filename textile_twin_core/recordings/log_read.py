"""Reader of tables of any logger into columns of numbers: CSV of any dialect, Parquet, MATLAB files."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.hdf5_content import hdf5_content
from textile_twin_core.recordings.log_cells import LogTable, numeric, text_content
from textile_twin_core.recordings.log_dialect import COMMENT, EMPTY, Dialect, as_written, cells_of, sniff
from textile_twin_core.recordings.log_long import by_signal, find_long_form
from textile_twin_core.recordings.log_makers import FILETIME, TIMES, UNTIMED
from textile_twin_core.recordings.log_mapping import LongForm, TextTable
from textile_twin_core.recordings.log_matlab import from_structures, read_matlab
from textile_twin_core.recordings.log_measured import MEASURED_SUFFIXES, read_measured

_HDF5_SUFFIXES = (".h5", ".hdf5", ".hdf", ".he5")
_EPOCH_OF_1601_S = 11_644_473_600.0
"""Seconds from the first day of 1601 to that of 1970."""


def read_log(
    path: Path,
    separator: str | None = None,
    decimal: str | None = None,
    table: str | None = None,
    note: Callable[[str], object] | None = None,
    text: TextTable | None = None,
    signals: LongForm | None = None,
) -> LogTable:
    """Read columns of a log by name, float64 (n,), NaN where a cell is empty; dates become seconds since 1970.

    Args:
        path: .parquet, .mat, or text of any other name.
        separator, decimal: of a text table; detected by default.
        table: variable of a .mat file with the log, if it has several.
        note: called with a description of the skipped parts of a text table.
        text: form of a text table, if it is known.
        signals: the columns of a log in long form; with empty names for a table with a column for each signal.

    Raises RecordingError for a file that is missing, empty, or no table.
    """
    if path.is_dir():
        what = "a recording already" if any(path.glob("*.mcap")) or any(path.glob("*.db3")) else "a folder"
        raise RecordingError(f"{path}: is {what}; give the file that the logger wrote")
    if not path.is_file():
        raise RecordingError(f"{path}: no such file")
    if path.stat().st_size == 0:
        raise RecordingError(f"{path}: the file is empty")
    suffix = path.suffix.lower()
    if suffix == ".parquet":
        columns = _parquet(path, signals)
    elif suffix == ".mat":
        columns = read_matlab(path, table)
    elif suffix in _HDF5_SUFFIXES:
        columns = from_structures(path, hdf5_content(path), table)
    elif suffix in MEASURED_SUFFIXES:
        columns = read_measured(path, table)
    else:
        columns = _text(path, separator, decimal, note, text, signals)
    if not columns:
        held = "; ".join(f"'{name}' holds {what}" for name, what in columns.left_out.items())
        raise RecordingError(f"{path}: no column of numbers in it{': ' * bool(held)}{held}")
    if not any(map(len, columns.values())):
        raise RecordingError(f"{path}: no rows in it, only the names of its columns")
    return columns


def _text(
    path: Path,
    separator: str | None,
    decimal: str | None,
    note: Callable[[str], object] | None,
    text: TextTable | None,
    signals: LongForm | None,
) -> LogTable:
    dialect = sniff(path, separator, decimal) if text is None else as_written(path, text)
    from pyarrow import ArrowInvalid, csv, string, types

    torn = 0
    encoding = "utf-8" if dialect.separator == " " else dialect.encoding

    def leave_out(_: object) -> str:
        nonlocal torn
        torn += 1
        return "skip"

    def read(kinds: dict[str, Any] | None = None) -> Any:
        nonlocal torn
        torn = 0
        return csv.read_csv(
            _tabbed(path, dialect) if dialect.separator == " " else path,
            read_options=csv.ReadOptions(
                skip_rows=dialect.skipped,
                autogenerate_column_names=True,
                encoding=encoding,
                block_size=1 << 24,
            ),
            parse_options=csv.ParseOptions(
                delimiter=dialect.separator.replace(" ", "\t"), invalid_row_handler=leave_out
            ),
            convert_options=csv.ConvertOptions(
                column_types=kinds,
                decimal_point=dialect.decimal,
                null_values=sorted(EMPTY),
                strings_can_be_null=True,
            ),
        )

    # Below the lines that showed kinds and encoding, a cell may be no number, or no UTF-8.
    strings = {f"f{k}": string() for k in range(len(dialect.names))}
    last = ("latin-1" if encoding == "utf-8" else encoding, strings)
    for code, kinds in ((encoding, None), (encoding, strings), last):
        encoding = code
        try:
            table = read(kinds)
        except (ArrowInvalid, UnicodeDecodeError) as error:
            if (code, kinds) == last:
                raise RecordingError(f"{path}: {str(error).splitlines()[0]}") from error
            continue
        if not any(types.is_binary(kind) for kind in table.schema.types):
            break
    if dialect.separator != " ":
        dialect = replace(dialect, encoding=encoding)
    if torn and note is not None:
        width = table.num_columns
        note(f"{torn} of {torn + table.num_rows} rows have other than {width} cells and are left out")
    names = [*dialect.names, *(f"column_{k + 1}" for k in range(len(dialect.names), table.num_columns))]
    written, again = _without_heads(table, dialect)
    if again and note is not None:
        first = _line_of(path, dialect, 0, dialect.heads[0][0])
        note(f"{first}: the header once more, in {again} row{'s' * (again > 1)} of joined logs, dropped")
    day_first = None if text is None else text.day_first
    log = _numbers(dict(zip(names, written.columns, strict=False)), dialect.decimal, signals, day_first)
    if not dialect.known:
        log.text = _written(dialect, log.day_first if day_first is None else day_first)
    for name, (cell, count) in log.bad.items():
        place = _line_of(path, dialect, names.index(name), cell) if name in names else "a line"
        if name in log.left_out:
            log.left_out[name] = text_content(cell, place)
        elif note is not None:
            more = f"; {count} such cells count" if count > 1 else "; it counts"
            note(f"{place}: column '{name}' has '{cell}', no number{more} as empty")
    return _with_times(log, dialect.interval_s)


def _without_heads(table: Any, dialect: Dialect) -> tuple[Any, int]:
    """Drop the rows that repeat the names or the units of the columns, as in joined logs, and count them."""
    import pyarrow
    from pyarrow import compute, types

    text = [k for k, kind in enumerate(table.schema.types) if types.is_string(kind)]
    kept, again = table, 0
    for head in dialect.heads:
        named = [k for k in text if k < len(head) and head[k]]
        if len(named) < sum(map(bool, head)) or not named:
            continue  # a column of numbers alone does not repeat its name
        same = None
        for k in named:
            cells = compute.utf8_trim(compute.fill_null(kept.column(k), ""), ' \t"#%/')
            equal = compute.equal(cells, head[k].strip(' \t"#%/'))
            same = equal if same is None else compute.and_(same, equal)
        rows = int(compute.sum(same).as_py() or 0)
        if rows and rows < kept.num_rows:
            again += rows if head is dialect.heads[0] else 0
            kept = kept.filter(compute.invert(same))
    if not again:
        return table, 0
    columns = [_retyped(column) if pyarrow.types.is_string(column.type) else column for column in kept.columns]
    return pyarrow.table(columns, names=kept.column_names), again


def _retyped(column: Any) -> Any:
    """Convert a column of text to numbers if all its cells are."""
    from pyarrow import ArrowInvalid

    try:
        return column.cast("float64")
    except ArrowInvalid:
        return column


def _written(dialect: Dialect, day_first: bool | None) -> TextTable:
    names, units = (0 if at is None else at + 1 for at in (dialect.names_at, dialect.units_at))
    return TextTable(dialect.separator, dialect.decimal, dialect.encoding, names, units, dialect.skipped + 1, day_first)


def _numbers(
    columns: dict[str, Any], decimal: str, signals: LongForm | None, day_first: bool | None = None
) -> LogTable:
    """Convert Arrow columns to numbers, with a column for each signal of a log in long form."""
    form = find_long_form(columns) if signals is None else signals if signals.signal else None
    if form is None:
        return numeric(columns, decimal, day_first)
    columns, names = by_signal(columns, form)
    log = numeric(columns, decimal, day_first)
    log.signals, log.long_form = names, form
    listed = ", ".join(sorted(names))
    log.left_out[form.value] = f"the values of several signals, which '{form.signal}' names: {listed}"
    return log


def _with_times(log: LogTable, interval_s: float | None) -> LogTable:
    """Merge equal columns of times of a known maker's log into one, or add the times stated in its head."""
    if interval_s is not None and math.isnan(interval_s):
        log.left_out[TIMES[1]] = UNTIMED
    elif interval_s is not None and log:
        rows = len(next(iter(log.values())))
        log = log.with_columns({TIMES[1]: np.arange(rows, dtype=np.float64) * interval_s, **log})
    full = {name: values * 1e-7 - _EPOCH_OF_1601_S for name, values in log.items() if name.startswith(FILETIME)}
    renamed = {name.replace(FILETIME, TIMES[1]): full.get(name, values) for name, values in log.items()}
    first = next((name for name in renamed if name in TIMES), None)
    same = [
        name
        for name, values in renamed.items()
        if first and name.startswith(f"{first}_") and np.array_equal(values, renamed[first], equal_nan=True)
    ]
    table = log.with_columns({name: values for name, values in renamed.items() if name not in same})
    table.times_of = {}
    own = first
    for name in renamed:
        own = first if name in same else name if name.startswith(TIMES) else own
        if first and own:
            table.times_of[name] = own
    return table


def _line_of(path: Path, dialect: Dialect, place: int, cell: str) -> str:
    """Find the line of a cell, for an error message."""
    with path.open(encoding="utf-8-sig" if dialect.encoding == "utf-8" else dialect.encoding, errors="replace") as file:
        for number, line in enumerate(file, 1):
            cells = cells_of(line, dialect.separator)
            if number > dialect.skipped and place < len(cells) and cells[place] == cell:
                return f"line {number}"
    return "a line"


def _tabbed(path: Path, dialect: Dialect) -> BytesIO:
    """Replace the spaces between the columns of a log by tabs."""
    encoding = "utf-8-sig" if dialect.encoding == "utf-8" else dialect.encoding
    with path.open(encoding=encoding, errors="replace") as lines:
        return BytesIO("".join("\t".join(COMMENT.sub("", line, count=1).split()) + "\n" for line in lines).encode())


def _parquet(path: Path, signals: LongForm | None) -> LogTable:
    from pyarrow import ArrowInvalid, parquet

    try:
        table = parquet.read_table(path)
    except (ArrowInvalid, OSError) as error:
        raise RecordingError(f"{path}: not a Parquet file ({str(error).splitlines()[0]})") from error
    return _numbers(dict(zip(table.column_names, table.columns, strict=True)), ".", signals)
