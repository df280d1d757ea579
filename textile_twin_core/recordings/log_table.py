"""Columns of a log as numbers, and the properties that its file states or shows about them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.log_mapping import LongForm, TextTable

Columns = dict[str, FloatArray]
"""Columns by name, float64, NaN where a cell is empty or no number; a measuring program's may differ in length."""

EMPTY = ("", "nan", "NaN", "NAN", "null", "inf", "-inf")
"""Contents of a cell without a number."""
HOW = "2026-10-25 23:59:50.5 or 25.10.2026 23:59:50,5"
"""Forms in which any date can be read."""
_MOST_WORDS, _MOST_BAD = 0.5, 0.01
"""A column with a larger share of words, or of other cells that are no numbers, is text."""
_NUMBER = r"^[+-]?([0-9]+([.][0-9]*)?|[.][0-9]+)([eE][+-]?[0-9]+)?$"
_MOMENT = (
    r"^(?:(?P<a>[0-9]{1,4})(?P<mark>[-/.])(?P<b>[0-9]{1,2})[-/.](?P<c>[0-9]{1,4})(?:[T ,]+|$))?"
    r"(?:(?P<h>[0-9]{1,2}):(?P<m>[0-9]{2})(?::(?P<s>[0-9]{2})(?:[.,](?P<f>[0-9]+)|:(?P<ms>[0-9]{3}))?)?"
    r"(?P<half> ?[AaPp]\.?[Mm]\.?)?(?P<zone>Z|[+-][0-9]{2}:?[0-9]{2})?)?$"
)
_SIGNALS, _ROWS = 64, 8
"""The most signals of a log with a row for each value, and the fewest rows of each in the mean."""
_DAY_S = 86400.0
_MONTHS, _YEAR = 12, 1000


@dataclass
class Head:
    """Properties of the columns of a log.

    dated: columns that were dates, times of day or durations, now in seconds. left_out: columns without numbers, and
    their content. bad: by column the first cell that is no number, and the number of such cells. times_of: by column
    the column of its times, where the file states it. signals: columns of a log with a row for each value. long_form:
    its two columns. text: form of a text table. rate_hz: rows a second, where the file states them.
    notes: on skipped parts, for people.
    """

    dated: set[str] = field(default_factory=set)
    left_out: dict[str, str] = field(default_factory=dict)
    bad: dict[str, tuple[str, int]] = field(default_factory=dict)
    times_of: dict[str, str] = field(default_factory=dict)
    signals: set[str] = field(default_factory=set)
    long_form: LongForm | None = None
    text: TextTable | None = None
    day_first: bool | None = None
    rate_hz: float | None = None
    notes: list[str] = field(default_factory=list)


def distinct(name: str, names: Mapping[str, object] | set[str]) -> str:
    """Return the name, with a number if it is taken."""
    number = next(k for k in range(1, len(names) + 2) if (name if k == 1 else f"{name}_{k}") not in names)
    return name if number == 1 else f"{name}_{number}"


def with_unit(name: str, unit: str) -> str:
    """Append a unit in brackets to a name, unless it has brackets."""
    return f"{name} [{unit}]" if unit and "[" not in name and "(" not in name else name


def describe(columns: Mapping[str, FloatArray], head: Head | None = None) -> str:
    """List the columns with their ranges, and the content of those that are no numbers, for a person who chooses."""
    rows = []
    for name, values in columns.items():
        finite = values[np.isfinite(values)]
        rows.append(f"{name} ({f'{finite.min():.6g} .. {finite.max():.6g}' if finite.size else 'empty'})")
    return ", ".join([*rows, *(f"{name} ({what})" for name, what in (head.left_out if head else {}).items())])


def to_numbers(written: Mapping[str, Any], head: Head, decimal: str = ".", thousands: str = "") -> Columns:
    """Convert Arrow columns to numbers; dates become seconds since 1970, times of day seconds on past midnight.

    A column of dates beside one of times of day is added to it. Columns that are no numbers go to `head.left_out`.
    """
    from pyarrow import types

    out: Columns = {}
    days: Columns = {}
    clocks: Columns = {}
    for name, cells in written.items():
        kind = cells.type
        if types.is_string(kind) or types.is_large_string(kind):
            _text_column(name, cells.combine_chunks(), decimal, thousands, out, days, clocks, head)
        elif types.is_date(kind):
            days[name] = _float(cells.cast("timestamp[ns]").cast("int64")) * 1e-9
        elif types.is_time(kind):
            clocks[name] = _float(cells.cast("time64[ns]").cast("int64")) * 1e-9
        elif types.is_timestamp(kind) or types.is_duration(kind):
            moments = cells.cast("timestamp[ns]" if types.is_timestamp(kind) else "duration[ns]").cast("int64")
            out[name] = _float(moments) * 1e-9
            head.dated.add(name)
        elif types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind):
            out[name] = _float(cells)
        else:
            head.left_out[name] = "nothing" if types.is_null(kind) else f"values of the kind {kind}"
    together = len(days) == len(clocks) == 1
    for name, seconds in clocks.items():
        out[name] = seconds + next(iter(days.values())) if together else _past_midnight(seconds)
        head.dated.add(name)
    for name in days:
        added = f"dates, which are added to '{next(iter(clocks))}'" if together else "dates without a time"
        head.left_out[name] = added
    order = {name: k for k, name in enumerate(written)}
    return dict(sorted(out.items(), key=lambda item: order[item[0]]))


