"""Angles and torque of a machine in a recording, read once for every command and node, with even times for bursts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from textile_twin_core.arrays import IntArray
from textile_twin_core.comparison import Readings
from textile_twin_core.comparison.readings import SecondAngle
from textile_twin_core.comparison.stamp_timing import StampBursts, StampTiming
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import AnyMachine
from textile_twin_core.recordings.bag import Bag, open_bag
from textile_twin_core.recordings.machine_topics import MachineTopics
from textile_twin_core.recordings.recorded_clock import clock_notes, on_one_clock
from textile_twin_core.recordings.sample_clock import EvenTimes, even_times, find_bursts, sampling_period
from textile_twin_core.recordings.samples import AngleSamples, TorqueSamples

_ONE_BRIDGE = 0.05
"""Largest relative difference of the burst periods of two topics on one bridge."""


@dataclass(frozen=True)
class LoggedRun:
    """Samples of a machine in a recording.

    Attributes:
        bag: The recording.
        angles: Shaft angles as measured.
        measured: Measured torque on the clock of the angles; empty where it was not read or is not in the recording.
        angle_stamps_ns, torque_stamps_ns: Stamps of both as recorded.
        timings: Topics with stamps in bursts, whose times are reconstructed.
        notes: Remarks on the recording and its clocks, for people.
    """

    bag: Bag
    angles: AngleSamples
    measured: TorqueSamples
    angle_stamps_ns: IntArray
    torque_stamps_ns: IntArray
    timings: tuple[StampTiming, ...]
    notes: tuple[str, ...]

    def readings(self, second: SecondAngle | None = None) -> Readings:
        """Return the input of the comparison."""
        return readings_of(self.angles, self.measured, second)


def open_run(
    recording: Path | Bag,
    topics: MachineTopics,
    machine: AnyMachine,
    torque: bool | None = True,
    restarts: bool = False,
) -> LoggedRun:
    """Read the angles and the measured torque of a machine from a recording.

    Args:
        recording: Path, or an opened recording.
        topics: Topics and units.
        machine: Its encoder gives the step and the teeth of the angle.
        torque: Read the torque, too; None: if the recording has one.
        restarts: Samples after a clock was set back are used, too.

    Raises:
        RecordingError: The recording cannot be read, lacks a topic, or its samples have no times.
        SceneError: The encoder of this machine cannot count the recorded edges.
    """
    bag = recording if isinstance(recording, Bag) else open_bag(recording)
    angles = topics.read_angles(bag, machine.sensors.encoder)
    measured = TorqueSamples("", np.empty(0, np.int64), np.empty(0))
    clocks = clock_notes(angles, restarts)
    if torque or (torque is None and bag.has_topic(topics.torque_in(bag))):
        measured, clocks = on_one_clock(angles, topics.read_torques(bag), restarts)
    recorded = [each.stamps if each.recorded_ns is None else each.recorded_ns for each in (angles, measured)]
    angles, measured, timings = evenly_timed(angles, measured, machine)
    notes = (*bag.notices, *clocks, *(timing.text for timing in timings))
    return LoggedRun(bag, angles, measured, recorded[0], recorded[1], tuple(timings), notes)


def readings_of(angles: AngleSamples, measured: TorqueSamples, second: SecondAngle | None = None) -> Readings:
    """Convert samples to the input of the comparison."""
    stamped = tuple(each.timing for each in (angles, measured) if each.timing is not None)
    return Readings(
        angles.stamps, angles.angles_rad, measured.stamps, measured.torque_Nm, angles.velocities, stamped, second
    )


def evenly_timed(
    angles: AngleSamples, measured: TorqueSamples, machine: AnyMachine
) -> tuple[AngleSamples, TorqueSamples, list[StampTiming]]:
    """Replace burst stamps by even times, and return the samples with the properties of these times.

    Raises:
        RecordingError: Stamps come in bursts and the samples were not taken evenly.
    """
    timings: list[StampTiming] = []
    bursts = None if machine.sensors.encoder.teeth else find_bursts(angles.stamps, uneven=True)
    torque_bursts = find_bursts(measured.stamps, uneven=True)
    if bursts is None and torque_bursts is None:
        return angles, measured, timings
    bridge = None
    if bursts and torque_bursts and abs(bursts.period_s / torque_bursts.period_s - 1.0) < _ONE_BRIDGE:
        bridge = np.sort(np.concatenate([angles.stamps, measured.stamps]))
    if bursts is not None:
        found = even_times(angles.stamps, angles.angles_rad, angles=True, bridge_ns=bridge)
        if found is not None:
            recorded = angles.stamps
            angles = replace(angles, stamps=_checked(found, angles.topic, timings), recorded_ns=recorded)
            angles = replace(angles, timing=timings[-1])
    if torque_bursts is not None:
        period = timings[0].period_s if timings else sampling_period(angles.stamps)
        found = even_times(measured.stamps, measured.torque_Nm, angles=False, period_s=period, bridge_ns=bridge)
        if found is not None:
            measured = replace(measured, stamps=_checked(found, measured.topic, timings), timing=timings[-1])
    return angles, measured, timings


def _checked(found: EvenTimes | StampBursts, topic: str, timings: list[StampTiming]) -> IntArray:
    """Return the reconstructed times [ns] and add them to `timings`.

    Raises:
        RecordingError: The times cannot be reconstructed.
    """
    if isinstance(found, StampBursts):
        raise RecordingError(
            f"topic {topic}: the stamps come in bursts, {found.text}, and the samples have no even clock: their"
            " times are unknown; stamp them where they are taken"
        )
    timings.append(StampTiming(topic, found.bursts, found.period_s, found.half_width_s))
    return found.times_ns
