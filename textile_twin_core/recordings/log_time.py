"""Unit of a log's times: given by the user, by the header, or by the interval from row to row."""

from __future__ import annotations

import re

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.log_units import TIME_UNITS, unit_factor

DATED = "date"
"""Unit of columns that were dates, times of day or durations and are seconds after reading."""

_GUESSED = ("s", "ms", "us", "ns")
_INTERVALS_S = (5e-5, 2.0)
"""Shortest and longest interval of a machine's log; a rig that samples a pickup's voltage is faster."""
_RAW_INTERVALS_S = (1e-7, 2.0)
_TOO_SLOW_S = 0.5
"""Interval too slow to show a shaft: if another unit makes it a thousandth, that unit is meant."""
_LONG_S = 3600.0
EPOCHS_S = (9.4e8, 4.2e9)
"""Seconds since 1970 of the years 2000 to 2100."""
_SLOWEST_EPOCH_S = 60.0
_EXCEL_DAYS = (20_000.0, 80_000.0)
"""Excel's numbers of the days from 1954 to 2119; it counts from 30 December 1899."""
_EXCEL_1970 = 25569.0
_LATEST_S = 9.2e9
"""Nanoseconds since 1970 end in 2262."""
_COUNTS = re.compile(r"(^|[^a-z])(samples?|index|idx|rows?|zeilen?|lines?|nr|no|num|count|counter|n|i|k)([^a-z]|$)")
_ASK = "tell it: --time-unit {units}; or leave the column out with --rate HZ"


def time_seconds(
    name: str, unit: str, values: FloatArray, raw: bool = False, whole: bool = False
) -> tuple[FloatArray, str, str]:
    """Convert a column of times (n,) to seconds; return them, the unit, and its source in words.

    Args:
        name: of the column, for messages. unit: given or in the name, `DATED`, or empty if unknown.
        values: as logged, NaN where a cell is empty. raw: the log samples a voltage, so its interval may be very short.
        whole: the column is in whole seconds, with their parts in another column.

    Raises RecordingError for an unknown unit, for one that the values leave ambiguous, and for impossible times.
    """
    finite = values[np.isfinite(values)]
    if not finite.size:
        raise RecordingError(f"column '{name}': no time in it; name another with --time, or give --rate")
    if unit == DATED:
        taken, words = "s", "a date or a time of day"
    elif unit and whole:
        taken, words = unit, unit
    elif unit:
        taken, words = unit, unit + _objection(finite, unit, raw)
    else:
        taken, words = _guessed(name, finite, raw)
    factor = unit_factor(taken, TIME_UNITS)
    if factor is None:
        raise RecordingError(f"column '{name}': time in '{unit}'? there are: {', '.join(TIME_UNITS)}")
    if taken == "days" and _EXCEL_DAYS[0] <= float(finite[0]) <= _EXCEL_DAYS[1]:
        values, words = values - _EXCEL_1970, words.replace("days", "Excel's days", 1)
    seconds = values * factor
    latest = float(np.nanmax(np.abs(seconds)))
    if latest > _LATEST_S:
        raise RecordingError(f"column '{name}': {latest:.6g} s in the unit '{taken}' is no time; {_ask()}")
    return seconds, unit if unit == DATED else taken, words


def _objection(finite: FloatArray, unit: str, raw: bool) -> str:
    """Describe an implausible interval of the rows in a given unit; empty if it is plausible."""
    steps = np.diff(finite)
    steps = steps[steps > 0.0] * (unit_factor(unit, TIME_UNITS) or np.nan)
    step = float(np.median(steps)) if steps.size else np.nan
    fastest = _RAW_INTERVALS_S[0] if raw else _INTERVALS_S[0]
    if fastest <= step < _TOO_SLOW_S or np.isnan(step):
        return ""
    return f" ({step:.4g} s from row to row, at which no shaft is logged: if the unit is another, tell --time-unit)"


def same_clock(dated: FloatArray, timer: FloatArray) -> bool:
    """Return true if two columns (n,) in seconds, one of dates, agree to the coarsest step of the dates and 0.1 %."""
    here = np.isfinite(dated) & np.isfinite(timer)
    if np.count_nonzero(here) < 2:
        return False
    by_date, by_timer = dated[here] - dated[here][0], timer[here] - timer[here][0]
    most = float(np.abs(np.diff(by_date)).max()) + 1e-3 * float(np.abs(by_date).max())
    return bool(np.all(np.abs(by_date - by_timer) <= most))


def counts_rows(name: str, values: FloatArray) -> bool:
    """Return true if an evenly rising column, without a name of a time, is a count of rows."""
    finite = values[np.isfinite(values)][:10_000]
    steps = np.unique(np.diff(finite))
    # Milliseconds since 1970 at 1 kHz rise by one, too.
    by_one = steps.size == 1 and float(steps[0]) == 1.0 and float(finite[0]) < EPOCHS_S[0]
    return bool(_COUNTS.search(name.lower())) or by_one


def _guessed(name: str, finite: FloatArray, raw: bool) -> tuple[str, str]:
    """Return the only unit that fits the values, and its source. Raises RecordingError if several or none fit."""
    steps = np.diff(finite)
    steps = steps[steps > 0.0]
    if not steps.size:
        raise RecordingError(f"column '{name}' does not rise, so it holds no times; name another, or give --rate")
    step, size = float(np.median(steps)), float(np.median(np.abs(finite)))
    fastest, slowest = _RAW_INTERVALS_S if raw else _INTERVALS_S
    for unit in _GUESSED:
        scale = TIME_UNITS[unit]
        if EPOCHS_S[0] <= size * scale <= EPOCHS_S[1] and step * scale <= _SLOWEST_EPOCH_S:
            return unit, f"{unit} since 1970 (taken for granted)"
    if _EXCEL_DAYS[0] <= size <= _EXCEL_DAYS[1] and step < fastest <= step * TIME_UNITS["days"] <= slowest:
        return "days", "days since 1900 (taken for granted)"
    fits = [unit for unit in _GUESSED if fastest <= step * TIME_UNITS[unit] <= slowest * (1.0 + 1e-9)]
    if len(fits) == 1:
        return fits[0], f"{fits[0]} (taken for granted: {step * TIME_UNITS[fits[0]] * 1e3:.4g} ms from row to row)"
    if len(fits) > 1 and not raw:
        slower, quicker = fits[0], fits[1]
        whole = bool(np.all(finite == np.rint(finite)))
        # A count of rows has steps of one; slow rows may still be in seconds, unless the log is hours long.
        long = step > 1.0 and float(np.ptp(finite)) > _LONG_S if slower == "s" else True
        if whole and long and step * TIME_UNITS[slower] >= _TOO_SLOW_S:
            taken = step * TIME_UNITS[quicker] * 1e3
            return quicker, f"{quicker} (taken for granted: {taken:.4g} ms from row to row)"
    if len(fits) > 1 and raw and not np.all(finite == np.rint(finite)) and "s" in fits:
        return "s", "s (taken for granted)"
    may = " or ".join(fits) if fits else "none of " + ", ".join(_GUESSED)
    raise RecordingError(
        f"column '{name}': its header tells no unit, and by its steps of {step:.6g} it may be {may}"
        f"{', or a count of rows' if step == 1.0 else ''}; {_ask()}"
    )


def _ask() -> str:
    return _ASK.format(units=", ".join(TIME_UNITS))