def _text_column(
    name: str, cells: Any, decimal: str, thousands: str, out: Columns, days: Columns, clocks: Columns, head: Head
) -> None:
    """Convert a column of text: dates, times of day, or numbers beside a few words."""
    import pyarrow
    from pyarrow import compute

    cells = compute.utf8_trim_whitespace(cells)
    cells = compute.if_else(compute.is_in(cells, pyarrow.array(EMPTY, cells.type)), None, cells)
    filled = len(cells) - cells.null_count
    if not filled:
        head.left_out[name] = "nothing"
        return
    if _read_moments(name, cells, filled, out, days, clocks, head) or name in head.left_out:
        return
    plain = compute.replace_substring(cells, "\u2212", "-")  # the minus sign of office programs
    if thousands:
        plain = compute.replace_substring(plain, thousands, "")
    if decimal == ",":
        plain = compute.replace_substring(plain, ",", ".")
    good = compute.match_substring_regex(plain, _NUMBER)
    others = compute.filter(cells, compute.invert(good)).drop_null()
    if len(others):
        head.bad[name] = (others[0].as_py(), len(others))
    spoilt = len(others) - int(compute.sum(compute.match_substring_regex(others, "^[^0-9]*$")).as_py() or 0)
    if spoilt > _MOST_BAD * filled or len(others) > _MOST_WORDS * filled:
        head.left_out[name] = f"text ('{head.bad[name][0][:30]}')"
        return
    out[name] = _float(compute.if_else(good, plain, None).cast("float64"))


def _read_moments(name: str, cells: Any, filled: int, out: Columns, days: Columns, clocks: Columns, head: Head) -> bool:
    """Read a column of dates, times of day or both; false if it has others. Ambiguous dates go to `head.left_out`."""
    from pyarrow import compute

    parts = compute.extract_regex(cells, _MOMENT)
    if len(parts) - parts.null_count < filled:
        return False
    known = np.flatnonzero(~np.asarray(compute.is_null(cells)))
    part = {key: compute.struct_field(parts, [key]).drop_null() for key in ("a", "mark", "b", "c", "h", "s", "half")}
    has_date, has_time = (np.asarray(compute.not_equal(part[key], "")) for key in ("a", "h"))
    if has_date.any() != has_date.all() or has_time.any() != has_time.all() or not (has_date.any() or has_time.any()):
        return False
    since_midnight = np.zeros(known.size)
    if has_time.all():
        twelve = np.asarray(compute.not_equal(part["half"], ""))
        sure = has_date | twelve | np.asarray(compute.not_equal(part["s"], ""))
        hours = _int(part["h"])
        if not sure.all() or twelve.any() != twelve.all() or (twelve.any() and not _in_range(hours, 1, 12)):
            return False
        after_noon = np.asarray(compute.match_substring_regex(part["half"], "[Pp]"))
        hours = np.where(twelve, hours % 12 + 12 * after_noon, hours)
        since_midnight = 3600.0 * hours + _clock_seconds(parts)
    seconds = np.full(len(cells), np.nan)
    if not has_date.all():
        seconds[known] = since_midnight
        clocks[name] = seconds
        return True
    dates = _dates(part["mark"], _int(part["a"]), _int(part["b"]), _int(part["c"]), head)
    if isinstance(dates, str):
        if dates:
            first = cells.drop_null()[int(dates)].as_py()
            head.left_out[name] = f"dates ('{first}') of which no row shows whether the day or the month is first"
        return False
    seconds[known] = dates * _DAY_S + since_midnight
    if has_time.all():
        out[name] = seconds
        head.dated.add(name)
    else:
        days[name] = seconds
    return True


