"""Recording as the commands take it: readings of a machine's shaft and torque, and predictions from them."""

from __future__ import annotations

import argparse

import numpy as np

from textile_twin_core.cli.arguments import shaft_settings
from textile_twin_core.cli.mistakes import tell
from textile_twin_core.cli.progress import progress
from textile_twin_core.cli.sensor_options import topics_of
from textile_twin_core.comparison.readings import SecondAngle
from textile_twin_core.machine import AnyMachine, Machine
from textile_twin_core.recordings.bag import Bag
from textile_twin_core.recordings.logged_run import LoggedRun, open_run, readings_of
from textile_twin_core.recordings.machine_topics import unit_notes
from textile_twin_core.recordings.prediction import predictions, second_angles
from textile_twin_core.recordings.recorded_clock import one_record
from textile_twin_core.recordings.samples import AngleSamples, TorqueSamples
from textile_twin_core.twin import Samples, compile_machine
from textile_twin_core.twin.predictor import StampedEvent

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


def station_angles(arguments: argparse.Namespace, machine: AnyMachine) -> tuple[np.ndarray, np.ndarray] | None:
    """Return stamps (n,) [ns] and angles (n, stations) [rad] of the stations of an elastic shaft; None for a
    rigid shaft.
    """
    stations = [name for name, _ in station_joints(machine)]
    if not stations:
        return None
    stamps, blocks, _ = predicted_blocks(arguments, machine, stations, arguments.shaft)
    return stamps, columns_of(blocks, stations)


def station_joints(machine: AnyMachine) -> list[tuple[str, str]]:
    """Return the outputs for angle and speed of each station of an elastic shaft."""
    shaft = machine.shaft if isinstance(machine, Machine) else None
    return [] if shaft is None else [machine.joint_outputs[f"station_{name}"] for name in shaft.names]


def columns_of(blocks: list[Samples], names: list[str]) -> np.ndarray:
    """Concatenate the outputs of blocks as (n, names)."""
    return np.concatenate([np.stack([block[name] for name in names], axis=1) for block in blocks])


def predicted_blocks(
    arguments: argparse.Namespace, machine: AnyMachine, outputs: list[str], shaft: str
) -> tuple[np.ndarray, list[Samples], list[StampedEvent]]:
    """Return stamps [ns] and predictions at the recorded angles, and the events at stops and pads."""
    bag, angles = read_angles(arguments, machine)
    tell_unit(angles)
    angles = one_record(angles)
    session = compile_machine(machine, outputs).session(shaft, **shaft_settings(arguments))
    with progress(len(angles), "predicting") as done:
        blocks, events = [], list[StampedEvent]()
        for block in predictions(session, angles, done, read_second(arguments, machine, bag)):
            blocks.append(block)
            events += session.take_events()
    return np.concatenate([np.asarray(block.stamps, np.int64) for block in blocks]), blocks, events
