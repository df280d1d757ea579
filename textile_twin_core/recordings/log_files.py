"""Reader of tables of any logger: text, Parquet, MATLAB, HDF5, TDMS and MDF, each by its library."""

from __future__ import annotations

import gc
import logging
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import RecordingError, how_to_install
from textile_twin_core.recordings.log_mapping import LongForm, TextTable
from textile_twin_core.recordings.log_table import (
    Columns,
    Head,
    by_signal,
    distinct,
    find_long_form,
    to_numbers,
    with_unit,
)
from textile_twin_core.recordings.log_text import read_text
from textile_twin_core.recordings.log_units import choose

_HDF5 = (".h5", ".hdf5", ".hdf", ".he5")
_HDF5_MAGIC = b"\x89HDF"
_TIME = ("time", "t", "zeit", "timestamp", "timestamps")
_VALUES = ("values", "value", "data", "signals", "y")
"""Fields without a meaning of their own: the quantity is in the structure's name or label."""
_LABELS, _UNITS = ("label", "name"), ("unit", "units")
_UNIT_PROPERTIES = ("unit_string", "NI_UnitDescription", "Unit", "unit", "units", "Units")
_LOADMAT = """
import pickle, sys
from scipy.io import loadmat
try:
    result = loadmat(sys.argv[1], simplify_cells=True)
except Exception as error:
    result = str(error) or type(error).__name__
pickle.dump(result, sys.stdout.buffer, protocol=5)
"""


def read_table(
    path: Path,
    separator: str | None = None,
    decimal: str | None = None,
    table: str | None = None,
    text: TextTable | None = None,
    signals: LongForm | None = None,
) -> tuple[Columns, Head]:
    """Read the columns of a log as numbers, and the properties that its file states about them.

    Args:
        path: with an ending of `READERS`, .parquet, or text of any other name.
        separator, decimal: of a text table; detected by default.
        table: variable or group of the file that holds the log, if it has several.
        text: form of a text table, if it is known.
        signals: the columns of a log with a row for each value; with empty names for a column for each signal.

    Raises:
        RecordingError: The file is missing, empty, damaged or no table, or its library is not installed.
    """
    if path.is_dir():
        what = "a recording already" if any(path.glob("*.mcap")) or any(path.glob("*.db3")) else "a folder"
        raise RecordingError(f"{path}: is {what}; give the file that the logger wrote")
    if not path.is_file():
        raise RecordingError(f"{path}: no such file")
    if path.stat().st_size == 0:
        raise RecordingError(f"{path}: the file is empty")
    head, suffix = Head(), path.suffix.lower()
    if suffix in READERS:
        columns = READERS[suffix](path, table, head)
    else:
        line_of = None
        if suffix == ".parquet":
            written = _parquet(path)
        else:
            written, line_of = read_text(path, separator, decimal, text, head)
        form = find_long_form(written) if signals is None else signals if signals.signal else None
        written = written if form is None else by_signal(written, form, head)
        shape = head.text or TextTable("")
        columns = to_numbers(written, head, shape.decimal, shape.thousands)
        _note_bad_cells(head, line_of)
    if not columns:
        content = "; ".join(f"'{name}' holds {what}" for name, what in head.left_out.items())
        raise RecordingError(f"{path}: no column of numbers in it{': ' * bool(content)}{content}")
    if not any(map(len, columns.values())):
        raise RecordingError(f"{path}: no rows in it, only the names of its columns")
    return columns, head


def _note_bad_cells(head: Head, line_of: Any) -> None:
    for name, (cell, count) in head.bad.items():
        place = line_of(name, cell) if line_of is not None else ""
        if name in head.left_out:
            head.left_out[name] = f"text ({place + ': ' * bool(place)}'{cell[:30]}')"
        else:
            more = f"; {count} such cells count" if count > 1 else "; it counts"
            head.notes.append(f"{place or 'a row'}: column '{name}' has '{cell}', no number{more} as empty")


def _parquet(path: Path) -> dict[str, Any]:
    from pyarrow import ArrowInvalid, parquet

    try:
        table = parquet.read_table(path)
    except (ArrowInvalid, OSError) as error:
        raise RecordingError(f"{path}: not a Parquet file ({str(error).splitlines()[0]})") from error
    return dict(zip(table.column_names, table.columns, strict=True))


# MATLAB and HDF5: vectors, matrices and structures --------------------------------------------------------------------


