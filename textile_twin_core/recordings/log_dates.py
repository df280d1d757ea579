"""Dates and times of day of many loggers, converted to one form if they are unambiguous."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

_ON_CLOCK = r"\d{1,2}:\d\d:\d\d([.,]\d+|:\d{3})?"
_HALF_DAY = r" ?[AaPp]\.?[Mm]\.?"
MOMENT = re.compile(
    r"((\d{4}[-/]\d\d[-/]\d\d|\d\d\.\d\d\.\d{4}|\d{1,2}/\d{1,2}/\d{4}|\d{1,2}-\d{1,2}-\d{4})"
    rf"((T|,? )({_ON_CLOCK}|\d{{1,2}}:\d\d)({_HALF_DAY}|Z|[+-]\d\d:?\d\d)?)?"
    rf"|{_ON_CLOCK}({_HALF_DAY})?|\d{{1,2}}:\d\d{_HALF_DAY})$"
)
"""Date and time, either alone."""
OTHER_MOMENT = re.compile(r"\d{1,4}/\d{1,2}/\d{1,4}( \d[\d:.,]+)?|\d{1,2}-\d{1,2}-\d{2,4}\b|\d{1,2}:\d\d[\d:]*")
"""A date or time in another form."""
HOW = "2026-10-25 23:59:50.5 or 25.10.2026 23:59:50,5"
"""Forms in which any date can be read."""

_TWELVE = (
    r"^(?P<before>.*?)(?P<h>[0-9]{1,2}):(?P<m>[0-9]{2})(?P<s>(?::[0-9]{2}(?:[.,:][0-9]+)?)?)"
    r" ?(?P<half>[AaPp])\.?[Mm]\.?$"
)
_MILLISECONDS = r"([0-9]{1,2}:[0-9]{2}:[0-9]{2}):([0-9]{3})$"
_NO_ORDER = r"^(?P<a>[0-9]{1,2})%s(?P<b>[0-9]{1,2})%s(?P<y>[0-9]{4})(?P<rest>$|[T, ].*$)"
_MONTHS = 12


def one_form(cells: Any, day_first: bool | None = None) -> tuple[Any, str, bool | None]:
    """Convert a column of text to dates year first and times of 24 hours; return it, an objection, and the order.

    Cells are converted if all non-null ones of a column have the same form: month or day first (known if one of the
    two exceeds 12 in the column, or they are always equal), twice twelve hours, or milliseconds after a colon.
    The objection is a text for people on ambiguous dates, empty without any. The order is true if the day stands first,
    None if it is unknown or the year stands first; `day_first` gives it if it is known.
    """
    from pyarrow import compute

    cells = compute.replace_substring_regex(_in_24_hours(cells), _MILLISECONDS, r"\1.\2")
    for mark in "/-":
        parts = _parts(cells, _NO_ORDER % (mark, mark))
        if parts is None:
            continue
        first, second = (_numbers(parts, key) for key in "ab")
        if (first > _MONTHS).any() and (second > _MONTHS).any():
            return cells, "", None
        shown = True if (first > _MONTHS).any() else False if (second > _MONTHS).any() else day_first
        if shown is None and (first != second).any():
            at = int(np.flatnonzero(first != second)[0])
            cell = compute.drop_null(cells)[at].as_py()
            return cells, f"dates ('{cell}') of which no row shows whether the day or the month is first", None
        day, month = ("a", "b") if shown else ("b", "a")
        rest = compute.replace_substring_regex(compute.struct_field(parts, ["rest"]), r"^[T,]? ?([0-9].*)", r" \1")
        date = [compute.struct_field(parts, ["y"]), _two_digits(parts, month), _two_digits(parts, day)]
        joined = compute.binary_join_element_wise(compute.binary_join_element_wise(*date, "-"), rest, "")
        return joined, "", shown
    return cells, "", None


def _in_24_hours(cells: Any) -> Any:
    """Convert times that all end in AM or PM, 1:05 PM to 13:05:00; others, and hours beyond 12, are unchanged."""
    import pyarrow
    from pyarrow import compute

    parts = _parts(cells, _TWELVE)
    if parts is None:
        return cells
    hours = compute.struct_field(parts, ["h"]).cast("int64")
    written = _numbers(parts, "h")
    if written.min() < 1 or written.max() > _MONTHS:
        return cells
    after_noon = compute.equal(compute.utf8_lower(compute.struct_field(parts, ["half"])), "p")
    hours = compute.if_else(compute.equal(hours, _MONTHS), pyarrow.scalar(0, "int64"), hours)
    hours = compute.add(hours, compute.if_else(after_noon, 12, 0))
    seconds = compute.struct_field(parts, ["s"])
    seconds = compute.if_else(compute.equal(seconds, ""), ":00", seconds)
    clock = compute.binary_join_element_wise(
        compute.utf8_lpad(hours.cast("string"), 2, "0"), compute.struct_field(parts, ["m"]), ":"
    )
    return compute.binary_join_element_wise(compute.struct_field(parts, ["before"]), clock, seconds, "")


def _parts(cells: Any, pattern: str) -> Any:
    """Groups of a pattern in each cell; None if a non-null cell does not match, or without cells."""
    from pyarrow import compute

    parts = compute.extract_regex(cells, pattern)
    return None if parts.null_count > cells.null_count or parts.null_count == len(cells) else parts


def _numbers(parts: Any, key: str) -> Any:
    from pyarrow import compute

    return compute.drop_null(compute.struct_field(parts, [key])).cast("int64").to_numpy(zero_copy_only=False)


def _two_digits(parts: Any, key: str) -> Any:
    from pyarrow import compute

    return compute.utf8_lpad(compute.struct_field(parts, [key]), 2, "0")
