"""Recordings watched for faults: one after the other, in parallel on this machine, or on a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison import Readings
from textile_twin_core.comparison.fault_watch import Alarm, WatchSettings
from textile_twin_core.comparison.monitor import monitor_recording
from textile_twin_core.errors import TwinError
from textile_twin_core.machine import Machine
from textile_twin_core.recordings.bag import open_bag
from textile_twin_core.recordings.job_pool import Outcome, run_jobs
from textile_twin_core.recordings.machine_topics import MachineTopics, unit_notes
from textile_twin_core.recordings.recorded_clock import on_one_clock
from textile_twin_core.recordings.recording import Progress
from textile_twin_core.recordings.recording_folder import recording_names
from textile_twin_core.recordings.sample_times import evenly_timed

_MOST_LEFT = 0.5
"""Share of the measured torque (rms) that the machine may leave unexplained without a word."""


@dataclass(frozen=True)
class Job:
    """One recording to watch, and how."""

    bag: Path
    machine: Machine
    settings: WatchSettings
    topics: MachineTopics


@dataclass(frozen=True)
class Watched:
    """What was seen of a recording: trends by column, (turns,) each, and alarms; error: why it was not watched.

    notes: what a person should know of it. learnt: turns from which it was learnt, which are not watched.
    begin_ns: stamp of the first angle.
    """

    bag: Path
    columns: Mapping[str, FloatArray | IntArray]
    alarms: tuple[Alarm, ...]
    error: str = ""
    notes: tuple[str, ...] = ()
    learnt: int = 0
    begin_ns: int = 0

    def seconds(self, alarm: Alarm) -> float:
        """When an alarm was raised, in seconds since the first angle."""
        return (alarm.stamp_ns - self.begin_ns) * 1e-9


def samples_of(job: Job) -> int:
    """How many angles a recording holds; 0 of one that cannot be read."""
    try:
        return open_bag(job.bag).find_topic(job.topics.angle).count
    except TwinError:
        return 0


def watch_bag(job: Job, progress: Progress | None = None) -> Watched:
    """Watch one recording; a recording that cannot be read gives its error. `progress` as in `monitor_recording`."""
    try:
        bag = open_bag(job.bag)
        angles = job.topics.read_angles(bag, job.machine.sensors.encoder)
        torque, clocks = on_one_clock(angles, job.topics.read_torques(bag))
        angles, torque, timings = evenly_timed(angles, torque, job.machine)
        notes = (*bag.notices, *unit_notes(angles), *clocks, *(timing.text for timing in timings))
        readings = Readings(
            angles.stamps, angles.angles_rad, torque.stamps, torque.torque_Nm, angles.velocities, tuple(timings)
        )
        found = monitor_recording(readings, job.machine, job.settings, progress=progress)
    except TwinError as error:
        return Watched(job.bag, {}, (), str(error))
    notes += found.notes
    turns, learnt = len(found.columns.get("turn", ())), job.settings.learn_turns
    if turns > learnt:
        notes += _foreign(found.columns, torque.torque_Nm)
        begin = int(angles.stamps.min())
        return Watched(job.bag, found.columns, found.alarms, "", notes, learnt, begin)
    why = (
        f"{job.bag}: the shaft makes {turns} whole turns beside measured torque, and the first {learnt} are learnt"
        " from: nothing is watched; record longer, or learn from fewer (--learn)"
    )
    return Watched(job.bag, found.columns, (), "; ".join([why, *notes]))


def _foreign(columns: Mapping[str, FloatArray | IntArray], torque_Nm: FloatArray) -> tuple[str, ...]:
    """A note where the machine explains little of the torque: faults would be named by chance."""
    left, measured = float(np.median(columns["rms_Nm"])), float(np.sqrt(np.mean(np.square(torque_Nm))))
    if left <= _MOST_LEFT * measured:
        return ()
    return (
        f"the residual is {left:.3g} N m rms beside a measured torque of {measured:.3g} N m rms: faults are named by"
        " chance where it is another machine, or its sensors are not settled; textile-twin compare tells why",
    )


def watch_bags(
    jobs: Sequence[Job], workers: int = 1, scheduler: str | None = None, progress: Progress | None = None
) -> Iterator[Outcome[Watched]]:
    """Watch recordings by `run_jobs`, in the order in which they are ready; an error stands in the result.

    Args:
        jobs: the recordings.
        workers: processes on this computer.
        scheduler: address of a Dask cluster, which then watches them.
        progress: as in `monitor_recording`, of recordings that are watched by this process.
    """
    alone = scheduler is None and (workers < 2 or len(jobs) < 2)
    function = partial(watch_bag, progress=progress) if alone else watch_bag
    for outcome in run_jobs(function, jobs, workers, scheduler):
        if outcome.result is None:
            outcome = replace(outcome, result=Watched(jobs[outcome.index].bag, {}, (), outcome.error))
        yield outcome


def names_of(watched: Sequence[Watched]) -> list[str]:
    """The name of each recording (see `recording_names`)."""
    return recording_names([each.bag for each in watched])


def trend_table(watched: Sequence[Watched]) -> dict[str, FloatArray | IntArray | list[str]]:
    """All turns of all recordings in one table, in the order of the recordings; column `bag` names each."""
    some = sorted((each for each in watched if each.columns), key=lambda each: str(each.bag))
    if not some:
        return {}
    called = dict(zip((each.bag for each in watched), names_of(watched), strict=True))
    names: list[str] = []
    for each in some:
        names += [called[each.bag]] * len(each.columns["turn"])
    columns = {name: np.concatenate([each.columns[name] for each in some]) for name in some[0].columns}
    return {"bag": names, **columns}
