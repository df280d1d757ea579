"""textile-twin status: a running suite in the terminal."""

from __future__ import annotations

import argparse
from importlib.metadata import entry_points

from textile_twin_core.cli.arguments import Parser, positive
from textile_twin_core.errors import TwinError

GROUP = "textile_twin.status"
"""Entry points of this group show a running suite; the ROS package has one, and nothing of ROS is known here."""


def parser() -> Parser:
    """The command's arguments."""
    parser = Parser(
        "status",
        "What the nodes of a running suite say of themselves: rates, estimator, residual, recording, alarms.",
        "textile-twin status --follow",
    )
    parser.add_argument("--follow", action="store_true", help="show it anew every second, until Ctrl-C")
    parser.add_argument(
        "--seconds", type=positive, help="listen so long first (default: 2.5, and up to 6 until a node is heard)"
    )
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Show it."""
    shows = list(entry_points(group=GROUP))
    if not shows:
        raise TwinError(
            "the ROS package textile_twin_ros is not installed beside this command: docs/field.md tells how"
        )
    shows[0].load()(arguments.seconds, arguments.follow)
