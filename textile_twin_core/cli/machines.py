"""textile-twin machines: the available machines with their outputs and parameters."""

from __future__ import annotations

import argparse
import textwrap

from textile_twin_core.cli.arguments import Parser
from textile_twin_core.cli.named_machine import load_machine
from textile_twin_core.machines import NAMES


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser("machines", "The machines, their outputs and parameters.", "textile-twin machines tufting")
    parser.add_argument("machine", metavar="MACHINE", nargs="?", help="one machine alone, or a machine file")
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Print the machines."""
    for name in [arguments.machine] if arguments.machine else NAMES:
        machine = load_machine(name, [])
        print(f"{machine.name}: {machine.description}" if machine.description else machine.name)
        _print("outputs", machine.outputs)
        _print("parameters", [f"{key}={value:.7g}" for key, value in machine.parameters.items()])
        _print("needed for torque, no default", machine.missing_for_torque)
        print()


def _print(what: str, words: list[str] | tuple[str, ...]) -> None:
    if words:
        print(f"  {what}:")
        print(
            textwrap.fill(" ".join(words), 110, initial_indent="    ", subsequent_indent="    ", break_on_hyphens=False)
        )
