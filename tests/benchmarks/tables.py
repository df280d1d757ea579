"""Further tables of the benchmark, and its pictures, on this computer.

Time and memory as samples, machines and linkages grow; error of the torque against latency and cost for the estimators
of the shaft's motion (two minutes); error of the event times against time for a run with impacts:

    python -m tests.benchmarks.tables [growth] [shaft] [impacts] [speed] [--png bench.png] [--json bench.json]

The picture of the speed has the name that is given; the others have _shaft and _impacts before the suffix.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from itertools import groupby
from pathlib import Path
from typing import Any

from tests.benchmarks.growth import Growth, growth
from tests.benchmarks.impact_table import EVENT_DRIVEN, ImpactRow, impact_table
from tests.benchmarks.plots import plot_impacts, plot_shaft, plot_work_precision
from tests.benchmarks.shaft_signal import DROPPED, JITTER_S, RATE_HZ
from tests.benchmarks.shaft_table import ShaftRow, shaft_table
from textile_twin_core.bench.ratios import Ratio, ratio, ratios
from textile_twin_core.bench.run import run_bench
from textile_twin_core.bench.text import number, ratio_lines, speed_table, spread
from textile_twin_core.bench.yardsticks import YARDSTICK
from textile_twin_core.machines import tufting

TABLES = ("speed", "growth", "shaft", "impacts")


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print and write the tables asked for, or all of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tables", nargs="*", metavar="TABLE", help=f"of {', '.join(TABLES)}; all when not given")
    parser.add_argument("--peers", action="store_true", help="other libraries in the table of speed")
    parser.add_argument("--rounds", type=int, default=11, help="rounds of turns (default %(default)s)")
    parser.add_argument("--png", type=Path, help="draw error against time")
    parser.add_argument("--json", type=Path, help="write the rows")
    given = parser.parse_args(arguments)
    asked = given.tables or TABLES
    if unknown := {*asked} - {*TABLES}:
        parser.error(f"{', '.join(sorted(unknown))}: available are {', '.join(TABLES)}")
    found = {name: _TABLES[name](given, _picture(given.png, name)) for name in TABLES if name in asked}
    if given.json:
        given.json.write_text(json.dumps({k: [asdict(row) for row in rows] for k, rows in found.items()}) + "\n")


def _picture(png: Path | None, table: str) -> Path | None:
    return png if png is None or table == "speed" else png.with_stem(f"{png.stem}_{table}")


def _speed(given: argparse.Namespace, picture: Path | None) -> Sequence[Any]:
    rows = run_bench(tufting(), given.peers, given.rounds, progress=_bar("speed"), say=print)
    print(speed_table(rows), ratio_lines(ratios(rows)), sep="\n\n")
    if picture:
        plot_work_precision(rows, picture)
    return [row for row in rows if row.peer != YARDSTICK]


def _growth(_: argparse.Namespace, __: Path | None) -> Sequence[Any]:
    rows = growth(tufting(), _bar("growth"))
    print(growth_table(rows))
    return rows


def _shaft(_: argparse.Namespace, picture: Path | None) -> Sequence[Any]:
    rows = shaft_table(tufting(), progress=_bar("shaft"))
    print(shaft_lines(rows))
    if picture:
        plot_shaft(rows, picture)
    return rows


def _impacts(given: argparse.Namespace, picture: Path | None) -> Sequence[Any]:
    rows = impact_table(given.rounds, _bar("impacts"))
    print(impact_lines(rows), ratio_lines(impact_ratios(rows), "time for a run, tightest settings"), sep="\n\n")
    if picture:
        plot_impacts(rows, picture)
    return rows


_TABLES: dict[str, Callable[[argparse.Namespace, Path | None], Sequence[Any]]] = {
    "speed": _speed,
    "growth": _growth,
    "shaft": _shaft,
    "impacts": _impacts,
}


def _bar(what: str) -> Callable[[int, int], object]:
    """Show progress on a terminal."""

    def show(done: int, total: int) -> None:
        if sys.stderr.isatty():
            print(f"\r{what} {100 * done // total} %", end="\n" if done == total else "", file=sys.stderr, flush=True)

    return show


def impact_ratios(rows: Sequence[ImpactRow]) -> list[Ratio]:
    """Compare runs with impacts: every method at its tightest setting over ours at its tightest."""
    last = {row.method: row for row in rows}
    ours = last.pop(EVENT_DRIVEN)
    return [
        ratio(f"{row.method}, {row.setting}", f"{ours.method}, {ours.setting}", row.ms_per_round, ours.ms_per_round)
        for row in last.values()
    ]


def growth_table(rows: Iterable[Growth]) -> str:
    """Format one block each for samples, machines and linkages."""
    lines = []
    for what, block in groupby(rows, key=lambda row: (row.method, row.what)):
        lines += ["", f"{what[1]}, {what[0]}", f"  {'':>12}{'ns per sample':>16}{'MiB beyond in and out':>24}"]
        lines += [f"  {row.size:>12,}{row.ns_per_unit:>16.1f}{row.memory_MiB:>24.2f}" for row in block]
    return "\n".join(lines[1:])


def shaft_lines(rows: Sequence[ShaftRow]) -> str:
    """Format a matrix per load: estimators against encoder bits, and against shaft speed."""
    lines = [
        f"{rows[0].machine}: RMS error of the torque of inertia and weight over its peak, from an encoder's angles"
        f" ({RATE_HZ:g} Hz,",
        f"stamps wrong by {JITTER_S * 1e6:g} us, {DROPPED:.0%} of the samples lost); sigma: share of samples within"
        " the stated sigma (68 % would be right)",
    ]
    for (load, rpm), block in _matrices(rows).items():
        columns = list(dict.fromkeys((row.bits, row.rpm) for row in block))
        heads = [f"{bits} bit" if rpm is not None else f"{speed:g} rpm" for bits, speed in columns]
        where = f"{rpm:g} rpm" if rpm is not None else f"{columns[0][0]} bit"
        title = "".join(f"{head:>10}" for head in heads)
        lines += ["", f"{load}, {where}", f"  {'':24}{title}{'latency':>10}{'us/sample':>11}{'sigma':>7}"]
        lines += [
            _shaft_line([row for row in block if row.estimator == name], columns)
            for name in dict.fromkeys(row.estimator for row in block)
        ]
    return "\n".join(lines)


def _matrices(rows: Sequence[ShaftRow]) -> dict[tuple[str, float | None], list[ShaftRow]]:
    """Group rows by load, with the speed that has several bits separate from the other speeds (None)."""
    bits: dict[float, set[int]] = {}
    for row in rows:
        bits.setdefault(row.rpm, set()).add(row.bits)
    found: dict[tuple[str, float | None], list[ShaftRow]] = {}
    for row in rows:
        found.setdefault((row.load, row.rpm if len(bits[row.rpm]) > 1 else None), []).append(row)
    return found


def _shaft_line(rows: Sequence[ShaftRow], columns: Sequence[tuple[int, float]]) -> str:
    at = {(row.bits, row.rpm): row for row in rows}
    errors = "".join(f"{number(at[c].torque_rms_over_peak if c in at else None, '.1e'):>10}" for c in columns)
    latency = f"{number(rows[0].latency_s, 'g')} s" if rows[0].latency_s is not None else "-"
    costs = [row.us_per_sample for row in rows if row.us_per_sample is not None]
    inside = [row.inside_sigma for row in rows if row.inside_sigma is not None]
    cost = statistics.median(costs) if costs else None
    share = statistics.mean(inside) if inside else None
    return f"  {rows[0].estimator:24}{errors}{latency:>10}{number(cost, '.0f'):>11}{number(share, '.0%'):>7}"


def impact_lines(rows: Sequence[ImpactRow]) -> str:
    """Format one line per method and setting."""
    title = "needle transfer, from rest to the first contact of the collets: error of the event times"
    head = f"  {'':30}{'':18}{'error [s]':>11}{'ms per run':>12}{'spread':>8}"
    lines = [
        f"  {row.method:30}{row.setting:18}{row.error_s:>11.1e}{row.ms_per_run:>12.1f}{spread(row.ms_per_round):>8}"
        for row in rows
    ]
    return "\n".join([title, head, *lines])


if __name__ == "__main__":
    main()
