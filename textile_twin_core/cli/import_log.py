"""textile-twin import: recording from the table of any data logger."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Container, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from textile_twin_core.cli.arguments import Parser, factor, number, positive
from textile_twin_core.cli.mistakes import UsageError
from textile_twin_core.cli.named_machine import load_linkage
from textile_twin_core.cli.progress import aside, stages
from textile_twin_core.recordings import BagWriter
from textile_twin_core.recordings.log_apply import LoggedSamples, apply
from textile_twin_core.recordings.log_clock_guess import Ask
from textile_twin_core.recordings.log_files import READERS, read_table
from textile_twin_core.recordings.log_guess import guess, guess_torque_log
from textile_twin_core.recordings.log_mapping import (
    NO_COLUMN,
    Channel,
    Clock,
    LogMapping,
    LongForm,
    OtherLogger,
    mapping_path,
    read_mapping,
    write_mapping,
)
from textile_twin_core.recordings.log_table import Columns
from textile_twin_core.recordings.log_units import choose
from textile_twin_core.recordings.two_loggers import on_clock_of_angle

_KINDS = {
    "time": "s, ms, us, ns, min, hours, days",
    "angle": "deg, rad, rev, gon, or the counts of a turn",
    "torque": "N m, N cm, N mm, kN m, lbf ft, ..",
    "speed": "rpm, rad/s, deg/s, rev/s",
}

_NONE = {"torque": "; none: do not take one", "speed": "; none: do not take one"}
_MOST_HZ = 1e8
"""Largest sampling rate [Hz], since stamps are whole nanoseconds."""
_READ = 0.3
"""Share of the work for reading the table."""
_LIKE_A_SAMPLE = 1000
"""Bytes of a log that take as long as one sample of a recording."""


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "import",
        "Makes a recording from a log: CSV with any separator, decimal comma, with or without a header; rows that\n"
        "label each value; Parquet; MATLAB; HDF5, TDMS and MDF4 with the extra 'logs'. Columns are recognised by\n"
        "their names, units by their names or by the height at which an angle wraps; otherwise the options give them.\n"
        "The mapping is written beside the recording, BAG.mapping.yaml: correct it, and give it back with --mapping.",
        "textile-twin import log.csv --out bag --angle 'Winkel [deg]' --torque 'Md' --torque-unit Ncm",
    )
    parser.add_argument(
        "log",
        metavar="LOG",
        type=Path,
        help=f"the table; .parquet, {', '.join(READERS)} by their names, else text",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="BAG", help="folder to make, or an .mcap file")
    for kind, units in _KINDS.items():
        parser.add_argument(f"--{kind}", metavar="COLUMN", help=f"column of the {kind}{_NONE.get(kind, '')}")
        parser.add_argument(f"--{kind}-unit", metavar="UNIT", help=units)
    parser.add_argument(
        "--second-angle", metavar="COLUMN", help="column of a second encoder at `second_encoder_at` of an elastic shaft"
    )
    parser.add_argument("--second-angle-unit", metavar="UNIT", help="as --angle-unit, which counts unless given")
    parser.add_argument("--mapping", type=Path, metavar="FILE", help="columns, units and times from an earlier import")
    parser.add_argument(
        "--time-fraction",
        metavar="COLUMN",
        help="parts of a second, beside a column of whole seconds; none: no such column",
    )
    parser.add_argument("--time-steps", action="store_true", help="the times are those since the row before")
    parser.add_argument("--torque-time", metavar="COLUMN", help="column of the torque's own times")
    other = parser.add_argument_group(
        "torque in the file of a second logger; --torque, --torque-unit .. are its columns"
    )
    other.add_argument("--torque-log", type=Path, metavar="LOG2", help="the file; its clock is found by what both hold")
    other.add_argument("--torque-time-unit", metavar="UNIT", help="of its times, as --time-unit")
    other.add_argument("--torque-log-speed", metavar="COLUMN", help="its column of the shaft's speed, in any unit")
    other.add_argument("--torque-offset", type=number, metavar="S", help="added to its times, if it is known")
    other.add_argument("--machine", help="predicts the torque, for a second log without a speed")
    parser.add_argument(
        "--signal-column",
        metavar="COLUMN",
        help="names of the signals, in a log with a row for each value; none: no such",
    )
    parser.add_argument("--value-column", metavar="COLUMN", help="their values")
    parser.add_argument(
        "--quantity",
        metavar="OUTPUT=COLUMN",
        action="append",
        default=[],
        help="a measured displacement, angle or speed by the machine's output that it is a measurement of, such as"
        " sley_position_m=camera; may be repeated",
    )
    parser.add_argument("--quantity-unit", metavar="UNIT", help="mm, m, cm, deg, rad, mm/s, rpm, N, ..")
    parser.add_argument("--rate", type=_rate, metavar="HZ", help="rows a second, for a log without times")
    parser.add_argument("--torque-scale", type=factor, metavar="X", help="N m per unit of the torque, as for volts")
    parser.add_argument("--separator", metavar="C", help="of a text table, where it is not found out; 'tab' for tabs")
    parser.add_argument("--decimal", choices=[".", ","], help="of a text table, where it is not found out")
    parser.add_argument("--table", metavar="NAME", help="variable or group of the file that holds the log")
    parser.add_argument("--force", action="store_true", help="overwrite the output if it exists")
    return parser


def _rate(text: str) -> float:
    rate = positive(text)
    if rate > _MOST_HZ:
        raise argparse.ArgumentTypeError(f"must be at most {_MOST_HZ:g} rows a second, not '{text}'")
    return rate


def run(arguments: argparse.Namespace) -> None:
    """Read the log, map its columns, write the recording and report."""
    _check_conflicts(arguments)
    wished = _mapping(arguments)
    separator = "\t" if arguments.separator == "tab" else arguments.separator
    described = mapping_path(arguments.out)
    written = arguments.mapping is None
    if written and described.exists() and not arguments.force:
        raise UsageError(f"{described} exists; give it with --mapping, or replace it with --force")
    ask = _ask if sys.stdin.isatty() and sys.stdout.isatty() else None
    with stages(_size(arguments.log) // _LIKE_A_SAMPLE) as stage:
        stage("reading", _READ, 1)
        # Opened first, so that an unwritable place fails before the work.
        with BagWriter(arguments.out, {"imported_from": arguments.log.name}, overwrite=arguments.force) as out:
            form = wished.text if arguments.separator is None and arguments.decimal is None else None
            columns, head = read_table(
                arguments.log, separator, arguments.decimal, arguments.table, form, wished.signals
            )
            for note in head.notes:
                _note(note)
            rows = max(map(len, columns.values()))
            done = stage("writing", 1.0, rows * (2 + len(wished.quantities)))
            found = guess(columns, head, wished, ask)
            mapping = found.mapping
            samples = apply(mapping, columns)
            reasons = dict(found.reasons)
            if wished.torque_log is not None:
                mapping, samples = _with_torque_log(arguments, mapping, columns, samples, reasons, ask)
            samples.write(out, done or _uncounted)
            counts = out.counts
        if written:
            write_mapping(described, replace(mapping, text=head.text, signals=head.long_form), arguments.log.name)
    _report(reasons, mapping, samples, head.signals)
    if samples.torque is None and not wished.quantities and wished.torque.column != NO_COLUMN:
        print("torque  none in this log; name its column with --torque if there is one")
        for name in choose("torque", head.left_out):
            print(f"note    column '{name}' holds {head.left_out[name]}, no numbers")
    for topic, count in counts.items():
        print(f"{topic}  {count} messages")
    if written:
        print(f"mapping {described}: columns, units and times as taken; correct them and give them with --mapping")


def _with_torque_log(
    arguments: argparse.Namespace,
    mapping: LogMapping,
    columns: Columns,
    samples: LoggedSamples,
    reasons: dict[str, str],
    ask: Ask | None,
) -> tuple[LogMapping, LoggedSamples]:
    """Read the second logger's file, bring its clock to that of the angle, and add its torque."""
    wished = mapping.torque_log
    assert wished is not None
    other, head = read_table(arguments.torque_log, text=wished.text)
    for note in head.notes:
        _note(note)
    torque_log, shared, its_reasons = guess_torque_log(other, head, wished, ask)
    torque_log = replace(torque_log, text=head.text, offset_s=wished.offset_s, drift=wished.drift)
    reasons |= its_reasons
    if wished.offset_s is None:
        machine = None if arguments.machine is None else load_linkage(arguments.machine, [])
        found = on_clock_of_angle(mapping, columns, samples.angle, torque_log, other, shared, machine)
        torque_log, reasons["clocks"] = found.torque_log, found.text
    mapping = replace(mapping, torque_log=torque_log)
    return mapping, apply(mapping, columns, other)


