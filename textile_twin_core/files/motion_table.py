"""Tables of shaft motion and of outputs: CSV and Parquet, one row per sample."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import MotionError, OutputError
from textile_twin_core.files.atomic import staged

if TYPE_CHECKING:
    import pyarrow

_NEEDED = ("theta_rad", "omega_rad_s", "alpha_rad_s2")
_TIME = "time_s"
_ROWS = 100_000
"""Rows per write."""
_MISMATCH_RAD, _MISMATCH_SHARE = 0.5, 0.2
"""Disagreement of angles and speeds, absolute and relative, beyond rounding and coarse steps."""
TABLE_SUFFIXES = (".csv", ".parquet")


@dataclass(frozen=True)
class MotionTable:
    """Shaft motion sample by sample; finite arrays (n,). An optional time_s increases."""

    theta_rad: FloatArray
    omega_rad_s: FloatArray
    alpha_rad_s2: FloatArray
    time_s: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.theta_rad)

    def columns(self) -> dict[str, FloatArray]:
        """Columns by name, in the order of the file."""
        columns = {name: getattr(self, name) for name in _NEEDED}
        return columns if self.time_s is None else columns | {_TIME: self.time_s}


def rotation_mismatch(motion: MotionTable) -> tuple[float, float] | None:
    """Compare the total rotation [rad] by angles and by speeds over time_s; None if both agree.

    Angles may be wrapped. The rotation by angles sums the steps less whole turns.
    """
    if motion.time_s is None or len(motion) < 2:
        return None
    by_speed = 0.5 * (motion.omega_rad_s[1:] + motion.omega_rad_s[:-1]) * np.diff(motion.time_s)
    turned = np.diff(motion.theta_rad)
    mismatch = turned - by_speed
    mismatch -= 2.0 * np.pi * np.rint(mismatch / (2.0 * np.pi))
    sizes = float(np.abs(turned).sum()), float(np.abs(by_speed).sum())
    if float(np.abs(np.cumsum(mismatch)).max()) <= _MISMATCH_RAD + _MISMATCH_SHARE * min(sizes):
        return None
    return sizes


def read_motion_table(path: str | Path) -> MotionTable:
    r"""Read a table with the columns theta_rad, omega_rad_s, alpha_rad_s2 and, optionally, time_s; ignore others.

    Args:
        path: file with the suffix .csv or .parquet.

    Raises:
        MotionError: for a missing file or column, and with the line for a cell that is not a finite number.

    Examples:
        >>> import pathlib, tempfile, textile_twin_core as ttc
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     file = pathlib.Path(folder, "motion.csv")
        ...     _ = file.write_text("theta_rad,omega_rad_s,alpha_rad_s2\n0.0,14.0,0.0\n0.1,14.0,0.0\n")
        ...     ttc.files.read_motion_table(file).theta_rad.tolist()
        [0.0, 0.1]
    """
    path = Path(path)
    if not path.is_file():
        raise MotionError(f"{path}: no such file; give a .csv or .parquet table of the shaft's motion")
    if path.suffix == ".csv":
        table = _read_csv(path)
    elif path.suffix == ".parquet":
        table = _read_parquet(path)
    else:
        raise MotionError(f"{path}: a table of motion must be .csv or .parquet")
    if table.num_rows == 0:
        raise MotionError(f"{path}: no rows below the header; give at least one sample")
    columns: dict[str, FloatArray] = {}
    for name in table.column_names:
        values = table[name].to_numpy().astype(np.float64, copy=False)
        if not np.isfinite(values).all():
            row = int(np.flatnonzero(~np.isfinite(values))[0])
            raise _bad_cell(path) or MotionError(f"{path}, row {row + 1}: {name} is {values[row]}; {_FIX}")
        columns[name] = values
    time = columns.get(_TIME)
    if time is not None and not (np.diff(time) > 0).all():
        row = int(np.flatnonzero(np.diff(time) <= 0)[0])
        raise MotionError(f"{path}, row {row + 2}: time_s does not increase; sort the rows by time")
    return MotionTable(columns["theta_rad"], columns["omega_rad_s"], columns["alpha_rad_s2"], time)


def looks_like_degrees(theta_rad: FloatArray) -> bool:
    """Return whether angles (n,) cover 360 in steps too coarse for radians: degrees in a column of radians."""
    spans_a_turn = 300.0 < np.ptp(theta_rad) <= 361.0 and theta_rad.min() >= -181.0 and theta_rad.max() <= 361.0
    return bool(spans_a_turn and np.median(np.abs(np.diff(theta_rad))) > 0.2)


_FIX = "give a finite number"


def _wanted(path: Path, there: list[str]) -> list[str]:
    """Select the columns to read; an error names missing ones."""
    missing = [name for name in _NEEDED if name not in there]
    if missing:
        raise MotionError(f"{path}: column {', '.join(missing)} is missing; available: {', '.join(there) or 'none'}")
    wanted = [*_NEEDED, *([_TIME] if _TIME in there else [])]
    for name in wanted:
        if there.count(name) > 1:
            raise MotionError(f"{path}: there are {there.count(name)} columns {name}; leave one")
    return wanted


def _header(path: Path) -> list[str]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            return [name.strip() for name in next(csv.reader(file), [])]
    except (UnicodeDecodeError, csv.Error) as error:
        raise MotionError(f"{path}: not a CSV file of text; give one with a header line") from error


def _read_csv(path: Path) -> pyarrow.Table:
    import pyarrow
    import pyarrow.csv

    names = _header(path)
    wanted = _wanted(path, names)
    try:
        return pyarrow.csv.read_csv(
            path,
            read_options=pyarrow.csv.ReadOptions(column_names=names, skip_rows=1),
            convert_options=pyarrow.csv.ConvertOptions(
                include_columns=wanted, column_types=dict.fromkeys(wanted, pyarrow.float64())
            ),
        )
    except pyarrow.ArrowInvalid as error:
        # Slow but exact: search the cell and its line only for the message.
        raise _bad_cell(path) or MotionError(f"{path}: not a table: {error}") from error


def _bad_cell(path: Path) -> MotionError | None:
    """Find the first cell of a CSV file that is not a finite number, and its line."""
    if path.suffix != ".csv":
        return None
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        reader = csv.reader(file)
        names = [name.strip() for name in next(reader)]
        wanted = [(name, names.index(name)) for name in _wanted(path, names)]
        while True:
            try:
                row = next(reader)
            except StopIteration:
                return None
            except csv.Error as error:
                return MotionError(f"{path}, line {reader.line_num}: {error}; {_FIX}")
            if not row:
                continue
            for name, place in wanted:
                text = row[place].strip() if place < len(row) else ""
                try:
                    good = math.isfinite(float(text))
                except ValueError:
                    good = False
                if not good:
                    return MotionError(f"{path}, line {reader.line_num}: {name} is '{text}'; {_FIX}")
            if len(row) != len(names):
                return MotionError(f"{path}, line {reader.line_num}: {len(row)} cells, but the header has {len(names)}")


def _read_parquet(path: Path) -> pyarrow.Table:
    import pyarrow
    import pyarrow.parquet

    try:
        wanted = _wanted(path, pyarrow.parquet.read_schema(path).names)
        table = pyarrow.parquet.read_table(path, columns=wanted)
        return table.cast(pyarrow.schema([(name, pyarrow.float64()) for name in wanted]))
    except (pyarrow.ArrowException, OSError) as error:
        first = str(error).splitlines()[0]
        raise MotionError(f"{path}: not a Parquet table of numbers: {first}") from error


def _column(values: FloatArray) -> pyarrow.Array:
    """Make a column without a copy; `pyarrow.array` would import pandas where it is installed."""
    import pyarrow

    floats = np.ascontiguousarray(values, np.float64)
    return pyarrow.Array.from_buffers(pyarrow.float64(), floats.size, [None, pyarrow.py_buffer(floats)])


def write_table(
    path: str | Path, columns: Mapping[str, FloatArray], progress: Callable[[int], object] | None = None
) -> None:
    """Write equally long columns as .csv (shortest text that reads back to the same float) or .parquet.

    Args:
        path: file to write; it appears when it is complete.
        columns: (n,) arrays by name.
        progress: called with the number of rows just written.

    Raises:
        OutputError: for another suffix, or a place that cannot be written.

    Examples:
        >>> import pathlib, tempfile, numpy as np, textile_twin_core as ttc
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     file = pathlib.Path(folder, "torque.csv")
        ...     ttc.files.write_table(file, {"balancing_torque_Nm": np.array([1.5, 2.0])})
        ...     file.read_text().split()
        ['balancing_torque_Nm', '1.5', '2']
    """
    path = Path(path)
    if path.suffix not in TABLE_SUFFIXES:
        raise OutputError(f"output {path}: a table must end in {' or '.join(TABLE_SUFFIXES)}")
    if path.suffix == ".csv" and find_spec("pyarrow") is None:
        with staged(path) as partial, partial.open("w", encoding="utf-8") as file:
            file.write(",".join(columns) + "\n")
            rows = zip(*(np.asarray(values).tolist() for values in columns.values()), strict=True)
            file.writelines(",".join(map(repr, row)) + "\n" for row in rows)
        return
    import pyarrow
    import pyarrow.csv
    import pyarrow.parquet

    with staged(path) as partial:
        table = pyarrow.table({name: _column(values) for name, values in columns.items()})
        if path.suffix == ".parquet":
            pyarrow.parquet.write_table(table, partial)
            return
        with pyarrow.OSFile(str(partial), "wb") as file:
            file.write((",".join(table.column_names) + "\n").encode())
            for start in range(0, table.num_rows, _ROWS):
                part = table.slice(start, _ROWS)
                pyarrow.csv.write_csv(part, file, pyarrow.csv.WriteOptions(include_header=False))
                if progress is not None:
                    progress(part.num_rows)
