"""textile-twin view: recording in the viewer, with the moving machine beside its torque."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from textile_twin_core.cli.arguments import Parser, add_machine, add_recording, number
from textile_twin_core.cli.mistakes import UsageError, tell
from textile_twin_core.cli.named_machine import is_machine, load_machine
from textile_twin_core.cli.outputs import check_outputs
from textile_twin_core.cli.sensor_options import add_sensors, with_sensors
from textile_twin_core.cli.view_recording import write_view_recording
from textile_twin_core.errors import TwinError
from textile_twin_core.files import staged
from textile_twin_core.views.drawable import drawable, drawable_machine


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "view",
        "Shows a recording: the machine in motion, and its torque beside the measured one where there is one; a file\n"
        "that `compare --rrd` or `replay --rrd` wrote; or a machine. Ends when the viewer is closed.",
        "textile-twin view bags/tufting_160rpm_synthetic --machine tufting",
    )
    add_recording(parser, shaft="smooth", also=", an .rrd file, or a machine: its name or its file (.yaml)")
    add_machine(parser, option=True, required=False)
    add_sensors(parser)
    parser.add_argument(
        "--png", type=Path, metavar="FILE", help="draw the viewer's picture into a file instead; needs no screen"
    )
    parser.add_argument(
        "--at",
        type=number,
        metavar="S",
        help="with --png: the time shown (default: the end); of a machine: its shaft angle in deg",
    )
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Open the viewer, or the picture of a machine, and wait until it is closed; or draw without a display."""
    check_outputs(arguments)
    if is_machine(str(arguments.bag)):
        _show_machine(arguments)
        return
    if arguments.bag.suffix == ".rrd":
        _show(arguments, arguments.bag)
        return
    if not arguments.bag.exists():
        raise UsageError(f"{arguments.bag}: no such file; give a recording, an .rrd file, or a machine")
    if arguments.machine is None:
        raise UsageError("--machine is missing: a recording is shown beside the prediction for its machine")

    machine, replaced = drawable_machine(with_sensors(load_machine(arguments.machine, arguments.set), arguments))
    if replaced:
        tell(f"the viewer's font has no {' '.join(replaced)}: drawn as {' '.join(map(drawable, replaced))}")
    with tempfile.TemporaryDirectory(prefix="textile-twin-") as folder:
        recording = Path(folder) / f"{drawable(arguments.bag.stem)}.rrd"
        write_view_recording(recording, arguments, machine)
        _show(arguments, recording)


def _show_machine(arguments: argparse.Namespace) -> None:
    """Show the picture of the machine in the viewer."""
    from textile_twin_core.views import plot_machine, write_picture

    machine = load_machine(str(arguments.bag), arguments.set)
    with tempfile.TemporaryDirectory(prefix="textile-twin-") as folder:
        picture, recording = Path(folder) / "machine.png", Path(folder) / f"{drawable(machine.name)}.rrd"
        write_picture(recording, plot_machine(picture, machine, at_deg=arguments.at), title=machine.name)
        arguments.at = None  # a shaft angle here, not a time
        _show(arguments, recording)


def _show(arguments: argparse.Namespace, recording: Path) -> None:
    from textile_twin_core.views import open_viewer, screenshot

    if arguments.png is not None:
        with staged(arguments.png) as partial:
            screenshot(recording, partial, time_s=arguments.at)
        return
    if code := open_viewer(recording).wait():
        raise TwinError(f"the viewer ended with code {code}: see its lines above; it needs a screen")
