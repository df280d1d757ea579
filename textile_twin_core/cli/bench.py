"""textile-twin bench: speed against error on this computer."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path

from textile_twin_core.bench.growth import growth
from textile_twin_core.bench.impact_table import impact_table
from textile_twin_core.bench.ratios import impact_ratios, ratios
from textile_twin_core.bench.run import run_bench
from textile_twin_core.bench.shaft_table import shaft_table
from textile_twin_core.bench.text import growth_table, heading, impact_lines, ratio_lines, shaft_lines, speed_table
from textile_twin_core.bench.timing import bench_core
from textile_twin_core.bench.yardsticks import YARDSTICK
from textile_twin_core.cli.arguments import Parser, add_machine, count
from textile_twin_core.cli.mistakes import UsageError
from textile_twin_core.cli.named_machine import load_linkage
from textile_twin_core.files import staged
from textile_twin_core.machine import Machine

Rows = list[dict[str, object]]

_MORE = ("growth", "shaft", "impacts")
_DRAWN = {"shaft", "impacts"}


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "bench",
        "Speed against error on this computer: our methods, the same closed form in C where a compiler is at hand,\n"
        "and with --peers, in the repository, other libraries (tests/benchmarks/README.md). All take turns in one\n"
        "process on one core; times are medians, errors are against extended precision. Ratios are taken round by\n"
        "round: they hold on any computer.",
        "textile-twin bench --all --json bench.json --png bench.png",
    )
    add_machine(parser, option=True, required=False)
    parser.set_defaults(machine="tufting")
    parser.add_argument("--peers", action="store_true", help="other libraries too; in the repository alone")
    parser.add_argument("--growth", action="store_true", help="time and memory as samples, machines, linkages grow")
    parser.add_argument(
        "--shaft",
        action="store_true",
        help="error of the torque against latency and cost for the estimators of the shaft's motion (two minutes)",
    )
    parser.add_argument(
        "--impacts",
        action="store_true",
        help="error of the event times against time for a run: the needle transfer by its event-driven integrator, by"
        " solve_ivp with events, by penalty contact",
    )
    parser.add_argument("--all", action="store_true", help="--growth, --shaft and --impacts")
    parser.add_argument("--rounds", type=count, default=11, metavar="N", help="rounds of turns (default %(default)s)")
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help="write rows, ratios, growth, shaft, impacts; overwritten if it exists"
    )
    parser.add_argument(
        "--png",
        type=Path,
        metavar="FILE",
        help="draw error against time; --shaft and --impacts go into files of that name with _shaft and _impacts"
        " before the suffix; all are overwritten",
    )
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Measure, print and write the tables."""
    if arguments.png and arguments.png.suffix.lower() != ".png":
        raise UsageError(f"--png {arguments.png}: the name must end in .png")
    if arguments.png:
        import matplotlib  # noqa: F401  so that its lack shows before the work, not after it
    machine = load_linkage(arguments.machine, arguments.set)
    asked = {name for name in _MORE if arguments.all or getattr(arguments, name)}
    with ExitStack() as files:  # opened first, so that an unwritable file fails before the work
        report = files.enter_context(staged(arguments.json)) if arguments.json else None
        pictures = {}
        if arguments.png:
            for table in ("", *sorted(asked & _DRAWN)):
                name = arguments.png.with_stem("_".join(filter(None, (arguments.png.stem, table))))
                pictures[table] = files.enter_context(staged(name))
        found = _speed(machine, arguments.peers, arguments.rounds, pictures.get(""))
        found["growth"] = _growth(machine) if "growth" in asked else []
        found["shaft"] = _shaft(machine, pictures.get("shaft")) if "shaft" in asked else []
        found["impacts"] = _impacts(arguments.rounds, pictures.get("impacts")) if "impacts" in asked else []
        if report:
            report.write_text(json.dumps(found, indent=1) + "\n")


def _speed(machine: Machine, peers: bool, rounds: int, picture: Path | None) -> dict[str, Rows]:
    print(heading(bench_core(), rounds), flush=True)
    rows = run_bench(machine, peers, rounds, progress=_bar("bench"), say=_complain)
    compared = ratios(rows)
    _tell(speed_table(rows), ratio_lines(compared))
    if picture:
        from textile_twin_core.bench.plots.speed import plot_work_precision

        plot_work_precision(rows, picture)
    methods = [asdict(row) for row in rows if row.peer != YARDSTICK]
    return {"rows": methods, "ratios": [asdict(ratio) for ratio in compared]}


def _growth(machine: Machine) -> Rows:
    rows = growth(machine, _bar("growth"))
    _tell(growth_table(rows))
    return [asdict(row) for row in rows]


def _shaft(machine: Machine, picture: Path | None) -> Rows:
    rows = shaft_table(machine, progress=_bar("shaft"))
    _tell(shaft_lines(rows))
    if picture:
        from textile_twin_core.bench.plots.shaft import plot_shaft

        plot_shaft(rows, picture)
    return [asdict(row) for row in rows]


def _impacts(rounds: int, picture: Path | None) -> Rows:
    rows = impact_table(rounds, _bar("impacts"))
    _tell(impact_lines(rows), ratio_lines(impact_ratios(rows), "time for a run, tightest settings"))
    if picture:
        from textile_twin_core.bench.plots.impacts import plot_impacts

        plot_impacts(rows, picture)
    return [asdict(row) for row in rows]


def _tell(*blocks: str) -> None:
    for block in blocks:
        if block:
            print(f"\n{block}", flush=True)


def _complain(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _bar(what: str) -> Callable[[int, int], object]:
    """Show progress if standard error is a terminal."""

    def show(done: int, total: int) -> None:
        if sys.stderr.isatty():
            end = "\n" if done == total else ""
            print(f"\r{what} {100 * done // total} %", end=end, file=sys.stderr, flush=True)

    return show
