"""Offline replay: copies a recording and adds the predictions of the twin, equal to those of the live twin."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from textile_twin_core.arrays import IntArray
from textile_twin_core.comparison.residual import Residual, ResidualStream, load_steps
from textile_twin_core.machine import AnyMachine
from textile_twin_core.recordings.bag import Bag
from textile_twin_core.recordings.bag_write import BagWriter
from textile_twin_core.recordings.cdr_encode import encode_string
from textile_twin_core.recordings.logged_run import open_run
from textile_twin_core.recordings.machine_topics import MachineTopics, namespace_of, unit_notes
from textile_twin_core.recordings.predicted_topics import TORQUE, PredictedTopics, predicted_topics
from textile_twin_core.recordings.prediction import predictions, second_angles
from textile_twin_core.recordings.recording import Progress
from textile_twin_core.recordings.rosbag2_metadata import LATCHED
from textile_twin_core.recordings.samples import TorqueSamples
from textile_twin_core.shaft import SampleReport
from textile_twin_core.twin import Samples, compile_machine
from textile_twin_core.twin.restart import BACK_NS, RestartWatch

_LOOK_AHEAD = 10
"""Number of later torques that reveal a stamp far ahead."""
_RESIDUAL_STEP_NS = 500_000_000
"""Step in which predicted and measured torque are paired, shorter than the waiting time of either."""


@dataclass
class Replay:
    """Result of a replay: report on the angle samples, messages written by topic, remarks for the user."""

    report: SampleReport
    counts: dict[str, int] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def replay_bag(
    bag: Bag,
    out: BagWriter,
    machine: AnyMachine,
    *,
    shaft: str = "causal",
    recorded: MachineTopics | None = None,
    progress: Progress | None = None,
    **shaft_settings: float,
) -> Replay:
    """Copy a recording and add the predictions of the twin, each message with the stamp of its angle sample.

    The topics are those of the live twin (see predicted_topics): balancing_torque/predicted and predicted_sigma,
    positions such as needle/position, joint_states, robot_description of a linkage. With a measured torque in the
    recording, balancing_torque/residual is added at its stamps. A second encoder's angles correct the twist of an
    elastic shaft. The namespace of the angle topic applies to all. Topics
    of these names in the recording are not copied.
    """
    recorded = recorded or MachineTopics()
    topics = predicted_topics(machine)
    run = open_run(bag, recorded, machine, None if topics.has_torque else False, restarts=True)
    angles = run.angles
    namespace = namespace_of(angles.topic)
    writer = _Predictions(topics, out, namespace)
    description = f"{namespace}/robot_description"
    for name in bag.topics:
        if name not in (*writer.topics, description):
            out.copy_topic(bag, name)
    out.add_topic(description, "std_msgs/msg/String", LATCHED)
    out.write(description, bag.start_ns, encode_string(machine.urdf()))
    residual = None
    if len(run.measured):
        stream = ResidualStream(machine.sensors.torque, load_steps(compile_machine(machine, [TORQUE])))
        residual = _Residual(stream, run.measured, run.torque_stamps_ns, out, writer.residual)
    session = compile_machine(machine, topics.outputs).session(shaft, **shaft_settings)
    second, missing = second_angles(recorded, bag, machine)
    for samples in predictions(session, angles, progress, second):
        writer.write(samples, run.angle_stamps_ns[samples.index])
        if residual is not None:
            residual.write(samples)
    return Replay(session.report, out.counts, [*unit_notes(angles), *run.notes[len(bag.notices) :], *missing])


class _Predictions:
    """Writer of the topics of a machine's predictions."""

    def __init__(self, topics: PredictedTopics, out: BagWriter, namespace: str) -> None:
        self._predicted, self._out = topics, out
        self._torque, self._sigma, self.residual = (
            f"{namespace}/balancing_torque/{name}" for name in ("predicted", "predicted_sigma", "residual")
        )
        self._joint_states = f"{namespace}/joint_states"
        self._points = {f"{namespace}/{topic}": point for topic, point in topics.points.items()}
        self._namespace = namespace
        elastic = [f"{namespace}/{topic}" for topic in (*topics.pieces, *topics.numbers)]
        self.topics = (self._torque, self._sigma, self.residual, self._joint_states, *self._points, *elastic)

    def write(self, samples: Samples, stamps: IntArray) -> None:
        """Write the predictions of a block at the stamps (n,) [ns] of their samples."""
        if self._predicted.has_torque:
            self._out.write_wrenches(self._torque, stamps, samples[TORQUE])
            self._out.write_wrenches(self._sigma, stamps, samples.torque_sigma_Nm)
        for topic, point in self._points.items():
            x, y = samples[f"point_{point}_x_m"], samples[f"point_{point}_y_m"]
            z = np.full(len(x), self._predicted.depths_m.get(topic.removeprefix(f"{self._namespace}/"), 0.0))
            self._out.write_points(topic, stamps, np.stack([x, y, z], axis=1))
        for topic, (output, frame) in self._predicted.pieces.items():
            self._out.write_wrenches(f"{self._namespace}/{topic}", stamps, samples[output], frame)
        for topic, output in self._predicted.numbers.items():
            self._out.write_floats(f"{self._namespace}/{topic}", stamps, samples[output])
        joints = self._predicted.joints
        position, velocity = (
            np.stack([samples[names[which]] for names in joints.values()], axis=1) for which in range(2)
        )
        self._out.write_joint_states(self._joint_states, stamps, list(joints), position, velocity)


