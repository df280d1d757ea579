"""Guess of the clocks of a log: columns of times by name or values, their units, and parts of a second."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.counter import find_counter, unwrap_counter
from textile_twin_core.recordings.log_apply import (
    DATED,
    FILETIME,
    PARTS,
    own_times_option,
    seconds_of,
)
from textile_twin_core.recordings.log_mapping import NO_COLUMN, Channel, Clock, LogMapping
from textile_twin_core.recordings.log_table import HOW, Columns, Head, describe
from textile_twin_core.recordings.log_units import (
    TIME_UNITS,
    choose,
    spelled,
    unit_factor,
    unit_in_name,
)

Ask = Callable[[str, list[str]], str]
"""Question to a person for one of several columns: (kind, names) -> name."""

_GUESSED = ("s", "ms", "us", "ns")
_INTERVALS_S = (5e-5, 2.0)
"""Shortest and longest interval of a machine's log."""
_TOO_SLOW_S = 0.5
"""Interval too slow to show a shaft: if another unit makes it a thousandth, that unit is meant."""
_LONG_S = 3600.0
_EPOCHS_S = (9.4e8, 4.2e9)
"""Seconds since 1970 of the years 2000 to 2100."""
_SLOWEST_EPOCH_S = 60.0
_EXCEL_DAYS = (20_000.0, 80_000.0)
_FILETIMES = (1.25e17, 1.6e17)
_COUNTS_OF_ROWS = re.compile(
    r"(^|[^a-z])(samples?|index|idx|rows?|zeilen?|lines?|nr|no|num|count|counter|n|i|k)([^a-z]|$)"
)
_PART_WORDS = {
    "ns": r"nano|(^|[^a-z])n_?sec|(^|[^a-z])ns([^a-z]|$)",
    "us": r"micro|(^|[^a-z])[uµμ]_?sec|(^|[^a-z])[uµμ]s([^a-z]|$)",
    "ms": r"milli|(^|[^a-z])m_?sec|(^|[^a-z])ms([^a-z]|$)",
}
_FULL = 0.5
"""Share of a second that the largest of its parts must exceed."""
_OVERLAP = 0.5
"""Least overlap of two columns of times of one clock, as a share of the shorter span."""


