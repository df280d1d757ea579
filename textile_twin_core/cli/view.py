"""textile-twin view: a recording in the viewer, the machine moving beside its torque."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from textile_twin_core.cli.arguments import Parser, UsageError, add_machine, add_recording, load_linkage
from textile_twin_core.cli.compare import compare_recording


def parser() -> Parser:
    """The command's arguments."""
    parser = Parser(
        "view",
        "Shows a comparison that `compare --rrd` wrote, or compares a recording and shows that. Ends when the viewer"
        " is closed.",
        "textile-twin view bags/tufting_160rpm_synthetic --machine tufting",
    )
    add_recording(parser, shaft="smooth", also=" or an .rrd file")
    add_machine(parser, option=True, required=False)
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Open the viewer and wait until it is closed."""
    if arguments.bag.suffix == ".rrd":
        _show(arguments.bag)
        return
    if arguments.machine is None:
        raise UsageError("--machine is missing: a recording is shown beside what its machine should do")
    machine = load_linkage(arguments.machine, arguments.set)
    comparison = compare_recording(arguments, machine)

    from textile_twin_core.views import write_comparison_recording

    with tempfile.TemporaryDirectory(prefix="textile-twin-") as folder:
        recording = Path(folder) / f"{arguments.bag.stem}.rrd"
        write_comparison_recording(recording, comparison, machine, title=arguments.bag.name)
        _show(recording)


def _show(recording: Path) -> None:
    from textile_twin_core.errors import TwinError
    from textile_twin_core.views import open_viewer

    if code := open_viewer(recording).wait():
        raise TwinError(f"the viewer ended with code {code}; it needs a screen and a graphics driver")