class _Residual:
    """Writer of measured minus predicted torque, paired as in the live twin."""

    def __init__(
        self, stream: ResidualStream, torque: TorqueSamples, stamps: IntArray, out: BagWriter, topic: str
    ) -> None:
        self._stream, self._torque, self._out, self._topic = stream, torque, out, topic
        self._stamps = None if torque.stamps is stamps else stamps  # as recorded
        self._restarts = [*RestartWatch().restarts(_without_leaps(torque.stamps)), len(torque)]
        """Torques from which on a clock that was set back counts again, and their number."""
        # A single stamp far ahead must not block the later ones.
        highest = np.full(_LOOK_AHEAD, np.iinfo(np.int64).max)
        due = []
        for begin, end in pairwise([0, *self._restarts]):
            later = np.concatenate([torque.stamps[begin:end], highest])
            due.append(np.lib.stride_tricks.sliding_window_view(later, _LOOK_AHEAD + 1).min(axis=1))
        self._due = np.concatenate(due)
        self._begun = self._next = 0
        self._newest: int | None = None

    def write(self, samples: Samples) -> None:
        """Add a block of predictions and the torques measured meanwhile."""
        stamps: IntArray = np.asarray(samples.stamps, np.int64)
        for begin, end in pairwise([0, *np.flatnonzero(np.diff(stamps) <= 0) + 1, len(stamps)]):
            if self._newest is not None and stamps[begin] <= self._newest:
                self._write(self._measured_until(None))
                if len(self._restarts) > 1:
                    self._begun = self._restarts.pop(0)
            self._newest = int(stamps[end - 1])
            found: list[Residual] = []
            start = begin
            while start < end:
                to = begin + int(np.searchsorted(stamps[begin:end], stamps[start] + _RESIDUAL_STEP_NS))
                part = slice(start, to)
                found += self._stream.predicted(
                    stamps[part].tolist(), samples[TORQUE][part].tolist(), samples.theta_rad[part].tolist()
                )
                found += self._measured_until(int(stamps[to - 1]))
                start = to
            self._write(found)

    def _measured_until(self, stamp_ns: int | None) -> list[Residual]:
        """Add the torques due by a stamp, or all up to where their clock was set back."""
        found: list[Residual] = []
        while self._next < self._restarts[0] and (stamp_ns is None or self._due[self._next] <= stamp_ns):
            k = self._next
            found += self._stream.measured(int(self._torque.stamps[k]), float(self._torque.torque_Nm[k]))
            self._next += 1
        return found

    def _write(self, found: list[Residual]) -> None:
        if found:
            times = np.array([residual.stamp_ns for residual in found], np.int64)
            if self._stamps is not None:
                part = slice(self._begun, self._restarts[0])
                times = self._stamps[part][np.searchsorted(self._torque.stamps[part], times)]
            self._out.write_wrenches(self._topic, times, np.array([residual.residual_Nm for residual in found]))


def _without_leaps(stamps: IntArray) -> IntArray:
    """Replace single stamps more than a second ahead of both neighbours, after which the clock goes on as before."""
    if stamps.size < 3:
        return stamps
    before, here, after = stamps[:-2], stamps[1:-1], stamps[2:]
    ahead = (here - np.maximum(before, after) > BACK_NS) & (after > before)
    return np.concatenate([stamps[:1], np.where(ahead, before, here), stamps[-1:]])
