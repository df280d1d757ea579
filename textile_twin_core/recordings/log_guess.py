"""Guess of how to read a log: columns by name, question or unit, and units by name or values."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.readings import ANGLE_TURNS, angle_unit, shown_turn
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.counter import BITS, DECIMALS, Counter, find_counter, least_step
from textile_twin_core.recordings.log_apply import (
    angle_factor,
    newton_metres,
    rad_per_s,
    radians,
    seconds_of,
    si_units,
)
from textile_twin_core.recordings.log_clock_guess import Ask, ClockGuess
from textile_twin_core.recordings.log_mapping import NO_COLUMN, Channel, LogMapping, OtherLogger
from textile_twin_core.recordings.log_table import Columns, Head
from textile_twin_core.recordings.log_units import (
    COUNTS,
    SPEED_UNITS,
    choose,
    spelled,
    unit_factor,
    unit_in_name,
)

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


class _Guess(ClockGuess):
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