def _structured(path: Path, table: str | None, head: Head) -> Columns:
    return _from_structures(path, _variables(path, path.suffix.lower() in _HDF5), table, head)


def _variables(path: Path, hdf5: bool) -> dict[str, Any]:
    """Read variables by name; structures and groups become dictionaries, cells become lists.

    Files before MATLAB 7.3 are read in a separate process, since scipy's reader may crash on a damaged one.
    """
    with path.open("rb") as file:
        begin = file.read(520)
    if hdf5 or begin.startswith(_HDF5_MAGIC) or begin[512:].startswith(_HDF5_MAGIC):
        try:
            import h5py
        except ImportError as error:
            raise RecordingError(f"{path}: an HDF5 file needs the package h5py; {how_to_install('h5py')}") from error
        try:
            with h5py.File(path, "r") as group:
                return _group(group, group)
        except (OSError, RuntimeError, KeyError, ValueError) as error:
            raise RecordingError(
                f"{path}: not an HDF5 file, or a damaged one ({' '.join(str(error).split())})"
            ) from error
    command = [sys.executable, "-P", "-c", _LOADMAT, str(path)]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    content: Any = f"its reader crashed, exit code {done.returncode}; save it again, or as CSV"
    if done.returncode == 0:
        content = pickle.loads(done.stdout)
    else:
        with suppress(ValueError):
            content = f"its reader crashed, {signal.Signals(-done.returncode).name}; save it again, or as CSV"
    if isinstance(content, str):
        raise RecordingError(f"{path}: not a MATLAB file, or a damaged one ({' '.join(content.split())})")
    return {name: value for name, value in content.items() if not name.startswith("__")}


def _group(group: Any, file: Any) -> dict[str, Any]:
    content: dict[str, Any] = {}
    for name, part in group.items():
        if name.startswith("#"):
            continue  # MATLAB stores the targets of cells and structures here
        value = _value(part, file)
        unit = next((_decode(part.attrs[key]) for key in _UNIT_PROPERTIES if key in part.attrs), "")
        content[with_unit(name, unit) if isinstance(value, np.ndarray) else name] = value
    return content


def _value(part: Any, file: Any) -> Any:
    if hasattr(part, "items"):
        return _group(part, file)
    kind = _decode(part.attrs.get("MATLAB_class", ""))
    if part.dtype.names:
        return {name: np.asarray(part[name]) for name in part.dtype.names}
    if part.dtype.hasobject and part.dtype.metadata and "ref" in part.dtype.metadata:
        parts = [_value(file[each], file) for each in np.asarray(part).ravel()]
        return parts[0] if len(parts) == 1 else parts
    values = np.asarray(part[()])
    if kind == "char":
        return "".join(map(chr, values.ravel().tolist()))
    if values.dtype.kind in "SO" and values.ndim == 0:
        return _decode(values[()])
    # MATLAB stores columns first, and a vector as a row or column of a matrix.
    return np.squeeze(values.T) if kind or (values.ndim == 2 and 1 in values.shape) else values


def _decode(value: Any) -> str:
    value = value[0] if isinstance(value, np.ndarray) and value.size else value
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _from_structures(path: Path, content: dict[str, Any], table: str | None, head: Head) -> Columns:
    """Convert variables to columns: vectors, columns of matrices as `q_1`, structures with their times.

    Names of fields are joined by points. Vectors shorter than the others go to `head.left_out`.
    """
    if table is not None:
        if table not in content:
            raise RecordingError(f"{path}: no variable '{table}'; available: {', '.join(content) or 'none'}")
        content = {table: content[table]}
    fields: tuple[str, ...] = ()
    if len(content) == 1 and isinstance(next(iter(content.values())), dict):
        (content,), fields = content.values(), _VALUES
    columns: Columns = {}
    matrices: dict[str, FloatArray] = {}
    _take(content, "", "", columns, matrices, head, fields)
    if not columns and len(matrices) > 1:
        raise RecordingError(
            f"{path}: which matrix holds the log? available: {', '.join(matrices)}; name one with --table"
        )
    if not columns and not matrices:
        return {}
    if not columns:
        name, matrix = next(iter(matrices.items()))
        return _matrix_columns("column", matrix if matrix.shape[0] >= matrix.shape[1] else matrix.T)
    lengths = {values.size for values in columns.values()}
    for name, matrix in matrices.items():
        rows = [axis for axis in (0, 1) if matrix.shape[axis] in lengths]
        if not rows:
            shape = " x ".join(map(str, matrix.shape))
            head.left_out[name] = f"a matrix of {shape}, of which no side has as many values as a vector"
            head.times_of.pop(name, None)
            continue
        for column, values in _matrix_columns(name, matrix if rows[0] == 0 else matrix.T).items():
            columns[distinct(column, columns)] = values
            if name in head.times_of:
                head.times_of[column] = head.times_of[name]
        head.times_of.pop(name, None)
    return _as_long(columns, head)


