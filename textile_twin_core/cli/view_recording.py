"""Recording drawn for the viewer: measured beside predicted torque, or the motion alone."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from textile_twin_core.cli.compare import compare_recording
from textile_twin_core.cli.readings import columns_of, predicted_blocks, station_angles, station_joints
from textile_twin_core.cli.sensor_options import topics_of
from textile_twin_core.machine import AnyMachine, ContactMachine, Machine
from textile_twin_core.recordings import open_bag
from textile_twin_core.recordings.predicted_topics import TORQUE


def write_view_recording(path: Path, arguments: argparse.Namespace, machine: AnyMachine) -> None:
    """Write the recording named by the arguments of add_recording as an .rrd file."""
    if isinstance(machine, ContactMachine):
        _write_elements(path, arguments, machine)
        return
    assert isinstance(machine, Machine)
    if machine.has_complete_torque and _holds_torque(arguments):
        from textile_twin_core.views import write_comparison_recording

        comparison = compare_recording(arguments, machine)
        turning = station_angles(arguments, machine)
        write_comparison_recording(path, comparison, machine, title=arguments.bag.name, stations=turning)
        return
    from textile_twin_core.views import write_motion_recording

    # The samples of any output include the shaft angle.
    outputs = [TORQUE if machine.has_complete_torque else next(iter(machine.joint_outputs.values()))[0]]
    stations = [name for name, _ in station_joints(machine)]
    stamps, blocks, _ = predicted_blocks(arguments, machine, [*outputs, *stations], arguments.shaft)
    theta = np.concatenate([block.theta_rad for block in blocks])
    torque = np.concatenate([block[TORQUE] for block in blocks]) if machine.has_complete_torque else None
    sigma = np.concatenate([block.torque_sigma_Nm for block in blocks]) if machine.has_complete_torque else None
    turned = columns_of(blocks, stations) if stations else None
    write_motion_recording(path, machine, stamps, theta, torque, sigma, title=arguments.bag.name, stations_rad=turned)


def _holds_torque(arguments: argparse.Namespace) -> bool:
    """Return true if the recording has a torque beside the angle."""
    bag = open_bag(arguments.bag)
    return bag.has_topic(topics_of(arguments).torque_in(bag))


def _write_elements(path: Path, arguments: argparse.Namespace, machine: ContactMachine) -> None:
    """Write the motion of a contact machine's elements under the recorded shaft motion."""
    from textile_twin_core.views import write_element_recording

    names = list(zip(*machine.joint_outputs.values(), strict=True))
    # The machine has a history, so the causal estimator is used, as live.
    stamps, blocks, events = predicted_blocks(arguments, machine, [*names[0], *names[1]], "causal")
    positions, velocities = (
        np.concatenate([np.stack([block[name] for name in which], axis=1) for block in blocks]) for which in names
    )
    write_element_recording(path, machine, stamps, positions, velocities, events, title=arguments.bag.name)
