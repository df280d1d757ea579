"""textile-twin bench: speed against error on this computer."""

from __future__ import annotations

import argparse
import json
import sys
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path

from textile_twin_core.bench.ratios import ratios
from textile_twin_core.bench.run import run_bench
from textile_twin_core.bench.text import heading, ratio_lines, speed_table
from textile_twin_core.bench.timing import bench_core
from textile_twin_core.bench.yardsticks import YARDSTICK
from textile_twin_core.cli.arguments import Parser, add_machine, count
from textile_twin_core.cli.named_machine import load_linkage
from textile_twin_core.files import staged


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "bench",
        "Speed against error on this computer: our methods, the same closed form in C where a compiler is at hand,\n"
        "and with --peers, in the repository, other libraries (tests/benchmarks/README.md). All take turns in one\n"
        "process on one core; times are medians, errors are against extended precision. Ratios are taken round by\n"
        "round: they hold on any computer.",
        "textile-twin bench --json bench.json",
    )
    add_machine(parser, option=True, required=False)
    parser.set_defaults(machine="tufting")
    parser.add_argument("--peers", action="store_true", help="other libraries too; in the repository alone")
    parser.add_argument("--rounds", type=count, default=11, metavar="N", help="rounds of turns (default %(default)s)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write rows and ratios; overwritten if it exists")
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Measure, print and write the table."""
    machine = load_linkage(arguments.machine, arguments.set)
    with ExitStack() as files:  # opened first, so that an unwritable file fails before the work
        report = files.enter_context(staged(arguments.json)) if arguments.json else None
        print(heading(bench_core(), arguments.rounds), flush=True)
        rows = run_bench(machine, arguments.peers, arguments.rounds, progress=_show, say=_complain)
        compared = ratios(rows)
        for block in (speed_table(rows), ratio_lines(compared)):
            if block:
                print(f"\n{block}", flush=True)
        if report:
            methods = [asdict(row) for row in rows if row.peer != YARDSTICK]
            found = {"rows": methods, "ratios": [asdict(ratio) for ratio in compared]}
            report.write_text(json.dumps(found, indent=1) + "\n")


def _complain(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _show(done: int, total: int) -> None:
    """Show progress if standard error is a terminal."""
    if sys.stderr.isatty():
        end = "\n" if done == total else ""
        print(f"\rbench {100 * done // total} %", end=end, file=sys.stderr, flush=True)
