"""Choice of the columns of a log for angle, torque and time: by the user, by their names, or by a question."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.log_cells import LogTable
from textile_twin_core.recordings.log_clocks import (
    clock_in_front,
    find_fraction,
    holds_steps,
    name_stem,
    one_clock,
    rises,
    same_rows,
)
from textile_twin_core.recordings.log_columns import choose, describe, looks_like_time
from textile_twin_core.recordings.log_makers import UNTIMED
from textile_twin_core.recordings.log_mapping import NO_COLUMN, Channel, Clock, LogMapping
from textile_twin_core.recordings.log_time import DATED, counts_rows, same_clock
from textile_twin_core.recordings.log_units import TIME_UNITS, spelled, unit_factor, unit_in_name

Ask = Callable[[str, list[str]], str]
"""Question to a person for one of several columns: (kind, names) -> name."""


def refuse_unknown(name: str, table: LogTable) -> None:
    """Raise RecordingError for a column that is missing or has no numbers."""
    if name in table.left_out:
        raise RecordingError(
            f"column '{name}' holds {table.left_out[name]}, no numbers of use; there are: {describe(table)}"
        )
    if name not in table:
        raise RecordingError(f"no column '{name}'; there are: {describe(table)}")


def choose_channel(
    kind: str, table: LogTable, mapping: LogMapping, ask: Ask | None, needed: bool = False
) -> Channel | None:
    """Choose the channel of a kind (angle, torque) with its column and unit; None if the log has no such column.

    Raises RecordingError if several columns may be meant, or an angle is missing.
    """
    wished: Channel = getattr(mapping, kind)
    unit, name = spelled(wished.unit), wished.column
    if name == NO_COLUMN and name not in table:
        return None
    if name:
        refuse_unknown(name, table)
        return replace(wished, unit=unit or unit_in_name(name))
    configured = bool(unit) or wished.scale is not None
    found = choose(kind, [each for each in table if each not in mapping.named], configured)
    if len(found) != 1 and ask is not None and (found or needed):
        answer = ask(kind, found or list(table))
        found = [answer] if answer else []
    if len(found) == 1:
        return replace(wished, column=found[0], unit=unit or unit_in_name(found[0]))
    if unit and not found:
        raise RecordingError(f"--{kind}-unit, but which column is the {kind}? tell it with --{kind}: {describe(table)}")
    held = choose(kind, table.left_out) if needed and not found else []
    if held:
        refuse_unknown(held[0], table)
    if found or needed:
        raise RecordingError(f"which column is the {kind}? tell it with --{kind}. Columns: {describe(table)}")
    return None


def choose_clock(table: LogTable, mapping: LogMapping, angle: Channel, ask: Ask | None, notes: dict[str, str]) -> Clock:
    """Choose the clock of the angle, with its unit if one is named. Raises RecordingError if it is ambiguous."""
    wished = replace(
        mapping.clock, unit=spelled(mapping.clock.unit), fraction_unit=spelled(mapping.clock.fraction_unit)
    )
    front = clock_in_front(table, angle.column)
    if wished.column:
        refuse_unknown(wished.column, table)
        by_reader = angle.column in table.times_of
        if (
            front
            and (by_reader or name_stem(front) == name_stem(wished.column))
            and not same_rows(table, front, wished.column)
        ):
            # Columns of the same name: their place shows to which channel they belong.
            wished = replace(wished, column=front)
        return _completed(table, mapping, wished)
    if angle.column in table.times_of:
        return _completed(table, mapping, replace(wished, column=front))
    others = {*mapping.named, angle.column}
    found = choose("time", [each for each in table if each not in others])
    parts = {find_fraction(table, name, _unit(table, name), [*others])[0] for name in found}
    found = [name for name in found if name not in parts]
    found = [name for k, name in enumerate(found) if not any(same_rows(table, name, each) for each in found[:k])]
    found = [name for name in found if not holds_steps(name, table[name])] or found
    if not wished.unit:
        found = _finer(table, found, notes)
    if len(found) > 1 and len({name_stem(name) for name in found}) == 1 and front:
        found = [front]
    if len(found) > 1 and ask is not None:
        answer = ask("time", found)
        found = [answer] if answer else []
    if len(found) > 1:
        raise RecordingError(f"which column is the time? tell it with --time. Columns: {describe(table)}")
    if not found and wished.unit:
        raise RecordingError(f"--time-unit, but which column is the time? tell it with --time: {describe(table)}")
    return _completed(table, mapping, replace(wished, column=found[0] if found else _rising(table, others)))


def own_clock(
    table: LogTable, mapping: LogMapping, clock: Clock, angle: Channel, channel: Channel, option: str
) -> Clock:
    """Choose the clock of a channel: the angle's, or the column of times that stands between the two.

    Raises RecordingError if that column counts from another moment: it may be another clock of the same rows.
    """
    if channel.clock is not None:
        refuse_unknown(channel.clock.column, table)
        return channel.clock
    own, front = clock_in_front(table, channel.column), clock_in_front(table, angle.column)
    by_reader = channel.column in table.times_of
    if not own or own in (clock.column, clock.fraction) or (own == front and not by_reader):
        return clock
    if same_rows(table, own, clock.column or front or own):
        return clock
    between = f"column '{own}' stands between '{angle.column}' and '{channel.column}'"
    if clock.rate_hz is not None:
        raise RecordingError(f"{between}, which have times of their own; leave --rate out")
    if by_reader or (clock.column == front and one_clock(table[clock.column], table[own])):
        unit = clock.unit if name_stem(own) == name_stem(clock.column) else ""
        return _completed(table, mapping, Clock(own, unit))
    raise RecordingError(
        f"{between} and counts otherwise than '{clock.column}'; state which of the two is the time of"
        f" '{channel.column}': {'--torque-time COLUMN' if option == 'torque' else 'its `time` in the --mapping file'}"
    )


def has_same_times(table: LogTable, clock: Clock, angle: str, name: str) -> bool:
    """Return true if a column has a value for each value of the angle and no times of its own."""
    if table[name].size != table[angle].size:
        return False
    own, front = clock_in_front(table, name), clock_in_front(table, angle)
    return own in ("", front, clock.column, clock.fraction) or same_rows(table, own, front or own)


def _unit(table: LogTable, name: str) -> str:
    return DATED if name in table.dated else unit_in_name(name)


def _completed(table: LogTable, mapping: LogMapping, clock: Clock) -> Clock:
    """Complete a clock: add the parts of its seconds from another column, or sum its steps."""
    unit = clock.unit or _unit(table, clock.column)
    if clock.fraction == NO_COLUMN:
        return replace(clock, fraction="")
    if clock.fraction:
        refuse_unknown(clock.fraction, table)
        return clock
    if holds_steps(clock.column, table[clock.column]):
        return replace(clock, steps=True)
    fraction, parts = find_fraction(table, clock.column, unit, sorted(mapping.named - {clock.column}))
    return replace(clock, fraction=fraction, fraction_unit=parts)


def _finer(table: LogTable, found: list[str], notes: dict[str, str]) -> list[str]:
    """Choose, between a column of dates and an equivalent column of times with a unit, the one with more moments."""
    dated = [name for name in found if name in table.dated]
    timers = [name for name in found if name not in table.dated and unit_factor(unit_in_name(name), TIME_UNITS)]
    if len(found) != 2 or len(dated) != 1 or len(timers) != 1:
        return found
    (date,), (timer,) = dated, timers
    moments = {name: len(set(table[name].tolist())) for name in found}
    if not same_clock(table[date], table[timer] * (unit_factor(unit_in_name(timer), TIME_UNITS) or 1.0)):
        return found
    if moments[date] >= moments[timer]:
        notes["clock"] = f"column '{timer}' goes on as '{date}' and is not used"
        return [date]
    notes["clock"] = f"column '{date}' goes on as '{timer}', in larger steps, and is not used"
    return [timer]


def _rising(table: LogTable, others: set[str]) -> str:
    """Find the only column of dates, or the only other one that rises evenly, if no name is one of a time."""
    others = others | {name for kind in ("angle", "torque", "speed") for name in choose(kind, table)}
    dated = [name for name in table if name in table.dated]
    if len(dated) == 1:
        return dated[0]
    rising = [name for name, values in table.items() if name not in others and looks_like_time(values)]
    left_out = [name for name in choose("time", table.left_out) if name not in table]
    if left_out and table.left_out[left_out[0]] == UNTIMED:
        raise RecordingError(f"column '{left_out[0]}' holds {UNTIMED}; give --rate HZ")
    if left_out:
        raise RecordingError(
            f"column '{left_out[0]}' holds {table.left_out[left_out[0]]}, no times; write dates as"
            " 2026-10-25 23:59:50.5 or give --rate"
        )
    if not rising:  # seconds whose parts stand in another column
        rising = [name for name in table if name not in others and find_fraction(table, name, _unit(table, name))[0]]
    if not rising:
        rising = [name for name in table if name not in others and holds_steps(name, table[name])]
    if len(rising) != 1:
        without = "".join(f"; '{name}' holds {what}" for name, what in table.left_out.items())
        raise RecordingError(f"no column of times; give --time or --rate. Columns: {describe(table)}{without}")
    (name,) = rising
    if not unit_in_name(name) and rises(table[name]) and counts_rows(name, table[name]):
        raise RecordingError(
            f"no column of times: '{name}' seems to count the rows; give --rate HZ, or --time '{name}' with --time-unit"
        )
    return name