class ClockGuess:
    """Columns of a log, the mapping as far as it is complete, and the reasons for people; chooses clocks."""

    def __init__(self, columns: Columns, head: Head, wished: LogMapping, ask: Ask | None) -> None:
        self._columns, self._head, self._mapping, self._ask = columns, head, wished, ask
        self.reasons: dict[str, str] = {}

    def _describe(self) -> str:
        return describe(self._columns, self._head)

    def _refuse_unknown(self, name: str) -> None:
        """Raise RecordingError for a column that is missing or has no numbers."""
        if name in self._head.left_out:
            raise RecordingError(
                f"column '{name}' holds {self._head.left_out[name]}, no numbers of use; available: {self._describe()}"
            )
        if name not in self._columns:
            raise RecordingError(f"no column '{name}'; available: {self._describe()}")

    def _main_clock(self, channel: Channel) -> Clock:
        """Choose the clock of the angle."""
        wished = self._mapping.clock
        if wished.rate_hz is None:
            return self._choose_clock(channel)
        several = sorted(set(self._head.times_of.values()))
        if len(several) > 1:
            raise RecordingError(
                f"--rate: columns have times of their own, '{several[0]}' and others; leave --rate out"
            )
        return Clock(rate_hz=wished.rate_hz)

    def _choose_clock(self, angle: Channel) -> Clock:
        mapping, columns, head = self._mapping, self._columns, self._head
        wished = replace(
            mapping.clock, unit=spelled(mapping.clock.unit), fraction_unit=spelled(mapping.clock.fraction_unit)
        )
        front = self._clock_in_front(angle.column)
        if wished.column:
            self._refuse_unknown(wished.column)
            its = angle.column in head.times_of or _stem(front) == _stem(wished.column)
            if front and its and not self._same_rows(front, wished.column):
                # Columns of the same name: their place shows to which channel they belong.
                wished = replace(wished, column=front)
            return self._completed(wished)
        if angle.column in head.times_of:
            return self._completed(replace(wished, column=front))
        others = {*mapping.named, angle.column}
        found = choose("time", [each for each in columns if each not in others])
        parts = {self._fraction(name)[0] for name in found}
        found = [name for name in found if name not in parts]
        found = [name for k, name in enumerate(found) if not any(self._same_rows(name, each) for each in found[:k])]
        if len(found) > 1 and len({_stem(name) for name in found}) == 1 and front:
            found = [front]
        if len(found) > 1 and self._ask is not None:
            answer = self._ask("time", found)
            found = [answer] if answer else []
        if len(found) > 1:
            raise RecordingError(f"which column is the time? name it with --time. Columns: {self._describe()}")
        if not found and wished.unit:
            raise RecordingError(f"--time-unit, but which column is the time? name it with --time: {self._describe()}")
        if not found and head.rate_hz is not None:
            return Clock(rate_hz=head.rate_hz)
        return self._completed(replace(wished, column=found[0] if found else self._rising(others)))

    def _clock_in_front(self, column: str) -> str:
        """Last rising column of times in front of a column; '' without one."""
        if column in self._head.times_of:
            return self._head.times_of[column]
        names = list(self._columns)
        times = [name for name in names if name in self._head.dated or name in choose("time", names)]
        parts = {name: self._fraction(name)[0] for name in times}
        before = [name for name in times if names.index(name) < names.index(column) and name not in parts.values()]
        before = [name for name in before if parts[name] or _rises(self._columns[name])]
        return before[-1] if before else ""

    def _same_rows(self, one: str, other: str) -> bool:
        return one == other or np.array_equal(self._columns[one], self._columns[other], equal_nan=True)

    def _own_clock(self, channel: Channel, kind: str) -> Channel:
        """Complete a channel beside the angle by the column of times that stands between the two, if there is one.

        Raises RecordingError if that column counts from another moment: it may be another clock of the same rows.
        """
        clock, angle = self._mapping.clock, self._mapping.angle.column
        own = channel.clock
        if own is None:
            own = self._clock_between(channel.column, angle, kind)
            if own is None:
                return channel
        else:
            self._refuse_unknown(own.column)
        reason = self.reasons[kind]
        own = self._with_unit(own, kind)
        at, self.reasons[kind] = self.reasons[kind], reason
        if own == clock:
            return replace(channel, clock=None)
        self.reasons[kind] += f"; at {at}"
        return replace(channel, clock=own)

    def _clock_between(self, column: str, angle: str, kind: str) -> Clock | None:
        clock = self._mapping.clock
        own, front = self._clock_in_front(column), self._clock_in_front(angle)
        stated = column in self._head.times_of
        if not own or own in (clock.column, clock.fraction) or (own == front and not stated):
            return None
        if self._same_rows(own, clock.column or front or own):
            return None
        between = f"column '{own}' stands between '{angle}' and '{column}'"
        if clock.rate_hz is not None:
            raise RecordingError(f"{between}, which have times of their own; leave --rate out")
        if stated or (clock.column == front and self._overlap(clock.column, own)):
            unit = clock.unit if _stem(own) == _stem(clock.column) else ""
            return self._completed(Clock(own, unit))
        raise RecordingError(
            f"{between} and counts otherwise than '{clock.column}'; state which of the two is the time of '{column}':"
            f" {own_times_option(kind)}"
        )

    def _overlap(self, one: str, other: str) -> bool:
        """Return true if two columns of times count from the same moment: their spans overlap by half."""
        spans = [
            (float(np.nanmin(self._columns[each])), float(np.nanmax(self._columns[each]))) for each in (one, other)
        ]
        both = min(end for _, end in spans) - max(begin for begin, _ in spans)
        return both >= _OVERLAP * min(end - begin for begin, end in spans)

    def _completed(self, clock: Clock) -> Clock:
        """Complete a clock: the parts of its seconds from another column, the sum of its steps, or its counter."""
        values, unit = self._columns[clock.column], clock.unit or self._unit(clock.column)
        if clock.fraction == NO_COLUMN:
            clock = replace(clock, fraction="")
        elif clock.fraction:
            self._refuse_unknown(clock.fraction)
            parts = clock.fraction_unit or _part_unit(clock.fraction, self._columns[clock.fraction])
            return replace(clock, unit=unit or "s", fraction_unit=parts)
        elif not clock.steps:
            fraction, parts = self._fraction(clock.column)
            if fraction:
                return replace(clock, unit=unit or "s", fraction=fraction, fraction_unit=parts)
        finite = values[np.isfinite(values)]
        if clock.column in self._head.dated or clock.wraps_at is not None or not np.any(np.diff(finite) < 0.0):
            return clock
        counter = find_counter(values)
        return clock if counter is None else replace(clock, wraps_at=counter.width)

    def _unit(self, name: str) -> str:
        return DATED if name in self._head.dated else unit_in_name(name)

    def _fraction(self, name: str) -> tuple[str, str]:
        """Find the column of parts of a second by the name of that of the seconds; two empty texts without one."""
        seconds = self._columns[name]
        if np.any(seconds[np.isfinite(seconds)] % 1.0):
            return "", ""
        for other, parts in self._columns.items():
            if other != name and parts.size == seconds.size and _seconds_stem(other) == _seconds_stem(name):
                unit = _part_unit(other, parts)
                if unit and any(re.search(words, other.lower()) for words in _PART_WORDS.values()):
                    return other, unit
        return "", ""

    def _rising(self, others: set[str]) -> str:
        """Find the only column of dates, or the only other one that rises evenly, if no name is one of a time."""
        columns, left_out = self._columns, self._head.left_out
        others = others | {name for kind in ("angle", "torque", "speed") for name in choose(kind, columns)}
        dated = [name for name in columns if name in self._head.dated]
        if len(dated) == 1:
            return dated[0]
        text = [name for name in choose("time", left_out) if name not in columns and left_out[name] != "nothing"]
        if text:
            raise RecordingError(
                f"column '{text[0]}' holds {left_out[text[0]]}, no times; write dates as {HOW}, or give --rate"
            )
        rest = [name for name in columns if name not in others]
        rising = [name for name in rest if _looks_like_time(columns[name])]
        if len(rising) != 1:
            raise RecordingError(f"no column of times; give --time or --rate. Columns: {self._describe()}")
        (name,) = rising
        if not unit_in_name(name) and _rises(columns[name]) and _counts_rows(name, columns[name]):
            raise RecordingError(
                f"no column of times: '{name}' seems to count the rows; give --rate HZ, or --time '{name}' with"
                " --time-unit"
            )
        return name

    def _with_unit(self, clock: Clock, kind: str) -> Clock:
        """Complete the unit of a clock, and note the reason."""
        if clock.rate_hz is not None:
            self.reasons[kind] = f"{clock.rate_hz:g} rows a second"
            return clock
        name = clock.column
        values, unit = self._columns[name], spelled(clock.unit) or self._unit(name)
        if unit == DATED and name not in self._head.dated:
            raise RecordingError(f"column '{name}' holds no dates or times of day; name its unit with --time-unit")
        values = values if clock.wraps_at is None else unwrap_counter(values, clock.wraps_at)
        finite = values[np.isfinite(values)]
        if not finite.size:
            raise RecordingError(f"column '{name}': no time in it; name another with --time, or give --rate")
        if clock.steps:
            finite = np.cumsum(finite)
        if unit == DATED:
            words = "a date or a time of day"
        elif unit:
            words = unit + ("" if clock.fraction else _objection(finite, unit))
        else:
            unit, words = _guessed_time(name, finite)
        if unit == "days" and _EXCEL_DAYS[0] <= float(finite[0]) <= _EXCEL_DAYS[1]:
            words = words.replace("days", "Excel's days", 1)
        if clock.fraction:
            words += f", with '{clock.fraction}', {clock.fraction_unit}"
        words += "; the sum of its steps" if clock.steps else ""
        if clock.wraps_at is not None:
            found = find_counter(self._columns[name])
            words += f"; {found.text if found else f'a counter that wraps at {clock.wraps_at:g}'}, continued from there"
        clock = replace(clock, unit=unit)
        seconds_of(clock, self._columns)
        self.reasons[kind] = f"column '{name}', {words}"
        return clock