def _clock_seconds(parts: Any) -> FloatArray:
    """Minutes and seconds of times of day, less the zone, in seconds."""
    from pyarrow import compute

    minutes, seconds, fraction, milli, zone = (
        compute.struct_field(parts, [key]).drop_null() for key in ("m", "s", "f", "ms", "zone")
    )
    tail = compute.binary_join_element_wise("0", fraction, ".")
    whole = 60.0 * _int(minutes) + _int(seconds) + 1e-3 * _int(milli) + _float(tail.cast("float64"))
    if not bool(compute.any(compute.match_substring_regex(zone, "[0-9]")).as_py()):
        return whole
    bare = compute.replace_substring(compute.replace_substring(zone, ":", ""), "Z", "")
    offset = _int(bare)
    return whole - np.sign(offset) * (np.abs(offset) // 100 * 3600.0 + np.abs(offset) % 100 * 60.0)


def _dates(mark: Any, a: IntArray, b: IntArray, c: IntArray, head: Head) -> FloatArray | str:
    """Return days since 1970 of dates; '' for impossible ones, or the row of an ambiguous one as text."""
    from pyarrow import compute

    year_first = a >= _YEAR
    if year_first.any() != year_first.all() or not (year_first | (c >= _YEAR)).all():
        return ""
    if year_first.all():
        year, month, day = a, b, c
    else:
        day_first = head.day_first
        if bool(compute.all(compute.equal(mark, ".")).as_py()) or (a > _MONTHS).any():
            day_first = True
        elif (b > _MONTHS).any():
            day_first = False
        if day_first is None and (a != b).any():
            return str(int(np.flatnonzero(a != b)[0]))
        if not bool(compute.all(compute.equal(mark, ".")).as_py()):
            head.day_first = day_first
        year, (day, month) = c, (a, b) if day_first else (b, a)
    months = (12 * (year - 1970) + month - 1).astype("datetime64[M]")
    moments = months.astype("datetime64[D]") + (day - 1)
    if not _in_range(month, 1, 12) or (day < 1).any() or (moments.astype("datetime64[M]") != months).any():
        return ""
    return np.asarray(moments.astype(np.int64), dtype=np.float64)


def _past_midnight(seconds: FloatArray) -> FloatArray:
    """Continue times of day past midnight, where they fall by more than half a day."""
    known = np.flatnonzero(np.isfinite(seconds))
    past = np.cumsum(np.diff(seconds[known], prepend=seconds[known][:1]) < -0.5 * _DAY_S)
    on = seconds.copy()
    on[known] += _DAY_S * past
    return on


def _in_range(values: IntArray, low: int, high: int) -> bool:
    return bool(((values >= low) & (values <= high)).all())


def _int(cells: Any) -> IntArray:
    from pyarrow import compute

    filled = compute.if_else(compute.equal(cells, ""), "0", compute.replace_substring(cells, "+", ""))
    return np.asarray(filled.cast("int64"), dtype=np.int64)


def _float(column: Any) -> FloatArray:
    # Nanoseconds since 1970 have more digits than a double; a quarter of a microsecond is lost.
    values = column.cast("float64", safe=False)
    combined = values.combine_chunks() if hasattr(values, "combine_chunks") else values
    return np.array(combined.to_numpy(zero_copy_only=False), dtype=np.float64)


def find_long_form(written: Mapping[str, Any]) -> LongForm | None:
    """Find the two columns of a log with a row for each value (Arrow columns); None for a column for each signal.

    A column of few words names signals if the words are paths, or if neighbouring rows of different words have very
    different values: a state beside a value (ON, OFF) does not.
    """
    from pyarrow import compute, types

    is_value = re.compile(r"(^|[^a-z])(values?|val|wert|messwert|valeur|valore?|valor|deger|data|y)([^a-z]|$)")
    numbers = [
        name
        for name, cells in written.items()
        if is_value.search(name.lower()) and (types.is_integer(cells.type) or types.is_floating(cells.type))
    ]
    if len(numbers) != 1:
        return None
    value = _float(written[numbers[0]])
    found = []
    for name, cells in written.items():
        if not (types.is_string(cells.type) or types.is_large_string(cells.type)):
            continue
        words = [word for word in compute.unique(cells).to_pylist() if word]
        if not 2 <= len(words) <= _SIGNALS or len(cells) < _ROWS * len(words):
            continue
        code = np.asarray(compute.fill_null(compute.index_in(cells, compute.unique(cells)), -1))
        changes = np.diff(code) != 0
        within = np.concatenate([np.abs(np.diff(value[code == k])) for k in np.unique(code)])
        apart = np.nanmedian(np.abs(np.diff(value))[changes]) > 2.0 * np.nanmedian(within) if changes.any() else False
        often = np.count_nonzero(changes) >= 0.5 * (len(words) - 1)
        if all(re.search(r"[/.\[_]|[a-z][A-Z]", word) for word in words) or (often and apart):
            found.append(name)
    return LongForm(found[0], numbers[0]) if len(found) == 1 else None


def by_signal(written: Mapping[str, Any], form: LongForm, head: Head) -> dict[str, Any]:
    """Return Arrow columns with one for each signal, null in the rows of others, and describe them in `head`."""
    from pyarrow import compute

    for name in (form.signal, form.value):
        if name not in written:
            raise RecordingError(
                f"no column '{name}' of a log with a row for each value; available: {', '.join(written)}"
            )
    signal, value = written[form.signal], written[form.value]
    names = [str(name) for name in compute.unique(signal).to_pylist() if name]
    if len(names) > _SIGNALS:
        raise RecordingError(f"column '{form.signal}' names {len(names)} signals; export at most {_SIGNALS} of them")
    kept = {name: cells for name, cells in written.items() if name not in (form.signal, form.value)}
    head.signals, head.long_form = set(names), form
    head.left_out[form.value] = (
        f"the values of several signals, which '{form.signal}' names: {', '.join(sorted(names))}"
    )
    return {**kept, **{name: compute.if_else(compute.equal(signal, name), value, None) for name in names}}
