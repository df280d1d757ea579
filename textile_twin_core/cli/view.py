"""textile-twin view: a recording in the viewer, the machine moving beside its torque."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from textile_twin_core.cli.arguments import Parser, add_machine, add_recording
from textile_twin_core.cli.compare import compare_recording
from textile_twin_core.cli.mistakes import UsageError
from textile_twin_core.cli.named_machine import is_machine, load_linkage, load_machine
from textile_twin_core.cli.progress import progress
from textile_twin_core.cli.readings import read_angles
from textile_twin_core.cli.sensor_options import add_sensors, with_sensors
from textile_twin_core.errors import TwinError
from textile_twin_core.machine import ContactMachine
from textile_twin_core.recordings.prediction import predictions
from textile_twin_core.twin import compile_machine


def parser() -> Parser:
    """The command's arguments."""
    parser = Parser(
        "view",
        "Shows a comparison that `compare --rrd` wrote, or compares a recording and shows that, or shows a machine.\n"
        "Ends when the viewer is closed.",
        "textile-twin view bags/tufting_160rpm_synthetic --machine tufting",
    )
    add_recording(parser, shaft="smooth", also=", an .rrd file, or a machine: its name or its file (.yaml)")
    add_machine(parser, option=True, required=False)
    add_sensors(parser)
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Open the viewer, or for a machine its picture, and wait until it is closed."""
    if is_machine(str(arguments.bag)):
        _show_machine(arguments)
        return
    if arguments.bag.suffix == ".rrd":
        _show(arguments.bag)
        return
    if arguments.machine is None:
        raise UsageError("--machine is missing: a recording is shown beside what its machine should do")
    machine = with_sensors(load_machine(arguments.machine, arguments.set), arguments)
    with tempfile.TemporaryDirectory(prefix="textile-twin-") as folder:
        recording = Path(folder) / f"{arguments.bag.stem}.rrd"
        if isinstance(machine, ContactMachine):
            _write_elements(recording, arguments, machine)
        else:
            _write_comparison(recording, arguments)
        _show(recording)


def _write_comparison(recording: Path, arguments: argparse.Namespace) -> None:
    from textile_twin_core.views import write_comparison_recording

    machine = with_sensors(load_linkage(arguments.machine, arguments.set), arguments)
    comparison = compare_recording(arguments, machine)
    write_comparison_recording(recording, comparison, machine, title=arguments.bag.name)


def _write_elements(recording: Path, arguments: argparse.Namespace, machine: ContactMachine) -> None:
    """The motion of a contact machine's elements, as the recorded shaft moves them."""
    from textile_twin_core.views import write_element_recording

    _, angles = read_angles(arguments, machine)
    names = list(zip(*machine.joint_outputs.values(), strict=True))
    # What it does follows from what it has done, as live.
    session = compile_machine(machine, [*names[0], *names[1]]).session("causal")
    with progress(len(angles), "predicting") as done:
        blocks = list(predictions(session, angles, done))
    stamps = np.concatenate([np.asarray(block.stamps, np.int64) for block in blocks])
    positions, velocities = (
        np.concatenate([np.stack([block[name] for name in which], axis=1) for block in blocks]) for which in names
    )
    write_element_recording(recording, machine, stamps, positions, velocities, title=arguments.bag.name)


def _show_machine(arguments: argparse.Namespace) -> None:
    """The machine's picture, in the viewer."""
    from textile_twin_core.views import plot_machine, write_picture

    machine = load_machine(str(arguments.bag), arguments.set)
    with tempfile.TemporaryDirectory(prefix="textile-twin-") as folder:
        picture, recording = Path(folder) / "machine.png", Path(folder) / f"{machine.name}.rrd"
        write_picture(recording, plot_machine(picture, machine), title=machine.name)
        _show(recording)


def _show(recording: Path) -> None:
    from textile_twin_core.views import open_viewer

    if code := open_viewer(recording).wait():
        raise TwinError(f"the viewer ended with code {code}; it needs a screen and a graphics driver")
