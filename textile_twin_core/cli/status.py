"""textile-twin status: state of a running suite in the terminal."""

from __future__ import annotations

import argparse
from importlib.metadata import entry_points

from textile_twin_core.cli.arguments import Parser, positive
from textile_twin_core.errors import TwinError

GROUP = "textile_twin.status"
"""Group of entry points that show a running suite; the ROS package provides one, so that the core needs no ROS."""


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "status",
        "State of the nodes of a running suite: rates, estimator, residual, recording, alarms.",
        "textile-twin status --follow",
    )
    parser.add_argument("--follow", action="store_true", help="update it every second, until Ctrl-C")
    parser.add_argument(
        "--seconds", type=positive, help="listen for this time first (default: 2.5, and up to 6 until a node is heard)"
    )
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Show the state."""
    shows = list(entry_points(group=GROUP))
    if not shows:
        raise TwinError(
            "the ROS package textile_twin_ros is not installed beside this command: start the suite once with"
            " launch_scripts/suite.sh, or see docs/ros_installation.md"
        )
    shows[0].load()(arguments.seconds, arguments.follow)
