"""Predictions at the recorded angles named by the arguments of a command."""

from __future__ import annotations

import argparse

import numpy as np

from textile_twin_core.cli.arguments import shaft_settings
from textile_twin_core.cli.progress import progress
from textile_twin_core.cli.readings import read_angles, read_second, tell_unit
from textile_twin_core.machine import AnyMachine, Machine
from textile_twin_core.recordings.prediction import predictions
from textile_twin_core.recordings.recorded_clock import one_record
from textile_twin_core.twin import Samples, compile_machine
from textile_twin_core.twin.predictor import StampedEvent


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
