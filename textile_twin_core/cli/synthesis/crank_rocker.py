"""textile-twin synthesize crank-rocker: link lengths from swing and crank rotation, or from the weaver's hand."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

from textile_twin_core.cli.arguments import Parser, number, positive
from textile_twin_core.cli.mistakes import UsageError
from textile_twin_core.cli.synthesis.shared import add_output, add_rotation, add_section, points, rotation, write
from textile_twin_core.synthesis import Tool, best_rotation, crank_rocker, crank_rocker_machine, rocker_through

if TYPE_CHECKING:
    from textile_twin_core.synthesis import CrankRockerDesign, CrankRockerSynthesis

DESCRIPTION = (
    "Crank-rockers for a swing of the rocker and the rotation of the crank that belongs to it, the ground link being 1:"
    " all whole degrees of beta (the angle at the crank's pivot, from ground link to coupler at the stretched dead"
    " centre), and the best."
)
EXAMPLE = "textile-twin synthesize crank-rocker --swing 30 --rotation 180 --json designs.json"
CHOICES = {"best": "best", "continuous": "best_continuous", "transmission": "best_transmission"}
_STEP_DEG = 5


def add(parser: Parser) -> None:
    """Add the arguments of the task."""
    parser.add_argument("--swing", type=number, metavar="DEG", help="swing of the rocker in degrees")
    parser.add_argument(
        "--hand",
        type=points,
        metavar="'X,Y X,Y X,Y'",
        help="or three positions of the hand in metres, in one argument: swing, rocker pivot and arm follow from them",
    )
    add_rotation(parser, "the one of the best transmission angle at r/l = 0.3")
    parser.add_argument("--ground", type=positive, metavar="M", help="length of the ground link, for lengths in metres")
    parser.add_argument(
        "--choose",
        choices=CHOICES,
        help="which design --out writes: the best whole degree of beta (default where there is one), the best of any"
        " beta, or the one of the largest transmission angle",
    )
    parser.add_argument("--arm", type=positive, metavar="M", help="length of an arm on the rocker that carries a tool")
    parser.add_argument("--tool-mass", type=positive, metavar="KG", help="mass at the arm's end, such as a beater's")
    add_section(parser)
    add_output(parser)


def run(arguments: argparse.Namespace) -> None:
    """Synthesize, print a table and write the files."""
    if (arguments.swing is None) == (arguments.hand is None):
        raise UsageError("give --swing in degrees, or --hand with three positions")
    if arguments.hand and len(arguments.hand) != 3:
        raise UsageError(f"--hand takes three positions, not {len(arguments.hand)}")
    hand = rocker_through(*arguments.hand) if arguments.hand else None
    swing = hand.swing_rad if hand else math.radians(arguments.swing)
    result = crank_rocker(swing, rotation(arguments, best_rotation(swing)))
    machine = None
    chosen = _chosen(result, arguments.choose)
    if arguments.out:
        if arguments.ground is None:
            raise UsageError("--out needs --ground, the length of the ground link in metres")
        arm = arguments.arm or (hand.radius_m if hand else None)
        if arguments.tool_mass and arm is None:
            raise UsageError("--tool-mass needs --arm, the length of the arm that carries the tool")
        tool = None if arm is None else Tool(arm, arguments.tool_mass or 0.0)
        machine = crank_rocker_machine(chosen.scaled(arguments.ground), arguments.section, tool, hand)
    lines = _table(result) + ([] if arguments.ground is None else _lengths(result, chosen, arguments.ground))
    if hand:
        x, y = hand.pivot_m
        lines.insert(1, f"rocker pivot at {x:.6g}, {y:.6g} m, the hand {hand.radius_m:.6g} m from it")
    print("\n".join(lines))
    write(arguments, machine, result.to_json(arguments.ground))


def _chosen(result: CrankRockerSynthesis, choice: str | None) -> CrankRockerDesign:
    found = getattr(result, CHOICES[choice]) if choice else result.best or result.best_transmission
    if found is None:
        raise UsageError(
            f"there is no such design for this task; leave out --choose {choice or ''}, or change the task"
        )
    return found


def _table(result: CrankRockerSynthesis) -> list[str]:
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
    return lines


def _lengths(result: CrankRockerSynthesis, chosen: CrankRockerDesign, ground_m: float) -> list[str]:
    """Return the chosen design in metres, with its name."""
    word = next(word for word, attribute in CHOICES.items() if chosen is getattr(result, attribute))
    length = chosen.scaled(ground_m)
    return [
        "",
        f"ground link {length.ground_m:g} m: crank {length.crank_m:.6g} m, coupler {length.coupler_m:.6g} m,"
        f" rocker {length.rocker_m:.6g} m ({word})",
    ]


def _row(design: CrankRockerDesign) -> str:
    beta, mu_min = math.degrees(design.beta_rad), math.degrees(design.mu_min_rad)
    sides = f"{design.crank:9.4f}{design.coupler:9.4f}{design.rocker:9.4f}"
    return f"{round(beta, 4):10g}{sides}{design.crank_over_coupler:8.3f}{mu_min:12.2f}"
