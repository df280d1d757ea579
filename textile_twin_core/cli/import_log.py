"""textile-twin import: a recording from any logger's table."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

from textile_twin_core.cli.arguments import Parser, factor, number, positive
from textile_twin_core.cli.mistakes import UsageError
from textile_twin_core.cli.named_machine import load_linkage
from textile_twin_core.cli.progress import aside, stages
from textile_twin_core.recordings import BagWriter
from textile_twin_core.recordings.log_columns import choose
from textile_twin_core.recordings.log_import import RawChannels, Wishes, import_log
from textile_twin_core.recordings.log_read import read_log

_KINDS = {
    "time": "s, ms, us, ns, min, hours, days",
    "angle": "deg, rad, rev, gon, or the counts of a turn",
    "torque": "N m, N cm, N mm, kN m, lbf ft, ..",
    "speed": "rpm, rad/s, deg/s, rev/s",
}

_MOST_HZ = 1e8
"""Stamps are in whole nanoseconds."""
_READ = 0.3
"""Share of all work at which the table is read."""
_LIKE_A_SAMPLE = 1000
"""Bytes of a log that take as long as a sample of a recording does elsewhere."""


def parser() -> Parser:
    """The command's arguments."""
    parser = Parser(
        "import",
        "Makes a recording from a log: CSV with any separator, decimal comma, with or without a header; Parquet;\n"
        "MATLAB. Columns are found by their names, units by their names or by how a wrapped angle begins anew; what\n"
        "is not found is asked for, or told with the options.",
        "textile-twin import log.csv --out bag --angle 'Winkel [deg]' --torque 'Md' --torque-unit Ncm",
    )
    parser.add_argument("log", metavar="LOG", type=Path, help="the table; .parquet and .mat by their names, else text")
    parser.add_argument("--out", type=Path, required=True, metavar="BAG", help="folder to make, or an .mcap file")
    for kind, units in _KINDS.items():
        parser.add_argument(f"--{kind}", metavar="COLUMN", help=f"column of the {kind}")
        parser.add_argument(f"--{kind}-unit", metavar="UNIT", help=units)
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
    parser.add_argument("--table", metavar="NAME", help="variable of a .mat file that holds the log")
    parser.add_argument("--force", action="store_true", help="replace the output when it is there")
    return parser


def _rate(text: str) -> float:
    rate = positive(text)
    if rate > _MOST_HZ:
        raise argparse.ArgumentTypeError(f"must be at most {_MOST_HZ:g} rows a second, not '{text}'")
    return rate


def run(arguments: argparse.Namespace) -> None:
    """Read, choose, write, tell."""
    _refuse_what_does_nothing(arguments)
    quantities = dict(_pair("quantity", text) for text in arguments.quantity)
    separator = "\t" if arguments.separator == "tab" else arguments.separator
    wishes = Wishes(
        columns={kind: name for kind in _KINDS if (name := getattr(arguments, kind)) is not None},
        units={kind: unit for kind in (*_KINDS, "quantity") if (unit := getattr(arguments, f"{kind}_unit"))},
        rate_hz=arguments.rate,
        torque_scale=arguments.torque_scale,
        quantities=quantities,
        raw=_raw(arguments),
    )
    ask = _ask if sys.stdin.isatty() and sys.stdout.isatty() else None
    with stages(_size(arguments.log) // _LIKE_A_SAMPLE) as stage:
        stage("reading", _READ, 1)
        # Opened first: a place that cannot be written is told before the work.
        with BagWriter(arguments.out, {"imported_from": arguments.log.name}, overwrite=arguments.force) as out:
            columns = read_log(arguments.log, separator, arguments.decimal, arguments.table, _note)
            rows = len(next(iter(columns.values())))
            done = stage("writing", 1.0, rows * (2 + len(quantities)))
            taken = import_log(columns, out, wishes, ask, done or _uncounted)
            counts = out.counts
    for kind, text in taken.items():
        print(f"{kind:7} {text}")
    if "torque" not in taken and not quantities:
        print("torque  none in this log; name its column with --torque if there is one")
        for name in choose("torque", columns.left_out):
            print(f"note    column '{name}' holds {columns.left_out[name]}, no numbers")
    for topic, count in counts.items():
        print(f"{topic}  {count} messages")


def _size(path: Path) -> int:
    """Bytes of a file; 0 where there is none, which is told when it is read."""
    return path.stat().st_size if path.is_file() else 0


def _uncounted(_rows: int) -> None:
    """No bar."""


def _note(text: str) -> None:
    with aside():
        print(f"note    {text}", flush=True)


def _refuse_what_does_nothing(arguments: argparse.Namespace) -> None:
    """Raises UsageError when options are told together of which one would be ignored."""
    together = [
        ("rate", ["time", "time_unit"]),
        ("torque_scale", ["torque_unit"]),
        ("pickup", [name for kind in ("angle", "torque", "speed") for name in (kind, f"{kind}_unit")]),
        ("pickup", ["torque_scale", "quantity"]),
    ]
    for option, others in together:
        for other in others:
            if getattr(arguments, option) and getattr(arguments, other):
                raise UsageError(f"--{option} and --{other} cannot both be told: leave one out".replace("_", "-"))
    alone = [("quantity_unit", "quantity"), ("drive_force_scale", "drive_force"), ("drive_force_zero", "drive_force")]
    for option, what in alone:
        if getattr(arguments, option) is not None and not getattr(arguments, what):
            raise UsageError(f"--{option} goes with --{what}".replace("_", "-"))


def _ask(kind: str, names: list[str]) -> str:
    """Ask which column is meant; an empty answer is none."""
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
    """What the arguments say of raw channels; None without a pickup."""
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
