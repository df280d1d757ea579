"""textile-twin import: recording from the table of any data logger."""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import replace
from pathlib import Path

from textile_twin_core.cli.arguments import Parser, factor, number, positive
from textile_twin_core.cli.mistakes import UsageError
from textile_twin_core.cli.named_machine import load_linkage
from textile_twin_core.cli.progress import aside, stages
from textile_twin_core.recordings import BagWriter
from textile_twin_core.recordings.log_columns import choose
from textile_twin_core.recordings.log_import import RawChannels, import_log
from textile_twin_core.recordings.log_mapping import (
    NO_COLUMN,
    Channel,
    Clock,
    LogMapping,
    LongForm,
    mapping_path,
    read_mapping,
    write_mapping,
)
from textile_twin_core.recordings.log_read import read_log

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
        "Makes a recording from a log: CSV with any separator, decimal comma, with or without a header; Parquet;\n"
        "MATLAB; HDF5, TDMS and MDF4 with the extra 'logs'. Columns are found by their names, units by their names or\n"
        "by the height at which a wrapped angle wraps; what is not found is asked for, or given by the options. What\n"
        "was found is written beside the recording, BAG.mapping.yaml: correct it, and give it back with --mapping.",
        "textile-twin import log.csv --out bag --angle 'Winkel [deg]' --torque 'Md' --torque-unit Ncm",
    )
    parser.add_argument(
        "log",
        metavar="LOG",
        type=Path,
        help="the table; .parquet, .mat, .h5, .tdms and .mf4 by their names, else text",
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
    raw = parser.add_argument_group("raw channels of a test rig, with --machine")
    raw.add_argument("--machine", help="a machine: its encoder's teeth, and how the force's point moves")
    raw.add_argument("--pickup", metavar="COLUMN", help="voltage of a pickup on a toothed wheel, instead of an angle")
    raw.add_argument("--drive-force", metavar="MEASURE=COLUMN", help="a force along a measure, which drives the shaft")
    raw.add_argument("--drive-force-scale", type=factor, metavar="X", help="N per unit; default 1")
    raw.add_argument(
        "--drive-force-zero",
        type=number,
        metavar="DEG",
        help="shaft angle without a force, for sensors that drift",
    )
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
    mapping = _mapping(arguments)
    quantities = mapping.quantities
    separator = "\t" if arguments.separator == "tab" else arguments.separator
    described = mapping_path(arguments.out)
    written = arguments.mapping is None and arguments.pickup is None
    if written and described.exists() and not arguments.force:
        raise UsageError(f"{described} exists; give it with --mapping, or replace it with --force")
    ask = _ask if sys.stdin.isatty() and sys.stdout.isatty() else None
    with stages(_size(arguments.log) // _LIKE_A_SAMPLE) as stage:
        stage("reading", _READ, 1)
        # Opened first, so that an unwritable place fails before the work.
        with BagWriter(arguments.out, {"imported_from": arguments.log.name}, overwrite=arguments.force) as out:
            table = read_log(
                arguments.log,
                separator,
                arguments.decimal,
                arguments.table,
                _note,
                mapping.text if arguments.separator is None and arguments.decimal is None else None,
                mapping.signals,
            )
            rows = max(map(len, table.values()))
            done = stage("writing", 1.0, rows * (2 + len(quantities)))
            mapping, taken = import_log(table, out, mapping, ask, done or _uncounted, _raw(arguments))
            counts = out.counts
        if written:
            write_mapping(described, replace(mapping, text=table.text, signals=table.long_form), arguments.log.name)
    for kind, text in taken.items():
        print(f"{kind:7} {text}")
    if "torque" not in taken and not quantities and mapping.torque.column != arguments.torque:
        print("torque  none in this log; name its column with --torque if there is one")
        for name in choose("torque", table.left_out):
            print(f"note    column '{name}' holds {table.left_out[name]}, no numbers")
    for topic, count in counts.items():
        print(f"{topic}  {count} messages")
    if written:
        print(f"mapping {described}: columns, units and times as taken; correct them and give them with --mapping")


def _mapping(arguments: argparse.Namespace) -> LogMapping:
    """Combine the mapping file with the arguments, which take precedence."""
    mapping = LogMapping() if arguments.mapping is None else read_mapping(arguments.mapping)
    clock = mapping.clock
    if arguments.rate is not None:
        clock = replace(clock, column="", unit="", fraction="", steps=False, rate_hz=arguments.rate)
    if arguments.time is not None:
        clock = replace(clock, column=arguments.time, unit="", fraction="", fraction_unit="", rate_hz=None)
    clock = replace(
        clock,
        unit=arguments.time_unit or clock.unit,
        fraction=arguments.time_fraction or clock.fraction,
        steps=arguments.time_steps or clock.steps,
    )
    channels: dict[str, Channel] = {}
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
    return LogMapping(clock, **channels, quantities=quantities, text=mapping.text, signals=signals)


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
        ("pickup", [name for kind in ("angle", "torque", "speed") for name in (kind, f"{kind}_unit")]),
        ("pickup", ["torque_scale", "quantity"]),
    ]
    for option, others in together:
        for other in others:
            if getattr(arguments, option) and getattr(arguments, other):
                raise UsageError(f"--{option} and --{other} cannot be combined: leave one out".replace("_", "-"))
    alone = [
        ("quantity_unit", "quantity"),
        ("second_angle_unit", "second_angle"),
        ("drive_force_scale", "drive_force"),
        ("drive_force_zero", "drive_force"),
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


def _raw(arguments: argparse.Namespace) -> RawChannels | None:
    """Return the raw channels named by the arguments; None without a pickup."""
    if arguments.pickup is None:
        if arguments.drive_force is not None or arguments.machine is not None:
            raise UsageError("--machine and --drive-force go with --pickup")
        return None
    if arguments.machine is None:
        raise UsageError("--pickup needs --machine, whose encoder says how many teeth the wheel has")
    measure, force = ("", "") if arguments.drive_force is None else _pair("drive-force", arguments.drive_force)
    zero = None if arguments.drive_force_zero is None else math.radians(arguments.drive_force_zero)
    machine = load_linkage(arguments.machine, [])
    return RawChannels(machine, arguments.pickup, measure, force, arguments.drive_force_scale or 1.0, zero)


def _pair(option: str, text: str) -> tuple[str, str]:
    name, equals, column = text.partition("=")
    if not (name and equals and column):
        raise UsageError(f"--{option} {text}: write NAME=COLUMN")
    return name, column
