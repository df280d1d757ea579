"""Guess of how to read a log: columns by name, question or unit, units by name or values, clocks of the rows."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.readings import ANGLE_TURNS, angle_unit, shown_turn
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.counter import BITS, DECIMALS, Counter, find_counter, least_step, unwrap_counter
from textile_twin_core.recordings.log_apply import (
    DATED,
    FILETIME,
    PARTS,
    angle_factor,
    newton_metres,
    own_times_option,
    rad_per_s,
    radians,
    seconds_of,
    si_units,
)
from textile_twin_core.recordings.log_mapping import NO_COLUMN, Channel, Clock, LogMapping, OtherLogger
from textile_twin_core.recordings.log_table import HOW, Columns, Head, describe
from textile_twin_core.recordings.log_units import (
    COUNTS,
    SPEED_UNITS,
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
_SECONDS_WORD = re.compile(r"(^|[^a-z])secs?([^a-z]|$)")
_STEPS = re.compile(
    r"(^|[^a-z])(dt|d_t|delta|interval|elapsed since last)([^a-z]|$)|diff|schritt|[Δ∆]|step", re.IGNORECASE
)
_FULL = 0.5
"""Share of a second that the largest of its parts must exceed."""
_OVERLAP = 0.5
"""Least overlap of two columns of times of one clock, as a share of the shorter span."""
_NOT_ITS_SPEED = 0.1
"""Relative difference above which a speed is that of another shaft, or of the other direction."""


@dataclass(frozen=True)
class Guess:
    """Complete mapping of a log, and by kind (time, angle, torque, speed ..) how each was found, for people."""

    mapping: LogMapping
    reasons: Mapping[str, str]


def guess(columns: Columns, head: Head, wished: LogMapping | None = None, ask: Ask | None = None) -> Guess:
    """Complete a mapping by the names and values of the columns.

    Args:
        columns, head: of the log, as `read_table` returns them.
        wished: columns, units and clocks as far as they are known; None if nothing is.
        ask: asks a person if several columns may be meant; None: such a log is refused.

    Raises:
        RecordingError: A column is ambiguous, or its unit unknown.
    """
    return _Guess(columns, head, wished or LogMapping(), ask).run()


def guess_torque_log(
    columns: Columns, head: Head, wished: OtherLogger, ask: Ask | None = None
) -> tuple[OtherLogger, list[Channel], Mapping[str, str]]:
    """Complete the mapping of a second logger's file with the torque.

    Returns:
        The torque with its clock, the columns that may measure what the angle's log measures, and the reasons.
    """
    own = LogMapping(wished.clock, Channel(NO_COLUMN), wished.torque, wished.shared)
    found = _Guess(columns, head, own, ask)
    return *found.torque_log(), found.reasons


class _Guess:
    def __init__(self, columns: Columns, head: Head, wished: LogMapping, ask: Ask | None) -> None:
        self._columns, self._head, self._mapping, self._ask = columns, head, wished, ask
        self.reasons: dict[str, str] = {}

    def run(self) -> Guess:
        mapping = self._mapping
        angle = self._channel("angle", needed=True)
        assert angle is not None
        self._mapping = replace(mapping, angle=angle)
        clock = self._main_clock(angle)
        self._mapping = replace(self._mapping, clock=self._with_unit(clock, "time"))
        angle = self._angle(angle, "angle")
        self._mapping = replace(self._mapping, angle=angle)
        torque = None if mapping.torque_log is not None else self._channel("torque")
        if torque is not None:
            unit = torque.unit or "N m"
            stated = f"{torque.scale:g} N m per {torque.unit or 'unit'}" if torque.scale is not None else ""
            self.reasons["torque"] = stated or torque.unit or "N m (taken for granted)"
            torque = torque if torque.scale is not None else replace(torque, unit=unit)
            newton_metres(torque, self._columns)
            torque = self._own_clock(torque, "torque")
        self._mapping = replace(self._mapping, torque=torque or Channel(NO_COLUMN))
        if mapping.second_angle.column != NO_COLUMN:
            second = mapping.second_angle
            self._refuse_unknown(second.column)
            unit = spelled(second.unit) or unit_in_name(second.column) or angle.unit
            second = self._own_clock(self._angle(replace(second, unit=unit), "second angle"), "second angle")
            self._mapping = replace(self._mapping, second_angle=second)
        for output, channel in mapping.quantities.items():
            self._refuse_unknown(channel.column)
            channel = replace(channel, unit=spelled(channel.unit) or unit_in_name(channel.column))
            self.reasons[output] = channel.unit or "SI units (taken for granted)"
            si_units(channel, self._columns)
            done = {**self._mapping.quantities, output: self._own_clock(channel, output)}
            self._mapping = replace(self._mapping, quantities=done)
        self._mapping = replace(self._mapping, speed=self._speed())
        return Guess(self._mapping, self.reasons)

    def torque_log(self) -> tuple[OtherLogger, list[Channel]]:
        """Complete the torque, its unit and its clock; return them with the columns that the angle's log may share."""
        torque = self._channel("torque", needed=True)
        assert torque is not None
        self._mapping = replace(self._mapping, torque=torque)
        clock = self._with_unit(self._main_clock(torque), "torque time")
        torque = replace(torque, unit=torque.unit or "N m")
        newton_metres(torque, self._columns)
        self.reasons["torque"] = torque.unit if torque.scale is None else f"{torque.scale:g} N m per unit"
        self._mapping = replace(self._mapping, clock=clock, torque=torque)
        names = [each for each in self._columns if each not in self._mapping.named]
        wished = self._mapping.speed
        shared = [replace(wished, unit=spelled(wished.unit) or unit_in_name(wished.column))]
        if wished.column == NO_COLUMN:
            shared = []
        elif wished.column:
            self._refuse_unknown(wished.column)
        else:
            shared = [Channel(name, unit_in_name(name)) for name in choose("speed", names)]
            for name in [] if shared else choose("angle", names):
                with suppress(RecordingError):  # its unit cannot be seen
                    shared.append(self._angle(Channel(name, unit_in_name(name)), "shared"))
        return OtherLogger(clock, torque), shared

    # Columns ----------------------------------------------------------------------------------------------------------

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

    def _channel(self, kind: str, needed: bool = False) -> Channel | None:
        """Choose the channel of a kind (angle, torque) with its column and unit; None if the log has no such column."""
        wished: Channel = getattr(self._mapping, kind)
        unit, name = spelled(wished.unit), wished.column
        if name == NO_COLUMN and name not in self._columns:
            return None
        if name:
            self._refuse_unknown(name)
            return replace(wished, unit=unit or unit_in_name(name))
        others = [each for each in self._columns if each not in self._mapping.named]
        found = choose(kind, others, bool(unit) or wished.scale is not None)
        if len(found) != 1 and self._ask is not None and (found or needed):
            answer = self._ask(kind, found or list(self._columns))
            found = [answer] if answer else []
        if len(found) == 1:
            return replace(wished, column=found[0], unit=unit or unit_in_name(found[0]))
        if unit and not found:
            raise RecordingError(
                f"--{kind}-unit, but which column is the {kind}? name it with --{kind}: {self._describe()}"
            )
        text = choose(kind, self._head.left_out) if needed and not found else []
        if text:
            self._refuse_unknown(text[0])
        if found or needed:
            raise RecordingError(f"which column is the {kind}? name it with --{kind}. Columns: {self._describe()}")
        return None

    # Units of angles --------------------------------------------------------------------------------------------------

    def _angle(self, channel: Channel, kind: str) -> Channel:
        """Complete an angle's unit and the range of its counter."""
        name, unit, values = channel.column, spelled(channel.unit), self._columns[channel.column]
        seen = angle_unit(values)
        if unit in ("", COUNTS):
            if not seen.wrapped:
                option = f"--{kind.replace(' ', '-')}-unit"
                turn = f"how many counts make a turn? give {option} 4096"
                others = f"give {option} {', '.join(ANGLE_TURNS)} or the counts of a turn"
                raise RecordingError(
                    f"column '{name}' never wraps, so its unit cannot be seen; {turn if unit else others}"
                )
            reason = f"{seen.name}, as seen: {shown_turn(seen.turn)} a turn"
            if seen.turn in [2.0**bits for bits in BITS]:
                reason += "; a counter wraps there, too: if the encoder has other counts a turn, give --angle-unit"
            self.reasons[kind] = reason
            return replace(channel, unit=seen.option)
        channel = replace(channel, unit=unit)
        factor = angle_factor(channel)
        plain = re.fullmatch(r"[\d.e+]+", unit) is not None
        self.reasons[kind] = f"{shown_turn(float(unit))} a turn" if plain else unit
        counter = None if channel.wraps_at is not None else _angle_counter(values, factor)
        if counter is not None:
            self.reasons[kind] += f"; {counter.text}, continued from there"
            return replace(channel, wraps_at=counter.width)
        other = next((short for short, turn in ANGLE_TURNS.items() if seen.wrapped and turn == seen.turn), "")
        if other and not math.isclose(ANGLE_TURNS[other] * factor, 2.0 * math.pi):
            self.reasons[kind] += (
                f"; but it wraps at {shown_turn(seen.turn)}, as {seen.name} do: if they are, give --angle-unit {other}"
            )
        return channel

    # Clocks -----------------------------------------------------------------------------------------------------------

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
        parts = {self._fraction(name, [*others])[0] for name in found}
        found = [name for name in found if name not in parts]
        found = [name for k, name in enumerate(found) if not any(self._same_rows(name, each) for each in found[:k])]
        found = [name for name in found if not _holds_steps(name, columns[name])] or found
        if not wished.unit:
            found = self._finer(found)
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
        elif clock.steps or _holds_steps(clock.column, values):
            return replace(clock, steps=True)
        else:
            fraction, parts = self._fraction(clock.column, sorted(self._mapping.named - {clock.column}), unit)
            if fraction:
                return replace(clock, unit=unit or "s", fraction=fraction, fraction_unit=parts)
        finite = values[np.isfinite(values)]
        if clock.column in self._head.dated or clock.wraps_at is not None or not np.any(np.diff(finite) < 0.0):
            return clock
        counter = find_counter(values)
        return clock if counter is None else replace(clock, wraps_at=counter.width)

    def _unit(self, name: str) -> str:
        return DATED if name in self._head.dated else unit_in_name(name)

    def _fraction(self, name: str, others: Sequence[str] = (), unit: str = "") -> tuple[str, str]:
        """Find the column of parts of a second beside one of whole seconds, and its unit; two empty texts without one.

        The whole seconds repeat over several rows; the parts fall only where the seconds rise.
        """
        seconds, unit = self._columns[name], unit or self._unit(name)
        finite = seconds[np.isfinite(seconds)]
        if not finite.size or np.any(finite != np.rint(finite)) or not np.any(np.diff(finite) == 0.0):
            return "", ""
        epoch = _EPOCHS_S[0] <= float(np.median(finite)) <= _EPOCHS_S[1]
        if unit not in ("s", DATED) and (unit or not epoch) and not _SECONDS_WORD.search(name.lower()):
            return "", ""
        found = []
        for other, parts in self._columns.items():
            if other == name or other in others or other in self._head.dated or parts.size != seconds.size:
                continue
            unit_of_parts = _part_unit(other, parts)
            if unit_of_parts and _completes(seconds, parts, other):
                found.append((other, unit_of_parts))
        near = [each for each in found if _seconds_stem(each[0]) == _seconds_stem(name)]
        return (near or found)[0] if len(near or found) == 1 else ("", "")

    def _finer(self, found: list[str]) -> list[str]:
        """Choose, between a column of dates and an equivalent one of times with a unit, the one with more moments."""
        dated = [name for name in found if name in self._head.dated]
        timers = [name for name in found if name not in dated and unit_factor(unit_in_name(name), TIME_UNITS)]
        if len(found) != 2 or len(dated) != 1 or len(timers) != 1:
            return found
        (date,), (timer,) = dated, timers
        by_date = self._columns[date]
        by_timer = self._columns[timer] * (unit_factor(unit_in_name(timer), TIME_UNITS) or 1.0)
        here = np.isfinite(by_date) & np.isfinite(by_timer)
        by_date, by_timer = (each[here] - each[here][:1] for each in (by_date, by_timer))
        most = float(np.abs(np.diff(by_date)).max(initial=0.0)) + 1e-3 * float(np.abs(by_date).max(initial=0.0))
        if by_date.size < 2 or np.any(np.abs(by_date - by_timer) > most):
            return found
        if np.unique(by_date).size >= np.unique(by_timer).size:
            self.reasons["clock"] = f"column '{timer}' agrees with '{date}' and is not used"
            return [date]
        self.reasons["clock"] = f"column '{date}' agrees with '{timer}', in larger steps, and is not used"
        return [timer]

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
        rising = (
            [name for name in rest if _looks_like_time(columns[name])]
            or [name for name in rest if self._fraction(name)[0]]  # seconds whose parts stand in another column
            or [name for name in rest if _holds_steps(name, columns[name])]
        )
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

    # Speed ------------------------------------------------------------------------------------------------------------

    def _speed(self) -> Channel:
        """Choose the column of the encoder's speed, with which the angle turns, and its unit."""
        wished, none, mapping = self._mapping.speed, Channel(NO_COLUMN), self._mapping
        if wished.column == NO_COLUMN and NO_COLUMN not in self._columns:
            return none
        unit, names = spelled(wished.unit), [wished.column]
        if wished.column:
            self._refuse_unknown(wished.column)
        else:
            names = choose("speed", [each for each in self._columns if each not in mapping.named], bool(unit))
        if unit and not names:
            raise RecordingError(
                f"--speed-unit, but which column is the speed? name it with --speed: {self._describe()}"
            )
        if not names:
            return none
        seconds = seconds_of(mapping.clock, self._columns)
        theta = radians(mapping.angle, self._columns[mapping.angle.column])
        fitting: list[tuple[float, Channel]] = []
        amiss = []
        for name in names:
            found: tuple[float, Channel] | str = "its times are not those of the angle"
            if theta.size == seconds.size and self._has_same_times(name):
                found = _speed_of(Channel(name, unit or unit_in_name(name)), self._columns[name], seconds, theta)
            if isinstance(found, str):
                amiss.append(f"column '{name}'{'' if wished.column else ' left out'}: {found}")
            else:
                fitting.append(found)
        if not fitting:
            if wished.column or unit:
                raise RecordingError(amiss[0])
            self.reasons["speed"] = "; ".join(amiss)
            return none
        error, best = min(fitting, key=lambda each: each[0])
        if len(fitting) > 1 and error == math.inf:
            self.reasons["speed"] = "left out: no column is seen to be that of the angle; name it with --speed"
            return none
        others = [f"'{name}'" for name in names if name != best.column]
        self.reasons["speed"] = best.unit + (f"; not used: {', '.join(others)}" if others else "")
        return best

    def _has_same_times(self, name: str) -> bool:
        """Return true if a column has a value for each value of the angle and no times of its own."""
        angle, clock = self._mapping.angle.column, self._mapping.clock
        if self._columns[name].size != self._columns[angle].size:
            return False
        own, front = self._clock_in_front(name), self._clock_in_front(angle)
        return own in ("", front, clock.column, clock.fraction) or self._same_rows(own, front or own)


