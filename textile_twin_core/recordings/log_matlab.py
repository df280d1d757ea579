"""MATLAB files as columns: vectors, a matrix, and structures of Simulink and measuring programs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.log_cells import LogTable
from textile_twin_core.recordings.matlab_content import matlab_variables

_TIME = ("time", "t", "zeit", "timestamp", "timestamps")
_VALUES = ("values", "value", "data", "signals", "y")
"""Fields without a meaning of their own: the quantity is in the structure's name or label."""
_LABELS, _UNITS = ("label", "name"), ("unit", "units")
_KINDS = "iuf"


def read_matlab(path: Path, table: str | None) -> LogTable:
    """Read columns by name, float64 (n,): vectors of the file and of its structures, or columns of its only matrix.

    Names of fields are joined by points; times of a structure stay with its values.

    Args:
        path: of the file. table: the variable to read, when there are several.

    Raises RecordingError.
    """
    return from_structures(path, matlab_variables(path), table)


def from_structures(path: Path, content: dict[str, Any], table: str | None) -> LogTable:
    """Convert variables by name, arrays and nested dictionaries from readers of MATLAB and HDF5 files, to columns."""
    if table is not None:
        if table not in content:
            raise RecordingError(f"{path}: no variable '{table}'; there are: {', '.join(content) or 'none'}")
        content = {table: content[table]}
    fields = _VALUES if len(content) == 1 and isinstance(next(iter(content.values())), dict) else ()
    if fields:
        (content,) = content.values()
    log = LogTable()
    _take(content, "", "", log, fields)
    if log:
        return _as_long(log)
    matrices = {name: value for name, value in content.items() if _is_matrix(value)}
    if len(matrices) != 1:
        names = (
            ", ".join(matrices) or "none (a timetable or timeseries is read when it is saved as vectors or structure)"
        )
        raise RecordingError(f"{path}: which matrix holds the log? there are: {names}; name one with --table")
    (matrix,) = matrices.values()
    log.update(_columns("column", matrix if matrix.shape[0] >= matrix.shape[1] else matrix.T))
    return log


def _take(content: Mapping[str, Any], above: str, time: str, log: LogTable, fields: tuple[str, ...] = _VALUES) -> None:
    """Put the vectors of a structure into the log, under names that begin with the structure's name.

    fields: names without a meaning of their own; empty for a file's variables.
    """
    own = next((key for key in content if key.lower().partition(" [")[0] in _TIME and _is_vector(content[key])), None)
    if own is not None:
        time = _distinct(own, log)
        _put(time, content[own], time, log)
    label = next((str(content[key]) for key in _LABELS if isinstance(content.get(key), str) and content[key]), "")
    unit = next((f" [{content[key]}]" for key in _UNITS if isinstance(content.get(key), str) and content[key]), "")
    for key, value in content.items():
        plain = key.lower() in fields
        name = (label or above or key) if plain else f"{above}.{key}" if above else key
        for each, part in _parts(name, value):
            if isinstance(part, dict):
                _take(part, each, time, log)
            elif key != own and _is_vector(part):
                _put(_distinct(f"{each}{unit}" if plain else each, log), part, time, log)
            elif plain and _is_matrix(part):
                for column, values in _columns(each, part).items():
                    _put(_distinct(column, log), values, time, log)


def _parts(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield a value, or each structure of an array with its number if there are several."""
    several = isinstance(value, list) or (isinstance(value, np.ndarray) and value.ndim > 0)
    if several and len(value) and all(isinstance(part, dict) for part in value):
        yield from ((name if len(value) == 1 else f"{name}_{k}", part) for k, part in enumerate(value, 1))
    else:
        yield name, value


def _put(name: str, values: Any, time: str, log: LogTable) -> None:
    log[name] = np.asarray(values, dtype=np.float64)
    if time:
        log.times_of[name] = time


def _as_long(log: LogTable) -> LogTable:
    """Pad the columns to the longest, or to their own times, and merge equal times into one column."""
    longest = max(values.size for values in log.values())
    timed = {name for name, time in log.times_of.items() if log[name].size == log[time].size}
    short = {name: values.size for name, values in log.items() if values.size < longest and name not in timed}
    times = dict.fromkeys(log.times_of.values())
    first = next(iter(times), "")
    same = [time for time in times if time != first and np.array_equal(log[time], log[first])]
    kept = log.with_columns({name: values for name, values in log.items() if name not in {*short, *same}})
    kept.left_out = {name: f"{size} values, where others have {longest}" for name, size in short.items()}
    kept.times_of = {name: first if its in same else its for name, its in log.times_of.items() if name in kept}
    return kept


def _columns(name: str, matrix: FloatArray) -> dict[str, FloatArray]:
    return {f"{name}_{k + 1}": np.ascontiguousarray(matrix[:, k], dtype=np.float64) for k in range(matrix.shape[1])}


def _distinct(name: str, log: LogTable) -> str:
    number = next(k for k in range(1, len(log) + 2) if (name if k == 1 else f"{name}_{k}") not in log)
    return name if number == 1 else f"{name}_{number}"


def _is_vector(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in _KINDS and value.ndim == 1 and value.size > 1


def _is_matrix(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in _KINDS and value.ndim == 2 and min(value.shape) > 1
