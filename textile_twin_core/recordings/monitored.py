"""Monitoring of recordings for faults: one after the other, in parallel processes, or on a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison.fault_watch import Alarm, WatchSettings
from textile_twin_core.comparison.monitor import monitor_recording
from textile_twin_core.errors import TwinError
from textile_twin_core.machine import Machine
from textile_twin_core.recordings.bag import open_bag
from textile_twin_core.recordings.job_pool import Outcome, run_jobs
from textile_twin_core.recordings.logged_run import open_run
from textile_twin_core.recordings.machine_topics import MachineTopics, unit_notes
from textile_twin_core.recordings.recording import Progress
from textile_twin_core.recordings.recording_paths import recording_names

_LARGEST_RESIDUAL = 0.5
"""Largest RMS residual over the RMS measured torque without a warning."""


@dataclass(frozen=True)
class Job:
    """Recording to monitor, with machine and settings."""

    bag: Path
    machine: Machine
    settings: WatchSettings
    topics: MachineTopics


@dataclass(frozen=True)
class Watched:
    """Result of monitoring a recording.

    Attributes:
        bag: The recording.
        columns: Trends by column, (turns,) each.
        alarms: Alarms raised.
        error: Reason why the recording was not monitored; empty otherwise.
        notes: Remarks on the recording for the user.
        learnt: Number of turns until the baseline was learnt, which are not monitored.
        begin_ns: Stamp of the first angle [ns].
    """

    bag: Path
    columns: Mapping[str, FloatArray | IntArray]
    alarms: tuple[Alarm, ...]
    error: str = ""
    notes: tuple[str, ...] = ()
    learnt: int = 0
    begin_ns: int = 0

    def seconds(self, alarm: Alarm) -> float:
        """Return the time of an alarm since the first angle [s]."""
        return (alarm.stamp_ns - self.begin_ns) * 1e-9


def samples_of(job: Job) -> int:
    """Return the number of angles in a recording; 0 if it cannot be read."""
    try:
        return open_bag(job.bag).find_topic(job.topics.angle).count
    except TwinError:
        return 0


def watch_bag(job: Job, progress: Progress | None = None) -> Watched:
    """Monitor one recording; an unreadable recording gives its error. `progress` as in `monitor_recording`."""
    try:
        run = open_run(job.bag, job.topics, job.machine)
        notes = (*run.notes, *unit_notes(run.angles))
        readings = run.readings()
        found = monitor_recording(readings, job.machine, job.settings, progress=progress)
    except TwinError as error:
        return Watched(job.bag, {}, (), str(error))
    notes += found.notes
    if found.cycles:
        notes += ("the shaft reverses: a turn stands for a cycle of its motion, there and back",)
    turns, learnt = len(found.columns.get("turn", ())), max(found.unwatched, job.settings.learn_turns)
    if turns > learnt:
        notes += _foreign(found.columns, run.measured.torque_Nm)
        begin = int(run.angles.stamps.min())
        return Watched(job.bag, found.columns, found.alarms, "", notes, learnt, begin)
    why = (
        f"{job.bag}: the shaft makes {turns} whole turns beside measured torque, and {job.settings.learn_turns} at"
        " steady speed are the baseline: nothing is watched; record longer, or learn from fewer (--learn)"
    )
    return Watched(job.bag, found.columns, (), "; ".join([why, *notes]))


def _foreign(columns: Mapping[str, FloatArray | IntArray], torque_Nm: FloatArray) -> tuple[str, ...]:
    """Warn if the machine explains little of the torque, since faults would then be named by chance."""
    residual, measured = float(np.median(columns["rms_Nm"])), float(np.sqrt(np.nanmean(np.square(torque_Nm))))
    if residual <= _LARGEST_RESIDUAL * measured:
        return ()
    return (
        f"the residual is {residual:.3g} N m rms beside a measured torque of {measured:.3g} N m rms: faults are named"
        " by chance if this is another machine, or its sensors are not calibrated; textile-twin compare shows why",
    )


def watch_bags(
    jobs: Sequence[Job], workers: int = 1, scheduler: str | None = None, progress: Progress | None = None
) -> Iterator[Outcome[Watched]]:
    """Monitor recordings by `run_jobs` and yield outcomes in the order of completion; errors are part of the result.

    Args:
        jobs: Recordings to monitor.
        workers: Number of processes on this computer.
        scheduler: Address of a Dask cluster, which then does the work.
        progress: As in `monitor_recording`, for recordings monitored by this process.
    """
    alone = scheduler is None and (workers < 2 or len(jobs) < 2)
    function = partial(watch_bag, progress=progress) if alone else watch_bag
    for outcome in run_jobs(function, jobs, workers, scheduler):
        if outcome.result is None:
            outcome = replace(outcome, result=Watched(jobs[outcome.index].bag, {}, (), outcome.error))
        yield outcome


def names_of(watched: Sequence[Watched]) -> list[str]:
    """Return the name of each recording (see `recording_names`)."""
    return recording_names([each.bag for each in watched])


def trend_table(watched: Sequence[Watched]) -> dict[str, FloatArray | IntArray | list[str]]:
    """Combine the turns of all recordings in one table, in the order of the recordings; column `bag` names each."""
    some = sorted((each for each in watched if each.columns), key=lambda each: str(each.bag))
    if not some:
        return {}
    called = dict(zip((each.bag for each in watched), names_of(watched), strict=True))
    names: list[str] = []
    for each in some:
        names += [called[each.bag]] * len(each.columns["turn"])
    columns = {name: np.concatenate([each.columns[name] for each in some]) for name in some[0].columns}
    return {"bag": names, **columns}
