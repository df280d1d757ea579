"""Logged samples of the recording named by the arguments."""

from __future__ import annotations

import argparse

from textile_twin_core.cli.mistakes import tell
from textile_twin_core.cli.sensor_options import topics_of
from textile_twin_core.comparison.readings import SecondAngle
from textile_twin_core.machine import AnyMachine
from textile_twin_core.recordings.bag import Bag
from textile_twin_core.recordings.logged_run import LoggedRun, open_run, readings_of
from textile_twin_core.recordings.machine_topics import unit_notes
from textile_twin_core.recordings.prediction import second_angles
from textile_twin_core.recordings.samples import AngleSamples, TorqueSamples

__all__ = ["read_angles", "read_samples", "read_second", "readings_of", "tell_unit"]


def read_angles(arguments: argparse.Namespace, machine: AnyMachine) -> tuple[Bag, AngleSamples]:
    """Open the recording named by the arguments of add_recording, and read its shaft angles; raises as `open_run`."""
    run = _opened(arguments, machine, torque=False)
    return run.bag, run.angles


def read_samples(arguments: argparse.Namespace, machine: AnyMachine) -> tuple[Bag, AngleSamples, TorqueSamples]:
    """Read angles and measured torque; raises as `open_run`."""
    run = _opened(arguments, machine, torque=True)
    return run.bag, run.angles, run.measured


def _opened(arguments: argparse.Namespace, machine: AnyMachine, torque: bool) -> LoggedRun:
    run = open_run(arguments.bag, topics_of(arguments), machine, torque)
    tell(*run.notes)
    return run


def tell_unit(angles: AngleSamples) -> None:
    """Warn if recorded angles seem to have another unit than radians, for commands without a torque."""
    tell(*unit_notes(angles))


def read_second(arguments: argparse.Namespace, machine: AnyMachine, bag: Bag) -> SecondAngle | None:
    """Read the second encoder's angles if machine and recording have one."""
    second, missing = second_angles(topics_of(arguments), bag, machine)
    tell(*missing)
    return second
