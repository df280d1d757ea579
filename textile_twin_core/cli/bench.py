"""textile-twin bench: speed against error on this computer."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path

from textile_twin_core.cli.arguments import Parser, add_machine, count, load_linkage


def parser() -> Parser:
    """The command's arguments."""
    parser = Parser(
        "bench",
        "Speed against error on this computer: our methods, the same closed form in C where a compiler is at hand,\n"
        "and with --peers other libraries that are installed (requirements-peers.lock). All take turns in one\n"
        "process; times are medians, errors are against extended precision.",
        "textile-twin bench --json bench.json --png bench.png",
    )
    add_machine(parser, option=True, required=False)
    parser.set_defaults(machine="tufting")
    parser.add_argument("--peers", action="store_true", help="other libraries too")
    parser.add_argument("--growth", action="store_true", help="time and memory as samples, machines, linkages grow")
    parser.add_argument("--rounds", type=count, default=11, metavar="N", help="rounds of turns (default %(default)s)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows; is replaced when it is there")
    parser.add_argument("--png", type=Path, metavar="FILE", help="draw error against time; is replaced")
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Measure, print, write."""
    from textile_twin_core.bench.growth import growth
    from textile_twin_core.bench.plots import plot_work_precision
    from textile_twin_core.bench.ratios import ratios
    from textile_twin_core.bench.run import run_bench
    from textile_twin_core.bench.text import growth_table, heading, ratio_lines, speed_table
    from textile_twin_core.bench.timing import bench_core
    from textile_twin_core.files import staged

    machine = load_linkage(arguments.machine, arguments.set)
    rows = run_bench(machine, arguments.peers, arguments.rounds, progress=_bar("bench"), say=_complain)
    print(heading(bench_core(), arguments.rounds))
    print(f"\n{speed_table(rows)}")
    if ratios(rows):
        print(f"\n{ratio_lines(ratios(rows))}")
    grown = growth(machine, _bar("growth")) if arguments.growth else []
    if grown:
        print(f"\n{growth_table(grown)}")
    if arguments.json:
        report = {"rows": [row.to_json() for row in rows], "growth": [row.to_json() for row in grown]}
        with staged(arguments.json) as partial:
            partial.write_text(json.dumps(report, indent=1) + "\n")
    if arguments.png:
        with staged(arguments.png) as partial:
            plot_work_precision(rows, partial)


def _complain(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _bar(what: str) -> Callable[[int, int], object]:
    """Progress for people: nothing where standard error is no terminal."""

    def show(done: int, total: int) -> None:
        if sys.stderr.isatty():
            end = "\n" if done == total else ""
            print(f"\r{what} {100 * done // total} %", end=end, file=sys.stderr, flush=True)

    return show
