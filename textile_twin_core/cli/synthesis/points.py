"""textile-twin synthesize points: four-bars whose coupler point passes through given points exactly."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict

from textile_twin_core.cli.arguments import Parser, count, number, seed
from textile_twin_core.cli.synthesis.shared import add_output, add_section, points, write
from textile_twin_core.synthesis import through_points

DESCRIPTION = "Four-bars whose coupler point passes two to five points exactly, in their order."
EXAMPLE = "textile-twin synthesize points --points '0,0 0.1,0.02 0.15,0.1 0.1,0.16' --out four_bar.yaml"


def add(parser: Parser) -> None:
    """Add the arguments of the task."""
    parser.add_argument(
        "--points", type=points, required=True, metavar="'X,Y X,Y ..'", help="the points in metres, in one argument"
    )
    parser.add_argument("--least-transmission", type=number, default=0.0, metavar="DEG", help="default %(default)s")
    parser.add_argument("--count", type=count, default=5, help="designs to find (default %(default)s)")
    parser.add_argument("--seed", type=seed, default=0, help="of the random starts (default %(default)s)")
    add_section(parser)
    add_output(parser)


def run(arguments: argparse.Namespace) -> None:
    """Synthesize, print a table and write."""
    found = through_points(
        arguments.points, arguments.seed, arguments.count, math.radians(arguments.least_transmission)
    )
    print(
        f"{'mu_min deg':>10}{'crank':>10}{'coupler':>10}{'rocker':>10}{'miss m':>10}   crank angles at the points, deg"
    )
    for design in found:
        bar = design.four_bar
        angles = " ".join(f"{math.degrees(angle):.1f}" for angle in design.angles_rad)
        lengths = f"{bar.crank_m:10.5f}{bar.coupler_m:10.5f}{bar.rocker_m:10.5f}"
        print(f"{math.degrees(bar.mu_min_rad):10.2f}{lengths}{design.miss_m:10.1e}   {angles}")
    designs = [asdict(design) | {"mu_min_deg": math.degrees(design.four_bar.mu_min_rad)} for design in found]
    write(arguments, found[0].four_bar.machine(arguments.section), {"kind": "points", "designs": designs})
