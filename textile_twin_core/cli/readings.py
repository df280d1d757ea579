"""Logged samples of the recording named by the arguments."""

from __future__ import annotations

import argparse

from textile_twin_core.cli.mistakes import tell
from textile_twin_core.cli.sensor_options import topics_of
from textile_twin_core.comparison import Readings
from textile_twin_core.comparison.readings import SecondAngle
from textile_twin_core.machine import AnyMachine
from textile_twin_core.recordings import open_bag
from textile_twin_core.recordings.bag import Bag
from textile_twin_core.recordings.machine_topics import unit_notes
from textile_twin_core.recordings.prediction import second_angles
from textile_twin_core.recordings.recorded_clock import clock_notes, on_one_clock
from textile_twin_core.recordings.sample_times import evenly_timed, evenly_timed_angles
from textile_twin_core.recordings.samples import AngleSamples, TorqueSamples


def read_angles(arguments: argparse.Namespace, machine: AnyMachine) -> tuple[Bag, AngleSamples]:
    """Open the recording named by the arguments of add_recording, and read its shaft angles.

    Raises:
        RecordingError: The recording cannot be read.
        SceneError: The encoder of this machine cannot count the recorded edges.
    """
    bag, angles = _opened(arguments, machine)
    tell(*clock_notes(angles))
    angles, timings = evenly_timed_angles(angles, machine)
    tell(*(timing.text for timing in timings))
    return bag, angles


def _opened(arguments: argparse.Namespace, machine: AnyMachine) -> tuple[Bag, AngleSamples]:
    bag = open_bag(arguments.bag)
    tell(*bag.notices)
    return bag, topics_of(arguments).read_angles(bag, machine.sensors.encoder)


def tell_unit(angles: AngleSamples) -> None:
    """Warn if recorded angles seem to have another unit than radians, for commands without a torque."""
    tell(*unit_notes(angles))


def read_samples(arguments: argparse.Namespace, machine: AnyMachine) -> tuple[Bag, AngleSamples, TorqueSamples]:
    """Read angles and measured torque; raises as `read_angles`."""
    bag, angles = _opened(arguments, machine)
    measured, notes = on_one_clock(angles, topics_of(arguments).read_torques(bag))
    tell(*notes)
    angles, measured, timings = evenly_timed(angles, measured, machine)
    tell(*(timing.text for timing in timings))
    return bag, angles, measured


def read_second(arguments: argparse.Namespace, machine: AnyMachine, bag: Bag) -> SecondAngle | None:
    """Read the second encoder's angles if machine and recording have one."""
    second, missing = second_angles(topics_of(arguments), bag, machine)
    tell(*missing)
    return second


def readings_of(angles: AngleSamples, measured: TorqueSamples, second: SecondAngle | None = None) -> Readings:
    """Convert samples to the input of the comparison."""
    stamped = tuple(each.timing for each in (angles, measured) if each.timing is not None)
    return Readings(
        angles.stamps, angles.angles_rad, measured.stamps, measured.torque_Nm, angles.velocities, stamped, second
    )