def _take(
    content: Mapping[str, Any],
    above: str,
    time: str,
    columns: Columns,
    matrices: dict[str, FloatArray],
    head: Head,
    fields: tuple[str, ...] = _VALUES,
) -> None:
    """Take the vectors and matrices of a structure, under names that begin with the structure's name.

    fields: names without a meaning of their own; empty for a file's variables.
    """
    own = next((key for key in content if key.lower().partition(" [")[0] in _TIME and _is_array(content[key], 1)), None)
    if own is not None:
        time = distinct(own, columns)
        columns[time] = np.asarray(content[own], dtype=np.float64)
        head.times_of[time] = time
    label = next((str(content[key]) for key in _LABELS if isinstance(content.get(key), str) and content[key]), "")
    unit = next((str(content[key]) for key in _UNITS if isinstance(content.get(key), str) and content[key]), "")
    for key, value in content.items():
        plain = key.lower() in fields
        name = (label or above or key) if plain else f"{above}.{key}" if above else key
        for each, part in _parts(name, value):
            if isinstance(part, dict):
                _take(part, each, time, columns, matrices, head)
            elif key != own and (_is_array(part, 1) or _is_array(part, 2)):
                named = f"{each} [{unit}]" if plain and unit else each
                named = distinct(named, {**columns, **matrices})
                into: dict[str, FloatArray] = columns if part.ndim == 1 else matrices
                into[named] = np.asarray(part, dtype=np.float64)
                if time:
                    head.times_of[named] = time
            elif key != own and isinstance(part, np.ndarray) and part.size > 1:
                head.left_out[each] = f"values of the kind {part.dtype} and the shape {part.shape}"


