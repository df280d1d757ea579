"""textile-twin synthesize curve: four-bar whose coupler curve approximates many points."""

from __future__ import annotations

import argparse
import csv
import math
from dataclasses import asdict
from pathlib import Path

from textile_twin_core.cli.arguments import Parser, count, number, seed
from textile_twin_core.cli.mistakes import UsageError
from textile_twin_core.cli.progress import shares
from textile_twin_core.cli.synthesis.shared import add_output, add_section, points, write
from textile_twin_core.synthesis import fit_curve

DESCRIPTION = "The four-bar whose coupler curve comes nearest to six or more points, by optimisation."
EXAMPLE = "textile-twin synthesize curve --file path.csv --least-transmission 40 --out four_bar.yaml"


def add(parser: Parser) -> None:
    """Add the arguments of the task."""
    parser.add_argument("--file", type=Path, metavar="CSV", help="points in metres, two columns x and y")
    parser.add_argument("--points", type=points, metavar="'X,Y X,Y ..'", help="or the points in one argument")
    parser.add_argument("--least-transmission", type=number, default=0.0, metavar="DEG", help="default %(default)s")
    parser.add_argument("--generations", type=count, default=600, help="of the search (default %(default)s)")
    parser.add_argument("--seed", type=seed, default=0, help="of the search (default %(default)s)")
    add_section(parser)
    add_output(parser)


def run(arguments: argparse.Namespace) -> None:
    """Search, print and write."""
    if (arguments.file is None) == (arguments.points is None):
        raise UsageError("give the curve by --file or by --points")
    curve = arguments.points if arguments.file is None else _read(arguments.file)
    with shares("designs") as report:
        found = fit_curve(
            curve, arguments.seed, math.radians(arguments.least_transmission), arguments.generations, report
        )
    bar_found = found.four_bar
    print(
        f"four-bar after {found.designs} designs: RMS distance {1e3 * found.rms_m:.4g} mm, largest"
        f" {1e3 * found.largest_m:.4g} mm; crank {bar_found.crank_m:.6g} m, coupler {bar_found.coupler_m:.6g} m, rocker"
        f" {bar_found.rocker_m:.6g} m, transmission angle at least {math.degrees(bar_found.mu_min_rad):.2f} deg"
    )
    write(arguments, bar_found.machine(arguments.section), {"kind": "curve", **asdict(found)})


def _read(path: Path) -> list[tuple[float, float]]:
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = [row for row in csv.reader(file) if row]
    found = []
    for number_of_row, row in enumerate(rows, 1):
        try:
            found.append((float(row[0]), float(row[1])))
        except (ValueError, IndexError):
            if number_of_row > 1:  # the first line may be a heading
                raise UsageError(f"{path}, row {number_of_row}: two numbers x,y in metres are needed") from None
    return found