def _report(
    reasons: Mapping[str, str], mapping: LogMapping, samples: LoggedSamples, signals: Container[str] = ()
) -> None:
    """Print how each column was read."""
    notes = {"time": samples.clock_note, "angle": samples.angle.note}
    torque = mapping.torque if mapping.torque_log is None else mapping.torque_log.torque
    named = {"angle": mapping.angle, "torque": torque, "speed": mapping.speed}
    named |= {"second angle": mapping.second_angle, **mapping.quantities}
    others = {"torque": samples.torque, "second angle": samples.second_angle, **samples.quantities}
    notes |= {kind: channel.note for kind, channel in others.items() if channel is not None}
    for kind, reason in reasons.items():
        column = named[kind].column if kind in named else NO_COLUMN
        about = f"column '{column}', " if column != NO_COLUMN else ""
        note = "" if column in signals else notes.get(kind, "")  # rows of other signals have no number
        print(f"{kind:7} {about}{reason}{note}")


def _mapping(arguments: argparse.Namespace) -> LogMapping:
    """Combine the mapping file with the arguments, which take precedence."""
    mapping = LogMapping() if arguments.mapping is None else read_mapping(arguments.mapping)
    clock = mapping.clock
    if arguments.rate is not None:
        clock = Clock(rate_hz=arguments.rate)
    if arguments.time is not None:
        clock = Clock(arguments.time)
    clock = replace(
        clock,
        unit=arguments.time_unit or clock.unit,
        fraction=arguments.time_fraction or clock.fraction,
        steps=arguments.time_steps or clock.steps,
    )
    channels: dict[str, Any] = {}
    for kind in ("angle", "torque", "speed"):
        column, unit = getattr(arguments, kind), getattr(arguments, f"{kind}_unit")
        channel = getattr(mapping, kind) if column is None else Channel(column)
        channels[kind] = replace(channel, unit=unit, scale=None) if unit else channel
    if arguments.second_angle is not None:
        channels["second_angle"] = Channel(arguments.second_angle, arguments.second_angle_unit or "")
    else:
        channels["second_angle"] = mapping.second_angle
    if arguments.torque_scale is not None:
        channels["torque"] = replace(channels["torque"], scale=arguments.torque_scale)
    if arguments.torque_time is not None:
        channels["torque"] = replace(channels["torque"], clock=Clock(arguments.torque_time))
    torque_log = mapping.torque_log
    if arguments.torque_log is not None:
        torque_log = _torque_log(arguments, torque_log or OtherLogger(), channels["torque"])
        channels["torque"] = Channel(NO_COLUMN)
    elif torque_log is not None:
        raise UsageError("the mapping has a torque_log: give its file with --torque-log LOG2")
    quantities = dict(mapping.quantities)
    for text in arguments.quantity:
        output, column = _pair("quantity", text)
        quantities[output] = Channel(column, arguments.quantity_unit or "")
    signals = mapping.signals
    if arguments.mapping is not None and signals is None:
        signals = LongForm("", "")
    if arguments.signal_column is not None:
        named = arguments.signal_column != NO_COLUMN
        signals = LongForm(arguments.signal_column, arguments.value_column or "value") if named else LongForm("", "")
    return LogMapping(
        clock, **channels, quantities=quantities, text=mapping.text, signals=signals, torque_log=torque_log
    )


