"""Conversion of the cells of a log to float64; columns that are not numbers are listed with the reason."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.recordings.log_dates import one_form
from textile_twin_core.recordings.log_dialect import EMPTY
from textile_twin_core.recordings.log_mapping import LongForm, TextTable
from textile_twin_core.recordings.log_thousands import DOUBT, may_have_thousands, without_thousands

_DAY_S = 86400.0
_MOST_WORDS, _MOST_BAD = 0.5, 0.01
"""A column with a larger share of words, or of other cells that are no numbers, is text."""
_NUMBER = r"^[+-]?([0-9]+([.][0-9]*)?|[.][0-9]+)([eE][+-]?[0-9]+)?$"
_CLOCK = r"^(?P<h>[0-9]{1,2}):(?P<m>[0-9]{2}):(?P<s>[0-9]{2}(?:[.][0-9]+)?)$"
_DATE_ALONE = r"^([0-9]{2}\.[0-9]{2}\.[0-9]{4}|[0-9]{4}[/-][0-9]{2}[/-][0-9]{2})$"


@dataclass(eq=False, repr=False)
class LogTable(dict[str, FloatArray]):
    """Columns by name, float64 (n,), NaN where a cell is empty or no number.

    dated: columns that were dates, times of day or durations, now seconds. left_out: columns without numbers, and their
    content. bad: by column the first cell that is no number, and the number of such cells; they are NaN, and with many
    of them the column is left out. times_of: by column the column of its times, if a log has several. signals: columns
    of a log in long form, which have no number in the rows of others. text: form of a text table. day_first: true if
    the day stands first in its dates, None if the dates are unambiguous.
    """

    dated: set[str] = field(default_factory=set)
    left_out: dict[str, str] = field(default_factory=dict)
    bad: dict[str, tuple[str, int]] = field(default_factory=dict)
    times_of: dict[str, str] = field(default_factory=dict)
    signals: set[str] = field(default_factory=set)
    long_form: LongForm | None = None
    text: TextTable | None = None
    day_first: bool | None = None

    def rows(self, here: BoolArray) -> LogTable:
        """Return the same columns with the rows of a mask (n,)."""
        return self.with_columns({name: values[here] for name, values in self.items() if values.size == here.size})

    def with_columns(self, columns: Mapping[str, FloatArray]) -> LogTable:
        """Return a table of other columns, with the properties of those that were read."""
        taken = replace(self)
        taken.update(columns)
        return taken


def numeric(columns: Mapping[str, Any], decimal: str = ".", day_first: bool | None = None) -> LogTable:
    """Convert Arrow columns to numbers. Dates become seconds since 1970, times of day seconds continued past midnight.

    A column of dates beside one of times of day is added to it. decimal: sign of numbers in text.
    day_first: for dates such as 03/04/2026; None if the cells show it.
    """
    from pyarrow import types

    out = LogTable()
    days: dict[str, FloatArray] = {}
    clocks: dict[str, FloatArray] = {}
    for name, written in columns.items():
        kind = written.type
        if types.is_string(kind) or types.is_large_string(kind):
            _text(name, written, decimal, out, days, clocks, day_first)
        elif types.is_date(kind):
            days[name] = _float(written.cast("timestamp[ns]").cast("int64")) * 1e-9
        elif types.is_time(kind):
            clocks[name] = _float(written.cast("time64[ns]").cast("int64")) * 1e-9
        elif types.is_timestamp(kind) or types.is_duration(kind):
            unit = "timestamp[ns]" if types.is_timestamp(kind) else "duration[ns]"
            out[name] = _float(written.cast(unit).cast("int64")) * 1e-9
            out.dated.add(name)
        elif types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind):
            out[name] = _float(written)
        else:
            out.left_out[name] = "nothing" if types.is_null(kind) else f"values of the kind {kind}"
    _join(out, days, clocks)
    return out


def _join(out: LogTable, days: Mapping[str, FloatArray], clocks: Mapping[str, FloatArray]) -> None:
    """Add columns of dates and of times of day to the output, as their sum if there is one of each."""
    together = len(days) == len(clocks) == 1
    for name, seconds in clocks.items():
        out[name] = seconds + next(iter(days.values())) if together else _past_midnight(seconds)
        out.dated.add(name)
    for name in days:
        out.left_out[name] = f"dates, which are added to '{next(iter(clocks))}'" if together else "dates without a time"


def _past_midnight(seconds: FloatArray) -> FloatArray:
    """Continue times of day past midnight, where they fall by more than half a day."""
    known = np.flatnonzero(np.isfinite(seconds))
    past = np.cumsum(np.diff(seconds[known], prepend=seconds[known][:1]) < -0.5 * _DAY_S)
    on = seconds.copy()
    on[known] += _DAY_S * past
    return on


def _text(
    name: str,
    written: Any,
    decimal: str,
    out: LogTable,
    days: dict[str, FloatArray],
    clocks: dict[str, FloatArray],
    day_first: bool | None,
) -> None:
    """Convert a column of text to dates, times of day or numbers, if all cells are (numbers: most, beside words)."""
    import pyarrow
    from pyarrow import compute

    cells = compute.utf8_trim_whitespace(written.combine_chunks())
    cells = compute.if_else(compute.is_in(cells, pyarrow.array(sorted(EMPTY), cells.type)), None, cells)
    filled = len(cells) - cells.null_count
    moments, doubt, seen = one_form(cells, day_first)
    out.day_first = seen if out.day_first is None else out.day_first
    if doubt:
        out.left_out[name] = doubt
        return
    pointed = compute.replace_substring(moments, ",", ".")
    if filled and _matches(pointed, _CLOCK) == filled:
        clocks[name] = _clock(pointed)
        return
    iso = compute.replace_substring_regex(moments, r"^(\d\d)\.(\d\d)\.(\d{4})", r"\3-\2-\1")
    iso = compute.replace_substring_regex(iso, r"^(\d{4})/(\d\d)/(\d\d)", r"\1-\2-\3")
    try:
        if filled and _matches(moments, _DATE_ALONE) == filled:
            days[name] = _float(iso.cast("date32").cast("timestamp[ns]").cast("int64")) * 1e-9
            return
        stamps = compute.replace_substring(iso, ",", ".").cast("timestamp[ns]")
        if filled:
            out[name] = _float(stamps.cast("int64")) * 1e-9
            out.dated.add(name)
            return
    except pyarrow.ArrowInvalid:
        pass
    # Some office programs write a minus sign, not a hyphen, before negative numbers.
    plain = without_thousands(compute.replace_substring(cells, "\u2212", "-"), decimal)
    if decimal == ",":
        plain = compute.replace_substring(plain, ",", ".")
    good = compute.match_substring_regex(plain, _NUMBER)
    bad = filled - int(compute.sum(good).as_py() or 0)
    if not filled:
        out.left_out[name] = "nothing"
        return
    if bad:
        out.bad[name] = (compute.filter(cells, compute.invert(good))[0].as_py(), bad)
    spoilt = bad - _matches(compute.filter(cells, compute.invert(good)), "^[^0-9]*$") if bad else 0
    if spoilt > _MOST_BAD * filled or bad > _MOST_WORDS * filled:
        out.left_out[name] = text_content(out.bad[name][0])
        return
    out[name] = _float(compute.if_else(good, plain, None).cast("float64"))


def text_content(cell: str, place: str = "") -> str:
    """Describe the content of a column of text by its first cell that is no number, and its place."""
    doubt = f": {DOUBT}" if may_have_thousands(cell) else ""
    return f"text ({place + ': ' if place else ''}'{cell[:30]}'{doubt})"


def _matches(cells: Any, pattern: str) -> int:
    from pyarrow import compute

    return int(compute.sum(compute.match_substring_regex(cells, pattern)).as_py() or 0)


def _clock(cells: Any) -> FloatArray:
    """Convert HH:MM:SS.sss to seconds of the day."""
    from pyarrow import compute

    parts = compute.extract_regex(cells, _CLOCK)
    hours, minutes, seconds = (_float(compute.struct_field(parts, [key]).cast("float64")) for key in "hms")
    return np.asarray(3600.0 * hours + 60.0 * minutes + seconds)


def _float(column: Any) -> FloatArray:
    # Nanoseconds since 1970 have more digits than a double; a quarter of a microsecond is lost.
    values = column.cast("float64", safe=False)
    combined = values.combine_chunks() if hasattr(values, "combine_chunks") else values
    return np.array(combined.to_numpy(zero_copy_only=False), dtype=np.float64)
