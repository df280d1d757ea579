"""textile-twin synthesize slider: offset slider-crank from stroke and time ratio."""

from __future__ import annotations

import argparse
import math

from textile_twin_core.cli.arguments import Parser, positive
from textile_twin_core.cli.synthesis.shared import add_output, add_rotation, add_section, rotation, write
from textile_twin_core.synthesis import offset_slider

DESCRIPTION = "A slider-crank for a stroke, offset where the way out and the way back differ in time."
EXAMPLE = "textile-twin synthesize slider --stroke 0.05 --time-ratio 1.1 --out slider.yaml"


def add(parser: Parser) -> None:
    """Add the arguments of the task."""
    parser.add_argument("--stroke", type=positive, required=True, metavar="M", help="stroke in metres")
    add_rotation(parser, "180, in line")
    parser.add_argument(
        "--crank-over-rod",
        type=positive,
        metavar="R",
        help="crank over rod; by default the one nearest 0.3 with a transmission angle of at least 50 deg",
    )
    parser.add_argument("--slider-mass", type=positive, default=1.0, metavar="KG", help="default %(default)s")
    add_section(parser)
    add_output(parser)


def run(arguments: argparse.Namespace) -> None:
    """Synthesize, print and write."""
    design = offset_slider(arguments.stroke, rotation(arguments, math.pi), arguments.crank_over_rod)
    print(
        f"slider-crank, stroke {design.stroke_m:g} m, rotation {math.degrees(design.rotation_rad):.6g} deg:"
        f" crank {design.crank_m:.6g} m, rod {design.rod_m:.6g} m, offset {design.offset_m:.6g} m,"
        f" r/l {design.crank_over_rod:.3f}, transmission angle at least {math.degrees(design.mu_min_rad):.2f} deg"
    )
    machine = design.machine(arguments.section, arguments.slider_mass)
    write(arguments, machine, {"kind": "slider", **design.to_json()})
