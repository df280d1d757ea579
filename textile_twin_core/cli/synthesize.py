"""textile-twin synthesize: machines from their task, and balanced machines."""

from __future__ import annotations

import argparse
from importlib import import_module
from typing import Any

from textile_twin_core.cli.arguments import Parser
from textile_twin_core.cli.outputs import check_out

TASKS = {
    "crank-rocker": "crank_rocker",
    "slider": "slider",
    "points": "points",
    "curve": "curve",
    "balance": "balance",
}
"""Tasks, each a module of cli.synthesis."""


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "synthesize",
        "Linkages from what they must do, as machine files that every other command takes; and machines balanced.",
        "textile-twin synthesize crank-rocker --swing 30 --rotation 180 --ground 0.3 --out loom.yaml",
    )
    tasks = parser.add_subparsers(dest="mechanism", metavar="TASK", required=True, parser_class=_TaskParser)
    for name, module in TASKS.items():
        task = import_module(f"textile_twin_core.cli.synthesis.{module}")
        task.add(tasks.add_parser(name, help=task.DESCRIPTION, description=task.DESCRIPTION, epilog=task.EXAMPLE))
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Run the task.

    Raises:
        UsageError: The machine file to write exists already.
    """
    check_out(arguments)
    import_module(f"textile_twin_core.cli.synthesis.{TASKS[arguments.mechanism]}").run(arguments)


class _TaskParser(Parser):
    """Parser of one task."""

    def __init__(self, *, prog: str, description: str, epilog: str, **_: Any) -> None:
        super().__init__(prog.removeprefix("textile-twin "), description, epilog)
