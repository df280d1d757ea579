"""textile-twin explore: design page in the browser, on this computer only."""

from __future__ import annotations

import argparse
import webbrowser
from pathlib import Path

from textile_twin_core.cli.arguments import Parser, add_recording_topics
from textile_twin_core.cli.mistakes import UsageError, tell
from textile_twin_core.cli.named_machine import load_machine
from textile_twin_core.cli.sensor_options import add_sensors, topics_of, with_sensors
from textile_twin_core.explore.design import Design
from textile_twin_core.machine import Machine

_DEFAULT = "tufting"
_LAST_PORT = 65535


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "explore",
        "The design page: every parameter as a slider, the moving linkage and its curves, goals and limits for an"
        " optimiser, tolerances, balancing. It listens on this computer alone and prints its address, token included.",
        "textile-twin explore elliptic_gear_beatup",
    )
    parser.add_argument("machine", metavar="MACHINE", nargs="?", default=_DEFAULT, help="a machine or machine file")
    parser.add_argument("--port", type=_port, default=0, metavar="P", help="port to listen on (default: a free one)")
    parser.add_argument("--no-browser", action="store_true", help="do not open a browser")
    parser.add_argument(
        "--recording", type=Path, metavar="BAG", help="a recording of this machine, laid over the curve of the torque"
    )
    add_recording_topics(parser)
    add_sensors(parser)
    return parser


def _port(text: str) -> int:
    if not text.isdecimal() or int(text) > _LAST_PORT:
        raise argparse.ArgumentTypeError(f"must be a whole number from 0 to {_LAST_PORT}, not '{text}'")
    return int(text)


def run(arguments: argparse.Namespace) -> None:
    """Serve the page until interrupted."""
    machine = load_machine(arguments.machine, [])

    from textile_twin_core.explore.overlay import overlay
    from textile_twin_core.explore.server import Page, serve
    from textile_twin_core.explore.session import PageSession

    recording = None
    if arguments.recording:
        if not isinstance(machine, Machine):
            raise UsageError(f"--recording: machine '{machine.name}' has no torque to lay a recording over")
        recording = overlay(arguments.recording, with_sensors(machine, arguments), topics_of(arguments))
        tell(*recording.notes)
    design = Design.of(machine)

    def started(address: str) -> None:
        print(address, flush=True)
        if not arguments.no_browser:
            webbrowser.open(address)

    serve(Page(lambda: PageSession(design, recording)), arguments.port, started)
