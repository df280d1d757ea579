"""textile-twin replay: offline predictions for a recording, equal to those of the live twin."""

from __future__ import annotations

import argparse
from pathlib import Path

from textile_twin_core.cli.arguments import Parser, add_machine, add_recording, shaft_settings
from textile_twin_core.cli.mistakes import UsageError, tell
from textile_twin_core.cli.named_machine import load_machine
from textile_twin_core.cli.outputs import check_outputs, keep_input, save
from textile_twin_core.cli.progress import progress
from textile_twin_core.cli.sensor_options import add_sensors, topics_of, with_sensors
from textile_twin_core.cli.view_recording import write_view_recording
from textile_twin_core.machine import AnyMachine
from textile_twin_core.recordings import BagWriter, open_bag
from textile_twin_core.recordings.replay import replay_bag


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "replay",
        "Copies a recording and adds the twin's predictions, each with the stamp of its angle sample:\n"
        "balancing_torque/predicted, predicted_sigma and residual, needle/position, joint_states.",
        "textile-twin replay bags/tufting_160rpm_synthetic --machine tufting --out predicted",
    )
    add_recording(parser, shaft="causal")
    add_machine(parser, option=True)
    add_sensors(parser)
    parser.add_argument("--out", type=Path, metavar="BAG2", help="folder to make, or an .mcap file")
    parser.add_argument("--rrd", type=Path, metavar="FILE", help="write a recording for textile-twin view")
    parser.add_argument("--force", action="store_true", help="overwrite the output if it exists")
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Replay the recording."""
    machine = with_sensors(load_machine(arguments.machine, arguments.set), arguments)
    if arguments.out is None and arguments.rrd is None:
        raise UsageError("--out or --rrd is missing: give an output for the predictions")
    keep_input(arguments.out, arguments.bag)
    check_outputs(arguments)
    if arguments.out is not None:
        _write_bag(arguments, machine)
    save(arguments.rrd, lambda path: write_view_recording(path, arguments, machine))


def _write_bag(arguments: argparse.Namespace, machine: AnyMachine) -> None:
    bag = open_bag(arguments.bag)
    tell(*bag.notices)
    total = bag.find_topic(arguments.angle_topic).count
    origin = {**bag.metadata, "replayed_from": arguments.bag.name, "machine": machine.name, "shaft": arguments.shaft}
    with (
        BagWriter(arguments.out, origin, overwrite=arguments.force) as out,
        progress(total, "replaying") as done,
    ):
        replay = replay_bag(
            bag,
            out,
            machine,
            shaft=arguments.shaft,
            recorded=topics_of(arguments),
            progress=done,
            **shaft_settings(arguments),
        )
    tell(*replay.notes)
    print(f"shaft: {replay.report.text()}")
    width = max(map(len, replay.counts))
    for topic, messages in replay.counts.items():
        print(f"{topic:{width}} {messages}")
