"""Times of a log in several columns: seconds and their parts, a clock for each channel, steps instead of times."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.log_cells import LogTable
from textile_twin_core.recordings.log_columns import choose
from textile_twin_core.recordings.log_mapping import Clock
from textile_twin_core.recordings.log_time import DATED, EPOCHS_S, time_seconds
from textile_twin_core.recordings.log_units import unit_in_name

_PARTS = {"ns": 1e9, "us": 1e6, "ms": 1e3}
"""Parts of a second."""
_PART_WORDS = {
    "ns": r"nano|(^|[^a-z])n_?sec|(^|[^a-z])ns([^a-z]|$)",
    "us": r"micro|(^|[^a-z])[uµμ]_?sec|(^|[^a-z])[uµμ]s([^a-z]|$)",
    "ms": r"milli|(^|[^a-z])m_?sec|(^|[^a-z])ms([^a-z]|$)",
}
_STEPS = re.compile(
    r"(^|[^a-z])(dt|d_t|delta|interval|elapsed since last)([^a-z]|$)|diff|schritt|[Δ∆]|step", re.IGNORECASE
)
_FULL = 0.5
"""Share of a second that the largest of its parts must exceed."""
_OVERLAP = 0.5
"""Least overlap of two columns of times of one clock, as a share of the shorter span."""


def part_unit(name: str, values: FloatArray) -> str:
    """Unit of a column of parts of a second, by its name, else by its largest value; '' for other columns."""
    finite = values[np.isfinite(values)]
    if not finite.size or finite.min() < 0.0 or np.any(finite != np.rint(finite)):
        return ""
    largest = float(finite.max())
    named = next((unit for unit, words in _PART_WORDS.items() if re.search(words, name.lower())), "")
    if named:
        return named if largest < _PARTS[named] else ""
    return next((unit for unit, parts in reversed(_PARTS.items()) if _FULL * parts <= largest < parts), "")


def find_fraction(table: LogTable, name: str, unit: str, others: Sequence[str] = ()) -> tuple[str, str]:
    """Find the column of parts of a second beside one of whole seconds, and its unit; two empty texts without one.

    The whole seconds repeat over several rows; the parts fall only where the seconds rise, and their sum rises.

    Args:
        table: the log. name: of the column of seconds. unit: of its values, '' if unknown.
        others: columns with another meaning.
    """
    seconds = table[name]
    finite = seconds[np.isfinite(seconds)]
    known = name in table.dated or unit == "s" or (not unit and finite.size > 0 and _is_epoch(finite))
    if not known and not re.search(r"(^|[^a-z])secs?([^a-z]|$)", name.lower()):
        return "", ""
    if not finite.size or np.any(finite != np.rint(finite)) or not np.any(np.diff(finite) == 0.0):
        return "", ""
    found = []
    for other, parts in table.items():
        unit_of_parts = "" if other == name or other in others or other in table.dated else part_unit(other, parts)
        if unit_of_parts and parts.size == seconds.size and _completes(seconds, parts, other):
            found.append((other, unit_of_parts))
    stem = _stem(name)
    near = [each for each in found if _stem(each[0]) == stem]
    return (near or found)[0] if len(near or found) == 1 else ("", "")


def _is_epoch(finite: FloatArray) -> bool:
    return bool(EPOCHS_S[0] <= float(np.median(finite)) <= EPOCHS_S[1])


def _stem(name: str) -> str:
    """Name of a column without its words for seconds or parts of them."""
    return re.sub(r"(nano|micro|milli)?_?(secs?|seconds?)|[num]?_?secs?|[\W_]+", "", name.lower())


def _completes(seconds: FloatArray, parts: FloatArray, name: str) -> bool:
    here = np.isfinite(seconds) & np.isfinite(parts)
    whole, rest = np.diff(seconds[here]), np.diff(parts[here])
    falls = rest < 0.0
    named = any(re.search(words, name.lower()) for words in _PART_WORDS.values())
    if whole.size < 2 or not (falls.any() or named):
        return False
    # A few rows may be out of order; in an unrelated column falls and rises do not match at all.
    return bool(np.mean(whole[falls] > 0.0) > 0.9 if falls.any() else True) and bool(
        np.mean(rest[whole == 0.0] >= 0.0) > 0.9
    )


def clock_in_front(table: LogTable, column: str) -> str:
    """Last rising column of times in front of a column; '' without one."""
    if column in table.times_of:
        return table.times_of[column]
    names = list(table)
    times = [name for name in names if name in table.dated or name in choose("time", names)]
    parts = {name: find_fraction(table, name, default_unit(table, name))[0] for name in times}
    before = [name for name in times if names.index(name) < names.index(column) and name not in parts.values()]
    before = [name for name in before if parts[name] or rises(table[name])]
    return before[-1] if before else ""


def rises(values: FloatArray) -> bool:
    """Return true if values rise in most steps and fall in few."""
    steps = np.diff(values[np.isfinite(values)])
    return steps.size > 1 and bool(np.mean(steps > 0.0) > 0.5 and np.mean(steps < 0.0) < 0.1)


def name_stem(name: str) -> str:
    """Name of a column without its unit and the number at its end, common to columns of the same kind."""
    bare = re.sub(r"[\[(].*?[\])]", "", name)
    return re.sub(r"[\W_]*\d*$", "", bare.strip()).lower()


def same_rows(table: LogTable, one: str, other: str) -> bool:
    """Return true if two columns of times are equal throughout."""
    return one == other or np.array_equal(table[one], table[other], equal_nan=True)


def one_clock(first: FloatArray, second: FloatArray) -> bool:
    """Return true if two columns of times count from the same moment: their spans overlap by half."""
    spans = [(float(np.nanmin(each)), float(np.nanmax(each))) for each in (first, second)]
    shorter = min(end - begin for begin, end in spans)
    both = min(end for _, end in spans) - max(begin for begin, _ in spans)
    return both >= _OVERLAP * shorter


def holds_steps(name: str, values: FloatArray) -> bool:
    """Return true if a column is named as a difference of times and does not rise."""
    finite = values[np.isfinite(values)]
    return bool(_STEPS.search(name)) and finite.size > 2 and bool(finite.min() >= 0.0) and not rises(finite)


def clock_seconds(table: LogTable, clock: Clock, raw: bool = False) -> tuple[FloatArray, Clock, str]:
    """Return seconds (n,) of a clock, the clock with its units, and their source in words.

    Raises RecordingError for a unit that is unknown or ambiguous, and for impossible times.
    """
    values, unit = table[clock.column], clock.unit or default_unit(table, clock.column)
    if unit == DATED and clock.column not in table.dated:
        raise RecordingError(f"column '{clock.column}' holds no dates or times of day; name its unit with --time-unit")
    if clock.steps:
        values = np.where(np.isfinite(values), np.nancumsum(values), np.nan)
    if clock.fraction:
        unit = unit or "s"
    seconds, unit, words = time_seconds(clock.column, unit, values, raw, bool(clock.fraction))
    if not clock.fraction:
        return seconds, replace(clock, unit=unit), words + ("; the sum of its steps" if clock.steps else "")
    parts = clock.fraction_unit or part_unit(clock.fraction, table[clock.fraction])
    if parts not in _PARTS:
        raise RecordingError(f"column '{clock.fraction}': no parts of a second; {', '.join(_PARTS)} are read")
    seconds = seconds + table[clock.fraction] / _PARTS[parts]
    return seconds, replace(clock, unit=unit, fraction_unit=parts), f"{words}, with '{clock.fraction}', {parts}"


def default_unit(table: LogTable, name: str) -> str:
    """Unit in the name of a column of times, or `DATED`."""
    return DATED if name in table.dated else unit_in_name(name)
