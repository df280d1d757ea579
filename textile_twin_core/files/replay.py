"""Offline replay: a recording in, the same recording with the twin's predictions out, as the live twin gives them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from textile_twin_core.arrays import IntArray
from textile_twin_core.comparison.residual import ResidualStream, load_jumps
from textile_twin_core.files.bag import Bag, TorqueSamples
from textile_twin_core.files.bag_write import BagWriter
from textile_twin_core.files.cdr_encode import encode_string
from textile_twin_core.files.prediction import ANGLE_TOPIC, MEASURED_TOPIC, TORQUE, predictions, usable_angles
from textile_twin_core.files.recording import Progress
from textile_twin_core.files.rosbag2_metadata import LATCHED
from textile_twin_core.machines import Machine
from textile_twin_core.shaft import SampleReport
from textile_twin_core.twin import Samples, Session, compile_machine

_RESIDUAL_STEP_NS = 500_000_000
"""Predicted and measured torque meet in steps shorter than either waits for the other."""


@dataclass
class Replay:
    """What a replay did: the report on the angle samples and the messages written by topic."""

    report: SampleReport
    counts: dict[str, int] = field(default_factory=dict)


def replay_bag(
    bag: Bag,
    out: BagWriter,
    machine: Machine,
    *,
    shaft: str = "causal",
    angle_topic: str = ANGLE_TOPIC,
    torque_topic: str = MEASURED_TOPIC,
    joint: str = "main_shaft",
    skip_bad: bool = False,
    progress: Progress | None = None,
    **shaft_settings: float,
) -> Replay:
    """Copy a recording and add what the twin predicts, each message with its angle sample's stamp.

    Topics as the live twin's: balancing_torque/predicted and predicted_sigma (for a machine with torque), the
    position of each measured point such as needle/position, joint_states, robot_description; and
    balancing_torque/residual at the stamps of the measured torque, when the recording has one. A namespace of the
    angle's topic is kept. Topics of these names in the recording are not copied.
    """
    angles = usable_angles(bag, angle_topic, joint, skip_bad)
    namespace = angles.topic.removesuffix(angle_topic.strip("/")).rstrip("/")
    writer = _Predictions(machine, out, namespace)
    for name in bag.topics:
        if name not in writer.topics:
            out.copy_topic(bag, name)
    session = compile_machine(machine, writer.outputs).session(shaft, **shaft_settings)
    torque = bag.read_torques(torque_topic, joint) if bag.has_topic(torque_topic) else None
    residual = None if torque is None or not writer.has_torque else _Residual(session, torque, out, writer)
    out.write(writer.description, bag.start_ns, encode_string(machine.urdf()))
    for samples in predictions(session, angles, progress):
        writer.write(samples)
        if residual is not None:
            residual.write(samples)
    return Replay(session.report, out.counts)


class _Predictions:
    """Writes the topics of a machine's predictions."""

    def __init__(self, machine: Machine, out: BagWriter, namespace: str) -> None:
        self._out = out
        self.has_torque = not machine.missing_for_torque
        self.torque, self.sigma, self.residual = (
            f"{namespace}/balancing_torque/{name}" for name in ("predicted", "predicted_sigma", "residual")
        )
        self.joint_states, self.description = f"{namespace}/joint_states", f"{namespace}/robot_description"
        self._joints = [joint.name for joint in machine.joints if joint.kind != "fixed"]
        self._points = {f"{namespace}/{name}/position": point for name, point in _followed(machine).items()}
        torque_topics = [self.torque, self.sigma, self.residual] if self.has_torque else []
        self.topics = {*torque_topics, *self._points, self.joint_states, self.description}
        joints = [f"joint_{name}_{what}" for name in self._joints for what in ("position", "velocity")]
        points = [f"point_{point}_{axis}_m" for point in self._points.values() for axis in "xy"]
        self.outputs = [*([TORQUE] if self.has_torque else []), *points, *joints]
        out.add_topic(self.description, "std_msgs/msg/String", LATCHED)

    def write(self, samples: Samples) -> None:
        """Write the predictions of a block."""
        stamps = np.asarray(samples.stamps, np.int64)
        if self.has_torque:
            self._out.write_wrenches(self.torque, stamps, samples[TORQUE])
            self._out.write_wrenches(self.sigma, stamps, samples.torque_sigma_Nm)
        for topic, point in self._points.items():
            x, y = samples[f"point_{point}_x_m"], samples[f"point_{point}_y_m"]
            self._out.write_points(topic, stamps, np.stack([x, y, np.zeros(len(x))], axis=1))
        position, velocity = (
            np.stack([samples[f"joint_{name}_{what}"] for name in self._joints], axis=1)
            for what in ("position", "velocity")
        )
        self._out.write_joint_states(self.joint_states, stamps, self._joints, position, velocity)


def _followed(machine: Machine) -> dict[str, str]:
    """Measure -> the point whose place tells it: that of a travel, the end of the link for an arc."""
    ends = {link.name: link.end for link in machine.links}
    points = (
        (measure.name, getattr(measure, "point", ends.get(getattr(measure, "link", ""))))
        for measure in machine.measures
    )
    return {name: point for name, point in points if point is not None}


class _Residual:
    """Writes measured minus predicted torque, paired as the live twin pairs them."""

    def __init__(self, session: Session, torque: TorqueSamples, out: BagWriter, topics: _Predictions) -> None:
        twin = session.twin
        self._stream = ResidualStream(twin.machine.sensors.torque, load_jumps(twin))
        self._torque, self._out, self._topic = torque, out, topics.residual
        self._next = 0

    def write(self, samples: Samples) -> None:
        """Take a block of predictions and the torque measured meanwhile."""
        stamps: IntArray = np.asarray(samples.stamps, np.int64)
        found = []
        start = 0
        while start < len(stamps):
            end = int(np.searchsorted(stamps, stamps[start] + _RESIDUAL_STEP_NS))
            part = slice(start, end)
            found += self._stream.predicted(
                stamps[part].tolist(), samples[TORQUE][part].tolist(), samples.theta_rad[part].tolist()
            )
            while self._next < len(self._torque) and self._torque.stamps[self._next] <= stamps[end - 1]:
                k = self._next
                found += self._stream.measured(int(self._torque.stamps[k]), float(self._torque.torque_Nm[k]))
                self._next += 1
            start = end
        if found:
            times = np.array([residual.stamp_ns for residual in found], np.int64)
            self._out.write_wrenches(self._topic, times, np.array([residual.residual_Nm for residual in found]))