def _torque_log(arguments: argparse.Namespace, known: OtherLogger, torque: Channel) -> OtherLogger:
    """Combine the second log's part of the mapping with the arguments, which take precedence."""
    clock, shared = known.clock, known.shared
    if arguments.torque_time is not None:
        clock = Clock(arguments.torque_time)
    if arguments.torque_time_unit is not None:
        clock = replace(clock, unit=arguments.torque_time_unit)
    if arguments.torque_log_speed is not None:
        shared = Channel(arguments.torque_log_speed)
    given = torque.column not in ("", NO_COLUMN) or bool(torque.unit) or torque.scale is not None
    offset_s = known.offset_s if arguments.torque_offset is None else arguments.torque_offset
    torque = replace(torque, clock=None, column="" if torque.column == NO_COLUMN else torque.column)
    return replace(known, clock=clock, torque=torque if given else known.torque, shared=shared, offset_s=offset_s)


def _size(path: Path) -> int:
    """Return the size of a file [bytes]; 0 if it is missing, which is reported on reading."""
    return path.stat().st_size if path.is_file() else 0


def _uncounted(_rows: int) -> None:
    """Do nothing, in place of a progress bar."""


def _note(text: str) -> None:
    with aside():
        print(f"note    {text}", flush=True)


def _check_conflicts(arguments: argparse.Namespace) -> None:
    """Raise UsageError for options of which one would be ignored."""
    together = [
        ("rate", ["time", "time_unit"]),
        ("torque_scale", ["torque_unit"]),
    ]
    for option, others in together:
        for other in others:
            if getattr(arguments, option) and getattr(arguments, other):
                raise UsageError(f"--{option} and --{other} cannot be combined: leave one out".replace("_", "-"))
    alone = [
        ("quantity_unit", "quantity"),
        *((name, "torque_log") for name in ("torque_time_unit", "torque_log_speed", "torque_offset", "machine")),
        ("second_angle_unit", "second_angle"),
    ]
    for option, what in alone:
        if getattr(arguments, option) is not None and not getattr(arguments, what):
            raise UsageError(f"--{option} goes with --{what}".replace("_", "-"))


def _ask(kind: str, names: list[str]) -> str:
    """Ask which column is meant; an empty answer means none."""
    with aside():
        return _answer(kind, names)


def _answer(kind: str, names: list[str]) -> str:
    print(f"Which column is the {kind}?")
    for k, name in enumerate(names, 1):
        print(f"  {k}  {name}")
    while True:
        answer = input("number or name (empty: none): ").strip()
        if not answer or answer in names:
            return answer
        if answer.isdecimal() and 1 <= int(answer) <= len(names):
            return names[int(answer) - 1]


def _pair(option: str, text: str) -> tuple[str, str]:
    name, equals, column = text.partition("=")
    if not (name and equals and column):
        raise UsageError(f"--{option} {text}: write NAME=COLUMN")
    return name, column
