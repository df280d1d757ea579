"""Arguments and outputs shared by the tasks of `synthesize`."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from typing import Any

from textile_twin_core.cli.arguments import Parser, number, positive
from textile_twin_core.cli.mistakes import UsageError
from textile_twin_core.cli.outputs import add_outputs, save_json
from textile_twin_core.errors import SceneError
from textile_twin_core.files import save_machine_file
from textile_twin_core.machine import Machine
from textile_twin_core.synthesis import BarSection, rotation_of_time_ratio


def add_output(parser: Parser) -> None:
    """Add --out, --name, --json and --force."""
    add_outputs(parser, machine_required=False)
    parser.add_argument("--name", help="the machine's name in it (default: that of the file)")


def add_section(parser: Parser) -> None:
    """Add --section."""
    parser.add_argument(
        "--section",
        type=_section,
        default="7210,0.030,0.010",
        metavar="KG/M3,M,M",
        help="density, width (in the plane of motion) and thickness of the links; default %(default)s",
    )


def add_rotation(parser: Parser, default: str) -> None:
    """Add --rotation or --time-ratio."""
    parser.add_argument(
        "--rotation",
        type=number,
        metavar="DEG",
        help=f"crank rotation from the outer to the inner dead centre (default: {default})",
    )
    parser.add_argument(
        "--time-ratio", type=positive, metavar="Q", help="or duration of this stroke over that of the return stroke"
    )


def rotation(arguments: argparse.Namespace, default_rad: float) -> float:
    """Return the requested crank rotation [rad]."""
    if arguments.rotation is not None and arguments.time_ratio is not None:
        raise UsageError("--rotation and --time-ratio specify the same quantity; give one of them")
    if arguments.time_ratio is not None:
        return rotation_of_time_ratio(arguments.time_ratio)
    return default_rad if arguments.rotation is None else math.radians(arguments.rotation)


def points(text: str) -> list[tuple[float, float]]:
    """Parse points in metres, `X,Y X,Y ..`."""
    found = []
    for word in text.split():
        try:
            x, y = (float(part) for part in word.split(","))
        except ValueError:
            raise argparse.ArgumentTypeError(f"write points as 'X,Y X,Y ..' in metres, not '{word}'") from None
        found.append((x, y))
    return found


def _section(text: str) -> BarSection:

    try:
        density, width, thickness = (float(part) for part in text.split(","))
        return BarSection(density, width, thickness)
    except (ValueError, SceneError):
        raise argparse.ArgumentTypeError(
            f"write DENSITY,WIDTH,THICKNESS as three positive numbers, not '{text}'"
        ) from None


def write(arguments: argparse.Namespace, machine: Machine | None, result: dict[str, Any]) -> None:
    """Write the outputs of --json and --out."""
    if arguments.json:
        save_json(arguments.json, result)
    if arguments.out and machine is not None:
        save_machine_file(replace(machine, name=arguments.name or arguments.out.stem), arguments.out)
        print(f"wrote {arguments.out}: textile-twin simulate {arguments.out} --rpm 60 --samples 360 --out turn.csv")
