"""A recording drawn for the viewer: measured beside predicted torque, or what the shaft's angle alone tells."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from textile_twin_core.cli.arguments import shaft_settings
from textile_twin_core.cli.compare import compare_recording
from textile_twin_core.cli.progress import progress
from textile_twin_core.cli.readings import read_angles, tell_unit
from textile_twin_core.cli.sensor_options import topics_of
from textile_twin_core.machine import AnyMachine, ContactMachine, Machine
from textile_twin_core.recordings import open_bag
from textile_twin_core.recordings.predicted_topics import TORQUE
from textile_twin_core.recordings.prediction import predictions
from textile_twin_core.twin import Samples, compile_machine
from textile_twin_core.twin.predictor import StampedEvent


def write_drawn(path: Path, arguments: argparse.Namespace, machine: AnyMachine) -> None:
    """Write the recording that the arguments of add_recording name as an .rrd file."""
    if isinstance(machine, ContactMachine):
        _write_elements(path, arguments, machine)
        return
    assert isinstance(machine, Machine)
    if machine.tells_torque and _holds_torque(arguments):
        from textile_twin_core.views import write_comparison_recording

        comparison = compare_recording(arguments, machine)
        write_comparison_recording(path, comparison, machine, title=arguments.bag.name)
        return
    from textile_twin_core.views import write_motion_recording

    # The shaft's angle comes with any output.
    outputs = [TORQUE if machine.tells_torque else next(iter(machine.joint_outputs.values()))[0]]
    stamps, blocks, _ = _predicted(arguments, machine, outputs, arguments.shaft)
    theta = np.concatenate([block.theta_rad for block in blocks])
    torque = np.concatenate([block[TORQUE] for block in blocks]) if machine.tells_torque else None
    sigma = np.concatenate([block.torque_sigma_Nm for block in blocks]) if machine.tells_torque else None
    write_motion_recording(path, machine, stamps, theta, torque, sigma, title=arguments.bag.name)


def _holds_torque(arguments: argparse.Namespace) -> bool:
    """Whether a torque was recorded beside the angle."""
    bag = open_bag(arguments.bag)
    return bag.has_topic(topics_of(arguments).torque_in(bag))


def _write_elements(path: Path, arguments: argparse.Namespace, machine: ContactMachine) -> None:
    """The motion of a contact machine's elements, as the recorded shaft moves them."""
    from textile_twin_core.views import write_element_recording

    names = list(zip(*machine.joint_outputs.values(), strict=True))
    # What it does follows from what it has done, as live.
    stamps, blocks, events = _predicted(arguments, machine, [*names[0], *names[1]], "causal")
    positions, velocities = (
        np.concatenate([np.stack([block[name] for name in which], axis=1) for block in blocks]) for which in names
    )
    write_element_recording(path, machine, stamps, positions, velocities, events, title=arguments.bag.name)


def _predicted(
    arguments: argparse.Namespace, machine: AnyMachine, outputs: list[str], shaft: str
) -> tuple[np.ndarray, list[Samples], list[StampedEvent]]:
    """Stamps [ns] and predictions of the recorded angles, and what happened meanwhile at stops and pads."""
    _, angles = read_angles(arguments, machine)
    tell_unit(angles)
    session = compile_machine(machine, outputs).session(shaft, **shaft_settings(arguments))
    with progress(len(angles), "predicting") as done:
        blocks, events = [], list[StampedEvent]()
        for block in predictions(session, angles, done):
            blocks.append(block)
            events += session.take_events()
    return np.concatenate([np.asarray(block.stamps, np.int64) for block in blocks]), blocks, events
