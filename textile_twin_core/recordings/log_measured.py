"""Files of measuring programs: TDMS of LabVIEW, MDF4 of vehicle and test-rig recorders."""

from __future__ import annotations

import gc
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from textile_twin_core.errors import RecordingError, how_to_install
from textile_twin_core.recordings.log_cells import LogTable
from textile_twin_core.recordings.log_columns import choose

MEASURED_SUFFIXES = (".tdms", ".mf4", ".mdf")
_UNITS = ("unit_string", "NI_UnitDescription", "Unit", "unit")


def read_measured(path: Path, table: str | None) -> LogTable:
    """Read columns by name, float64 (n,), each with the times of its group.

    Args:
        path: of the file. table: the group of channels to read, if several have the same names.

    Raises RecordingError for a damaged file, one without such a group, or a missing package.
    """
    for name in ("asammdf", "canmatrix", "nptdms"):  # their log lines repeat the error
        logging.getLogger(name).setLevel(logging.CRITICAL)
    library = "nptdms" if path.suffix.lower() == ".tdms" else "asammdf"
    words = ""
    with _without_words_of_its_end():
        try:
            log = _tdms(path, table) if library == "nptdms" else _mdf(path, table)
        except ImportError:
            words = f"needs the package {library}; {how_to_install(library)}"
        except RecordingError:
            raise
        except Exception as error:  # each of these libraries has its own errors
            words = f"cannot be read, it may be damaged ({' '.join(str(error).split())[:200] or type(error).__name__})"
    if words:
        raise RecordingError(f"{path}: {words}")
    if not log:
        raise RecordingError(f"{path}: no channel of numbers in it")
    return log


@contextmanager
def _without_words_of_its_end() -> Iterator[None]:
    """Suppress the second error of a failed reader when it is deleted, which Python would print."""
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        yield
    finally:
        gc.collect()
        sys.unraisablehook = hook


def _tdms(path: Path, table: str | None) -> LogTable:
    from nptdms import TdmsFile

    log = LogTable()
    file = TdmsFile.read(path)
    for group in _named(path, {group.name: group for group in file.groups()}, table):
        channels = [each for each in group.channels() if len(each) and each.dtype.kind in "iufM"]
        times = choose("time", [each.name for each in channels])
        names = {}
        for channel in channels:
            unit = next((str(channel.properties[key]) for key in _UNITS if channel.properties.get(key)), "")
            name = names[channel.name] = _distinct(_with_unit(channel.name, unit), log)
            values = np.asarray(channel[:])
            if values.dtype.kind == "M":
                values = values.astype("datetime64[ns]").astype(np.int64) * 1e-9
                log.dated.add(name)
            log[name] = values.astype(np.float64)
            step = float(channel.properties.get("wf_increment", 0.0))
            if not times and step > 0.0:
                since = float(channel.properties.get("wf_start_offset", 0.0)) + step * np.arange(values.size)
                _put_times(log, name, since, channel.properties.get("wf_start_time"))
        if len(times) == 1:
            log.times_of |= {name: names[times[0]] for channel, name in names.items() if channel != times[0]}
    return log


def _mdf(path: Path, table: str | None) -> LogTable:
    from asammdf import MDF

    log = LogTable()
    with MDF(path) as file:
        groups = {_group_name(group, k): k for k, group in enumerate(file.groups)}
        for k in _named(path, groups, table):
            for j, channel in enumerate(file.groups[k].channels):
                if j == file.masters_db.get(k):
                    continue
                signal = file.get(group=k, index=j, ignore_invalidation_bits=True)
                values = np.asarray(signal.samples)
                if values.dtype.kind not in "iuf" or values.ndim != 1 or not values.size:
                    log.left_out[channel.name] = "no numbers"
                    continue
                name = _distinct(_with_unit(channel.name, signal.unit), log)
                log[name] = values.astype(np.float64)
                _put_times(log, name, np.asarray(signal.timestamps), file.start_time)
    return log


def _group_name(group: Any, number: int) -> str:
    acquired = getattr(group.channel_group, "acq_name", "") or ""
    return acquired or f"group {number + 1}"


def _named(path: Path, groups: dict[str, Any], table: str | None) -> list[Any]:
    """Return the group of a name, or all groups. Raises RecordingError."""
    if table is None:
        return list(groups.values())
    if table not in groups:
        raise RecordingError(f"{path}: no group '{table}'; there are: {', '.join(groups) or 'none'}")
    return [groups[table]]


def _put_times(log: LogTable, name: str, since: Any, start: Any) -> None:
    """Assign a column its times: an equal column of times, otherwise a new one."""
    seconds = np.asarray(since, dtype=np.float64) + _epoch(start)
    known = next((time for time in set(log.times_of.values()) if np.array_equal(log[time], seconds)), None)
    if known is None:
        known = _distinct("time [s]", log)
        log[known] = seconds
        if start is not None:
            log.dated.add(known)
    log.times_of[name] = known


def _epoch(start: Any) -> float:
    """Seconds since 1970 of a moment of numpy or Python; 0 without one."""
    if start is None:
        return 0.0
    if isinstance(start, np.datetime64):
        return float(start.astype("datetime64[us]").astype(np.int64)) * 1e-6
    return float(start.timestamp())


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit and "[" not in name and "(" not in name else name


def _distinct(name: str, log: LogTable) -> str:
    number = next(k for k in range(1, len(log) + 2) if (name if k == 1 else f"{name}_{k}") not in log)
    return name if number == 1 else f"{name}_{number}"
