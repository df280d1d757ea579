"""What was logged, from a recording that the arguments name."""

from __future__ import annotations

import argparse

from textile_twin_core.cli.mistakes import tell
from textile_twin_core.comparison import Readings
from textile_twin_core.machine import AnyMachine
from textile_twin_core.recordings import open_bag
from textile_twin_core.recordings.bag import Bag
from textile_twin_core.recordings.machine_topics import beside, clock_notes, unit_notes, usable_angles, usable_torques
from textile_twin_core.recordings.samples import AngleSamples, TorqueSamples


def read_angles(arguments: argparse.Namespace, machine: AnyMachine) -> tuple[Bag, AngleSamples]:
    """The recording that the arguments of add_recording name, and its shaft angles.

    Raises RecordingError, and SceneError for edges that this machine's encoder cannot count.
    """
    bag = open_bag(arguments.bag)
    tell(*bag.notices)
    angles = usable_angles(
        bag,
        machine.sensors.encoder,
        arguments.angle_topic,
        arguments.joint,
        arguments.skip_bad_samples,
        arguments.index_topic,
        arguments.angle_unit_rad,
    )
    tell(*clock_notes(angles))
    return bag, angles


def tell_unit(angles: AngleSamples) -> None:
    """Say where recorded angles look like another unit than radians, for commands that no torque tells."""
    tell(*unit_notes(angles))


def read_samples(arguments: argparse.Namespace, machine: AnyMachine) -> tuple[Bag, AngleSamples, TorqueSamples]:
    """The same with the measured torque. Raises as read_angles does."""
    bag, angles = read_angles(arguments, machine)
    topic = beside(bag, angles.topic, arguments.torque_topic)
    measured = bag.read_torques(topic, arguments.joint, unit_Nm=arguments.torque_unit)
    measured = usable_torques(measured, arguments.skip_bad_samples)
    tell(*clock_notes(measured))
    return bag, angles, measured


def readings_of(angles: AngleSamples, measured: TorqueSamples) -> Readings:
    """Samples as the comparison takes them."""
    return Readings(angles.stamps, angles.angles_rad, measured.stamps, measured.torque_Nm, angles.velocities)
