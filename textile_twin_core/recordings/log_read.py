"""Tables from any logger as columns of numbers: CSV of any dialect, Parquet, MATLAB files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.log_dialect import EMPTY, Dialect, sniff


def read_log(
    path: Path,
    separator: str | None = None,
    decimal: str | None = None,
    table: str | None = None,
    note: Callable[[str], object] | None = None,
) -> dict[str, FloatArray]:
    """Columns of a log by name, float64 (n,), NaN where a cell is empty; dates become seconds since 1970.

    Args:
        path: .parquet, .mat, or text of any other name.
        separator, decimal: of a text table, where they are not to be found out.
        table: variable of a .mat file that holds the matrix, when it has several.
        note: is told what of a text table was left out.

    Raises RecordingError, one line, for a file that is missing, empty, or no table.
    """
    if not path.is_file():
        raise RecordingError(f"{path}: no such file")
    if path.stat().st_size == 0:
        raise RecordingError(f"{path}: the file is empty")
    if path.suffix.lower() == ".parquet":
        columns = _parquet(path)
    elif path.suffix.lower() == ".mat":
        columns = _matlab(path, table)
    else:
        columns = _text(path, separator, decimal, note)
    if not columns:
        raise RecordingError(f"{path}: no column of numbers in it")
    return columns


def _text(
    path: Path, separator: str | None, decimal: str | None, note: Callable[[str], object] | None
) -> dict[str, FloatArray]:
    dialect = sniff(path, separator, decimal)
    from pyarrow import ArrowInvalid, csv

    if dialect.separator == " ":
        return _spaced(path, dialect)
    torn = 0

    def leave_out(_: object) -> str:
        nonlocal torn
        torn += 1
        return "skip"

    try:
        table = csv.read_csv(
            path,
            read_options=csv.ReadOptions(
                skip_rows=dialect.skipped, autogenerate_column_names=True, encoding="utf-8", block_size=1 << 24
            ),
            parse_options=csv.ParseOptions(delimiter=dialect.separator, invalid_row_handler=leave_out),
            convert_options=csv.ConvertOptions(
                decimal_point=dialect.decimal, null_values=sorted(EMPTY), strings_can_be_null=True
            ),
        )
    except ArrowInvalid as error:
        raise RecordingError(f"{path}: {str(error).splitlines()[0]}") from error
    if torn and note is not None:
        width = table.num_columns
        note(f"{torn} of {torn + table.num_rows} rows have other than {width} cells and are left out")
    names = [*dialect.names, *(f"column_{k + 1}" for k in range(len(dialect.names), table.num_columns))]
    return _numeric(dict(zip(names, table.columns, strict=False)))


def _spaced(path: Path, dialect: Dialect) -> dict[str, FloatArray]:
    """Columns parted by any number of spaces."""
    with path.open(encoding="utf-8-sig", errors="replace") as lines:
        rows = (
            line.replace(",", ".") if dialect.decimal == "," else line for line in islice(lines, dialect.skipped, None)
        )
        try:
            values = np.loadtxt(rows, dtype=np.float64, ndmin=2)
        except ValueError as error:
            raise RecordingError(f"{path}: {error}") from error
    return {name: np.ascontiguousarray(values[:, k]) for k, name in enumerate(dialect.names)}


def _parquet(path: Path) -> dict[str, FloatArray]:
    from pyarrow import ArrowInvalid, parquet

    try:
        table = parquet.read_table(path)
    except (ArrowInvalid, OSError) as error:
        raise RecordingError(f"{path}: not a Parquet file ({str(error).splitlines()[0]})") from error
    return _numeric(dict(zip(table.column_names, table.columns, strict=True)))


def _numeric(columns: Mapping[str, Any]) -> dict[str, FloatArray]:
    """Arrow columns as float64; dates as seconds since 1970; text is left out."""
    import pyarrow

    out: dict[str, FloatArray] = {}
    for name, written in columns.items():
        column = _dates(written) if pyarrow.types.is_string(written.type) else written
        kind = column.type
        if pyarrow.types.is_timestamp(kind):
            stamps = column.cast(pyarrow.timestamp("ns")).combine_chunks().cast(pyarrow.int64())
            out[name] = np.asarray(stamps.to_numpy(zero_copy_only=False), dtype=np.float64) * 1e-9
        elif pyarrow.types.is_integer(kind) or pyarrow.types.is_floating(kind):
            out[name] = np.asarray(column.cast(pyarrow.float64()).to_numpy(), dtype=np.float64)
    return out


def _dates(column: Any) -> Any:
    """Text as stamps where all of it is dates with a decimal comma or with the day first; else as it is."""
    import pyarrow
    from pyarrow import compute

    iso = compute.replace_substring_regex(column, r"^(\d\d)\.(\d\d)\.(\d{4})[T ]", r"\3-\2-\1 ")
    try:
        return compute.replace_substring(iso, ",", ".").cast(pyarrow.timestamp("ns"))
    except pyarrow.ArrowInvalid:
        return column


def _matlab(path: Path, table: str | None) -> dict[str, FloatArray]:
    """Vectors by name, or the columns of the one matrix."""
    try:
        content = loadmat(path, squeeze_me=True)
    except NotImplementedError as error:
        raise RecordingError(f"{path}: a MATLAB file of version 7.3; save it with -v7") from error
    except (ValueError, OSError) as error:
        raise RecordingError(f"{path}: not a MATLAB file ({error})") from error
    arrays = {k: v for k, v in content.items() if isinstance(v, np.ndarray) and np.issubdtype(v.dtype, np.number)}
    if table is not None:
        if table not in arrays:
            raise RecordingError(f"{path}: no variable '{table}'; there are: {', '.join(arrays) or 'none'}")
        arrays = {table: arrays[table]}
    vectors = {k: np.asarray(v, dtype=np.float64) for k, v in arrays.items() if v.ndim == 1 and v.size > 1}
    if vectors:
        longest = max(v.size for v in vectors.values())
        return {k: v for k, v in vectors.items() if v.size == longest}
    matrices = {k: v for k, v in arrays.items() if v.ndim == 2 and min(v.shape) > 1}
    if len(matrices) != 1:
        names = ", ".join(matrices) or "none"
        raise RecordingError(f"{path}: which matrix holds the log? there are: {names}; name one with --table")
    matrix = np.asarray(next(iter(matrices.values())), dtype=np.float64)
    matrix = matrix if matrix.shape[0] >= matrix.shape[1] else matrix.T
    return {f"column_{k + 1}": np.ascontiguousarray(matrix[:, k]) for k in range(matrix.shape[1])}
