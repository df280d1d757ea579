"""textile-twin faults: the fault book of a suite, listed, acknowledged, and each fault's recording in the viewer."""

from __future__ import annotations

import argparse
import getpass
import sys
from dataclasses import asdict
from datetime import datetime
from pathlib import Path

from textile_twin_core.cli import view
from textile_twin_core.cli.arguments import Parser
from textile_twin_core.cli.mistakes import UsageError
from textile_twin_core.cli.outputs import check_outputs, save_json
from textile_twin_core.recordings.fault_book import Fault, FaultBook

_ALL = "all"


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "faults",
        "The fault book that monitor_node and fault_node keep in the folder BOOK:\n"
        "list: every fault in a line. show N: all that the book has of one. ack N ..|all: acknowledge.\n"
        "open N: the fault's own recording in the viewer, or with --png its picture.",
        "textile-twin faults out/faults open 3",
    )
    parser.add_argument("book", metavar="BOOK", type=Path, help="folder of the fault book")
    parser.add_argument("what", nargs="?", choices=["list", "show", "ack", "open"], default="list")
    parser.add_argument("numbers", metavar="N", nargs="*", help="numbers of faults, as the list shows them")
    parser.add_argument(
        "--by", default="", metavar="NAME", help="with ack: who acknowledges (default: the user's name)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="with list: write the faults")
    parser.add_argument("--png", type=Path, metavar="FILE", help="with open: a picture instead of the viewer")
    parser.add_argument("--machine", metavar="MACHINE", help="with open: another machine or file than the monitor's")
    return parser


def run(arguments: argparse.Namespace) -> None:
    """List, show or acknowledge faults, or open a recording."""
    check_outputs(arguments)
    book = FaultBook(arguments.book)
    faults = book.faults()
    if arguments.what == "list":
        _list(faults, arguments.json)
        return
    chosen = _chosen(faults, arguments)
    if arguments.what == "ack":
        fresh = book.acknowledge([fault.number for fault in chosen], arguments.by or getpass.getuser())
        print(f"acknowledged: {', '.join(map(str, fresh)) or 'none, all were before'}")
    elif arguments.what == "show":
        for fault in chosen:
            print("\n".join(f"{name:16} {_shown(name, value)}" for name, value in asdict(fault).items()))
    else:
        _open(book, chosen[0], arguments)


def _chosen(faults: list[Fault], arguments: argparse.Namespace) -> list[Fault]:
    """Return the faults that the command line names.

    Raises:
        UsageError: it names no fault, or an unknown one.
    """
    if arguments.what == "ack" and arguments.numbers == [_ALL]:
        return faults
    if not arguments.numbers or (arguments.what == "open" and len(arguments.numbers) > 1):
        raise UsageError(f"{arguments.what}: give the number of {'a' if arguments.what != 'open' else 'one'} fault")
    by_number = {str(fault.number): fault for fault in faults}
    for number in arguments.numbers:
        if number not in by_number:
            raise UsageError(f"{arguments.book}: no fault {number}; it has {len(faults)}")
    return [by_number[number] for number in arguments.numbers]


def _list(faults: list[Fault], json_file: Path | None) -> None:
    save_json(json_file, {"faults": [asdict(fault) for fault in faults]})
    if not faults:
        print("no faults")
        return
    several = len({fault.source for fault in faults}) > 1
    for fault in faults:
        where = f"{fault.source:12} " if several else ""
        print(f"{fault.number:4} {_time(fault.raised_ns)} {where}{_life(fault):26} {fault.text}")
    fresh = sum(fault.acknowledged_ns is None for fault in faults)
    print(f"{sum(fault.cleared_ns is None for fault in faults)} stand, {fresh} not acknowledged", file=sys.stderr)


def _life(fault: Fault) -> str:
    stands = "stands" if fault.cleared_ns is None else "cleared"
    return f"{stands}, {'not acknowledged' if fault.acknowledged_ns is None else 'acknowledged'}"


def _time(time_ns: int) -> str:
    return datetime.fromtimestamp(time_ns * 1e-9).strftime("%Y-%m-%d %H:%M:%S")


def _shown(name: str, value: object) -> str:
    if value is None:
        return "to come" if name == "recording" else "not yet"
    if name.endswith("_ns") and isinstance(value, int):
        return f"{value} ({_time(value)})"
    return str(value) or ("none: nothing was recorded" if name == "recording" else "-")


def _open(book: FaultBook, fault: Fault, arguments: argparse.Namespace) -> None:
    """Show a fault's own recording as `view` does.

    Raises:
        UsageError: there is no recording, or not yet.
    """
    if not fault.recording:
        why = "is made some seconds after the alarm, while fault_node runs" if fault.recording is None else "is empty"
        raise UsageError(f"fault {fault.number}: its recording {why}; textile-twin faults {book.folder} show N")
    words = [str(book.folder / fault.recording), "--machine", arguments.machine or fault.machine]
    words += ["--png", str(arguments.png)] if arguments.png is not None else []
    view.run(view.parser().parse_args(words))