def _guessed_time(name: str, finite: FloatArray) -> tuple[str, str]:
    """Return the only unit that fits the times (n,), and its source. Raises RecordingError if several or none fit."""
    steps = np.diff(finite)
    steps = steps[steps > 0.0]
    if not steps.size:
        raise RecordingError(f"column '{name}' does not rise, so it holds no times; name another, or give --rate")
    step, size = float(np.median(steps)), float(np.median(np.abs(finite)))
    if _FILETIMES[0] <= size <= _FILETIMES[1]:
        return FILETIME, "ticks of 100 ns since 1601 (taken for granted)"
    for unit in _GUESSED:
        scale = TIME_UNITS[unit]
        if _EPOCHS_S[0] <= size * scale <= _EPOCHS_S[1] and step * scale <= _SLOWEST_EPOCH_S:
            return unit, f"{unit} since 1970 (taken for granted)"
    fastest, slowest = _INTERVALS_S
    if _EXCEL_DAYS[0] <= size <= _EXCEL_DAYS[1] and step < fastest <= step * TIME_UNITS["days"] <= slowest:
        return "days", "days since 1900 (taken for granted)"
    fits = [unit for unit in _GUESSED if fastest <= step * TIME_UNITS[unit] <= slowest * (1.0 + 1e-9)]
    if len(fits) > 1:
        slower, quicker = fits[:2]
        whole = bool(np.all(finite == np.rint(finite)))
        # A count of rows has steps of one; slow rows may still be in seconds, unless the log is hours long.
        long = step > 1.0 and float(np.ptp(finite)) > _LONG_S if slower == "s" else True
        if whole and long and step * TIME_UNITS[slower] >= _TOO_SLOW_S:
            fits = [quicker]
    if len(fits) == 1:
        return fits[0], f"{fits[0]} (taken for granted: {step * TIME_UNITS[fits[0]] * 1e3:.4g} ms from row to row)"
    may = " or ".join(fits) if fits else "none of " + ", ".join(_GUESSED)
    raise RecordingError(
        f"column '{name}': its header states no unit, and by its steps of {step:.6g} it may be {may}"
        f"{', or a count of rows' if step == 1.0 else ''}; give --time-unit {', '.join(TIME_UNITS)}; or leave the"
        " column out with --rate HZ"
    )


