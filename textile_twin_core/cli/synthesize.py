"""textile-twin synthesize: link lengths from what a mechanism must do."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING

from textile_twin_core.cli.arguments import Parser, number, positive

if TYPE_CHECKING:
    from textile_twin_core.synthesis import CrankRockerDesign, CrankRockerSynthesis

_STEP_DEG = 5


def parser() -> Parser:
    """The command's arguments."""
    parser = Parser(
        "synthesize",
        "Crank-rockers for a swing of the rocker and the rotation of the crank that belongs to it, the ground link"
        " being 1: all whole degrees of beta (the angle at the crank's pivot, from ground link to coupler at the"
        " stretched dead centre), and the best.",
        "textile-twin synthesize crank-rocker --swing 30 --rotation 180 --json designs.json",
    )
    parser.add_argument("mechanism", choices=["crank-rocker"], help="what to synthesize")
    parser.add_argument("--swing", type=number, required=True, metavar="DEG", help="swing of the rocker in degrees")
    parser.add_argument(
        "--rotation",
        type=number,
        required=True,
        metavar="DEG",
        help="crank rotation in degrees from the stretched to the folded dead centre",
    )
    parser.add_argument("--ground", type=positive, metavar="M", help="length of the ground link, for lengths in metres")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every design")
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Synthesize, print a table, write the JSON file."""
    from textile_twin_core.files import staged
    from textile_twin_core.synthesis import crank_rocker

    result = crank_rocker(math.radians(arguments.swing), math.radians(arguments.rotation))
    if arguments.json:
        with staged(arguments.json) as partial:
            partial.write_text(json.dumps(result.to_json(arguments.ground), indent=1) + "\n")
    print("\n".join(_table(result, arguments.ground)))


def _table(result: CrankRockerSynthesis, ground_m: float | None) -> list[str]:
    count = len(result.designs)
    low, high = (math.degrees(beta) for beta in result.family.beta_bounds_rad)
    lines = [
        f"crank-rocker, swing {math.degrees(result.family.swing_rad):g} deg, rotation"
        f" {math.degrees(math.pi + result.family.imbalance_rad):g} deg ({result.case}):"
        f" beta from {low:.6g} to {high:.6g} deg, {count} design{'s' if count != 1 else ''}",
        "",
        f"{'beta deg':>10}{'a':>9}{'b':>9}{'c':>9}{'r/l':>8}{'mu_min deg':>12}",
    ]
    for design in result.designs:
        whole = round(math.degrees(design.beta_rad), 9)
        if design is result.best or whole % _STEP_DEG == 0 or count < 2 * _STEP_DEG:
            lines.append(_row(design) + ("  best" if design is result.best else ""))
    if result.best_continuous:
        lines.append(_row(result.best_continuous) + "  best of any beta")
    else:
        lines.append("no design keeps the transmission angle within 40 deg of 90")
    if result.best_transmission:
        lines.append(_row(result.best_transmission) + "  largest mu_min")
    shown = result.best or result.best_transmission
    if ground_m is not None and shown:
        length = shown.scaled(ground_m)
        lines += [
            "",
            f"ground link {length.ground_m:g} m: crank {length.crank_m:.6g} m, coupler {length.coupler_m:.6g} m,"
            f" rocker {length.rocker_m:.6g} m ({'best' if result.best else 'largest mu_min'})",
        ]
    return lines


def _row(design: CrankRockerDesign) -> str:
    beta, mu_min = math.degrees(design.beta_rad), math.degrees(design.mu_min_rad)
    sides = f"{design.crank:9.4f}{design.coupler:9.4f}{design.rocker:9.4f}"
    return f"{round(beta, 4):10g}{sides}{design.crank_over_coupler:8.3f}{mu_min:12.2f}"