def _parts(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield a value, or each structure of an array with its number if there are several."""
    several = isinstance(value, list) or (isinstance(value, np.ndarray) and value.ndim > 0)
    if several and len(value) and all(isinstance(part, dict) for part in value):
        yield from ((name if len(value) == 1 else f"{name}_{k}", part) for k, part in enumerate(value, 1))
    else:
        yield name, value


def _as_long(columns: Columns, head: Head) -> Columns:
    """Keep columns as long as the longest or as their own times, and merge equal times into one column."""
    longest = max(values.size for values in columns.values())
    timed = {name for name, time in head.times_of.items() if columns[name].size == columns[time].size}
    short = {name: values.size for name, values in columns.items() if values.size < longest and name not in timed}
    first = next(iter(head.times_of.values()), "")
    same = {time for time in head.times_of.values() if time != first and np.array_equal(columns[time], columns[first])}
    head.left_out |= {name: f"{size} values, where others have {longest}" for name, size in short.items()}
    kept = {name: values for name, values in columns.items() if name not in short and name not in same}
    head.times_of = {name: first if its in same else its for name, its in head.times_of.items() if name in kept}
    return kept


def _matrix_columns(name: str, matrix: FloatArray) -> Columns:
    return {f"{name}_{k + 1}": np.ascontiguousarray(matrix[:, k], dtype=np.float64) for k in range(matrix.shape[1])}


def _is_array(value: Any, axes: int) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.ndim == axes and min(value.shape) > 1


# TDMS and MDF ---------------------------------------------------------------------------------------------------------


def _measured(path: Path, table: str | None, head: Head) -> Columns:
    """Read the channels of a measuring program's file, each with the times of its group."""
    for name in ("asammdf", "canmatrix", "nptdms"):  # their log lines repeat the error
        logging.getLogger(name).setLevel(logging.CRITICAL)
    library = "nptdms" if path.suffix.lower() == ".tdms" else "asammdf"
    words = ""
    with _without_words_of_its_end():
        try:
            columns = _tdms(path, table, head) if library == "nptdms" else _mdf(path, table, head)
        except ImportError:
            words = f"needs the package {library}; {how_to_install(library)}"
        except RecordingError:
            raise
        except Exception as error:  # each of these libraries has its own errors
            words = f"cannot be read, it may be damaged ({' '.join(str(error).split())[:200] or type(error).__name__})"
    if words:
        raise RecordingError(f"{path}: {words}")
    return columns


@contextmanager
def _without_words_of_its_end() -> Iterator[None]:
    """Suppress the second error of a failed reader when it is deleted, which Python would print."""
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        yield
    finally:
        gc.collect()
        sys.unraisablehook = hook


def _tdms(path: Path, table: str | None, head: Head) -> Columns:
    from nptdms import TdmsFile

    columns: Columns = {}
    file = TdmsFile.read(path)
    for group in _groups(path, {group.name: group for group in file.groups()}, table):
        channels = [each for each in group.channels() if len(each) and each.dtype.kind in "iufM"]
        times = choose("time", [each.name for each in channels])
        names = {}
        for channel in channels:
            unit = next((str(channel.properties[key]) for key in _UNIT_PROPERTIES if channel.properties.get(key)), "")
            name = names[channel.name] = distinct(with_unit(channel.name, unit), columns)
            values = np.asarray(channel[:])
            if values.dtype.kind == "M":
                values = values.astype("datetime64[ns]").astype(np.int64) * 1e-9
                head.dated.add(name)
            columns[name] = values.astype(np.float64)
            step = float(channel.properties.get("wf_increment", 0.0))
            if not times and step > 0.0:
                offset = float(channel.properties.get("wf_start_offset", 0.0))
                since = offset + step * np.arange(values.size, dtype=np.float64)
                _put_times(columns, head, name, since, channel.properties.get("wf_start_time"))
        if len(times) == 1:
            head.times_of |= {name: names[times[0]] for channel, name in names.items() if channel != times[0]}
    return columns


def _mdf(path: Path, table: str | None, head: Head) -> Columns:
    from asammdf import MDF

    columns: Columns = {}
    with MDF(path) as file:
        listed: list[Any] = list(file.groups)
        groups = {getattr(g.channel_group, "acq_name", "") or f"group {k + 1}": k for k, g in enumerate(listed)}
        for k in _groups(path, groups, table):
            for j, channel in enumerate(file.groups[k].channels):
                if j == file.masters_db.get(k):
                    continue
                read = file.get(group=k, index=j, ignore_invalidation_bits=True)
                values = np.asarray(read.samples)
                if values.dtype.kind not in "iuf" or values.ndim != 1 or not values.size:
                    head.left_out[channel.name] = "no numbers"
                    continue
                name = distinct(with_unit(channel.name, read.unit), columns)
                columns[name] = values.astype(np.float64)
                if read.invalidation_bits is not None:  # what a logger writes before a bus sends the first value
                    columns[name][np.asarray(read.invalidation_bits, np.bool_)] = np.nan
                _put_times(columns, head, name, np.asarray(read.timestamps), file.start_time)
    return columns


def _groups(path: Path, groups: dict[str, Any], table: str | None) -> list[Any]:
    """Return the group of a name, or all groups. Raises RecordingError."""
    if table is None:
        return list(groups.values())
    if table not in groups:
        raise RecordingError(f"{path}: no group '{table}'; available: {', '.join(groups) or 'none'}")
    return [groups[table]]


def _put_times(columns: Columns, head: Head, name: str, since: FloatArray, start: Any) -> None:
    """Assign a column its times: an equal column of times, otherwise a new one."""
    epoch_s = 0.0
    if isinstance(start, np.datetime64):
        epoch_s = float(start.astype("datetime64[us]").astype(np.int64)) * 1e-6
    elif start is not None:
        epoch_s = float(start.timestamp())
    seconds = np.asarray(since, dtype=np.float64) + epoch_s
    known = next((time for time in set(head.times_of.values()) if np.array_equal(columns[time], seconds)), None)
    if known is None:
        known = distinct("time [s]", columns)
        columns[known] = seconds
        if start is not None:
            head.dated.add(known)
    head.times_of[name] = known


READERS: dict[str, Callable[[Path, str | None, Head], Columns]] = {
    **dict.fromkeys((".mat", *_HDF5), _structured),
    **dict.fromkeys((".tdms", ".mf4", ".mdf"), _measured),
}
"""Readers of files of numbers by the ending of their names: of a path, a variable or group, and the head to fill."""