def _objection(finite: FloatArray, unit: str) -> str:
    """Describe an implausible interval of the rows in a given unit; empty if it is plausible."""
    steps = np.diff(finite)
    steps = steps[steps > 0.0] * (unit_factor(unit, TIME_UNITS) or np.nan)
    step = float(np.median(steps)) if steps.size else np.nan
    if _INTERVALS_S[0] <= step < _TOO_SLOW_S or np.isnan(step):
        return ""
    return f" ({step:.4g} s from row to row, at which no shaft is logged: if the unit is another, give --time-unit)"


def _part_unit(name: str, values: FloatArray) -> str:
    """Unit of a column of parts of a second, by its name, else by its largest value; '' for other columns."""
    finite = values[np.isfinite(values)]
    if not finite.size or finite.min() < 0.0 or np.any(finite != np.rint(finite)):
        return ""
    largest = float(finite.max())
    named = next((unit for unit, words in _PART_WORDS.items() if re.search(words, name.lower())), "")
    if named:
        return named if largest < PARTS[named] else ""
    return next((unit for unit, parts in reversed(PARTS.items()) if _FULL * parts <= largest < parts), "")


def _seconds_stem(name: str) -> str:
    """Name of a column without its words for seconds or parts of them."""
    return re.sub(r"(nano|micro|milli)?_?(secs?|seconds?)|[num]?_?secs?|[\W_]+", "", name.lower())


def _stem(name: str) -> str:
    """Name of a column without its unit and the number at its end, common to columns of the same kind."""
    return re.sub(r"[\W_]*\d*$", "", re.sub(r"[\[(].*?[\])]", "", name).strip()).lower()


def _rises(values: FloatArray) -> bool:
    """Return true if values rise in most steps and fall in few."""
    steps = np.diff(values[np.isfinite(values)])
    return steps.size > 1 and bool(np.mean(steps > 0.0) > 0.5 and np.mean(steps < 0.0) < 0.1)


def _looks_like_time(values: FloatArray) -> bool:
    """Return true if a column rises throughout in nearly equal steps."""
    finite = values[np.isfinite(values)]
    step = np.diff(finite[:10_000])
    return finite.size > 2 and bool((step > 0.0).all()) and float(np.median(step)) > 0.2 * float(step.max(initial=0.0))


def _counts_rows(name: str, values: FloatArray) -> bool:
    """Return true if an evenly rising column, without a name of a time, is a count of rows."""
    finite = values[np.isfinite(values)][:10_000]
    steps = np.unique(np.diff(finite))
    # Milliseconds since 1970 at 1 kHz rise by one, too.
    by_one = steps.size == 1 and float(steps[0]) == 1.0 and float(finite[0]) < _EPOCHS_S[0]
    return bool(_COUNTS_OF_ROWS.search(name.lower())) or by_one