def _angle_counter(values: FloatArray, factor: float) -> Counter | None:
    """Find the counter of an angle whose range is no multiple of a turn."""
    step = least_step(values)
    counter = find_counter(values, [*DECIMALS, *([step] if step else [])])
    if counter is None:
        return None
    turns = counter.width * factor / (2.0 * math.pi)
    count = counter.width / 2.0**counter.bits * factor / (2.0 * math.pi)
    return None if abs(turns - round(turns)) < 0.5 * count else counter


def _speed_of(
    channel: Channel, values: FloatArray, seconds: FloatArray, theta: FloatArray
) -> tuple[float, Channel] | str:
    """Return the misfit of a column of speeds, RMS of the angle less the integrated speed [rad], and its channel.

    Without a unit the column has the one that fits the angle. A text states why the column is no speed of the angle.
    """
    unit = channel.unit
    if unit and unit_factor(unit, SPEED_UNITS) is None:
        return f"speed in '{unit}'? give --speed-unit: {', '.join(SPEED_UNITS)}"
    times = 1.0
    for each in [unit] if unit else SPEED_UNITS:
        channel = replace(channel, unit=each)
        omega = rad_per_s(channel, values)
        stated = 0.5 * (omega[1:] + omega[:-1]) * np.diff(seconds)
        turned = np.diff(theta)
        turned = turned - 2.0 * math.pi * np.rint(turned / (2.0 * math.pi))
        good = np.isfinite(stated) & np.isfinite(turned) & (stated != 0.0)
        stated, turned = stated[good], turned[good]
        few = not stated.size or np.percentile(np.abs(turned), 95.0) > 0.5 * math.pi
        if few or np.abs(turned).sum() < 2.0 * math.pi:  # too few samples a turn, or too little motion, to tell
            if unit:
                return math.inf, channel
            continue
        times = float(stated @ turned / (stated @ stated))
        if abs(times - 1.0) <= _NOT_ITS_SPEED:
            return float(np.sqrt(np.mean((turned - stated) ** 2))), channel
    if unit:
        return f"the angle turns {times:.3g} times as fast: no speed of this encoder"
    return f"its name has no unit; give --speed-unit: {', '.join(SPEED_UNITS)}"


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


def _completes(seconds: FloatArray, parts: FloatArray, name: str) -> bool:
    here = np.isfinite(seconds) & np.isfinite(parts)
    whole, rest = np.diff(seconds[here]), np.diff(parts[here])
    falls = rest < 0.0
    named = any(re.search(words, name.lower()) for words in _PART_WORDS.values())
    if whole.size < 2 or not (falls.any() or named):
        return False
    # A few rows may be out of order; in an unrelated column falls and rises do not match at all.
    rising = bool(np.mean(whole[falls] > 0.0) > 0.9) if falls.any() else True
    return rising and bool(np.mean(rest[whole == 0.0] >= 0.0) > 0.9)


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


def _holds_steps(name: str, values: FloatArray) -> bool:
    """Return true if a column is named as a difference of times and does not rise."""
    finite = values[np.isfinite(values)]
    return bool(_STEPS.search(name)) and finite.size > 2 and bool(finite.min() >= 0.0) and not _rises(finite)


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
