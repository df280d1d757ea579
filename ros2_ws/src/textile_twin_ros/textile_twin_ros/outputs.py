# Copyright 2026 textile-twin contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
#
# SPDX-License-Identifier: Apache-2.0

"""Topics of the twin: one session of the engine, the outputs that listeners need, and how samples become messages."""

from __future__ import annotations

import math
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from typing import Any, TypeAlias

import numpy as np
from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo
from rclpy.lifecycle import LifecycleNode, LifecyclePublisher
from rclpy.qos_overriding_options import QoSOverridingOptions

import textile_twin_core as ttc
from textile_twin_core.comparison.residual import Residual, ResidualStream, load_steps
from textile_twin_core.machine import AnyMachine
from textile_twin_core.recordings.predicted_topics import predicted_topics
from textile_twin_core.recordings.schemas import FLOAT64, JOINT_STATE, POINT, WRENCH
from textile_twin_core.shaft import SampleReport
from textile_twin_core.twin import ElasticTwin, HistoryTwin, Twin, idle_twin
from textile_twin_core.twin.session import Sample, has_second_encoder
from textile_twin_ros import contact_events
from textile_twin_ros.diagnostics import OK, WARN, Status
from textile_twin_ros.endpoints import samples_qos
from textile_twin_ros.health import (
    CountWindow,
    residual_findings,
    sample_counts,
    stalled_findings,
    state_level,
    with_findings,
)
from textile_twin_ros.messages import (
    SECOND_NS,
    JointTemplate,
    PointTemplate,
    WrenchTemplate,
    float_message,
    message_class,
)
from textile_twin_ros.publishing import Publish, RCLError

TORQUE = "balancing_torque_Nm"
SHAFT_FRAME = "main_shaft"
BASE_FRAME = "base"
SIGMA_TOPIC = "balancing_torque/predicted_sigma"
RESIDUAL_TOPIC = "balancing_torque/residual"
_REPEAT_S = 10.0
"""Shortest time between reports on stamps that step to and fro [s]."""
_PAUSE_S = 0.05

CompiledTwin: TypeAlias = Twin | ElasticTwin | HistoryTwin
Pack: TypeAlias = Callable[[Sample], bytes | None]


@dataclass(frozen=True)
class Output:
    """One topic that the twin publishes from samples.

    Attributes:
        needs: the outputs of the engine that it is made of.
        pack: returns the message of a sample; None where its rate leaves the sample out.
    """

    topic: str
    msgtype: str
    needs: tuple[str, ...]
    pack: Pack


def _torque_output(topic: str, output: str = TORQUE, frame: str = SHAFT_FRAME) -> Output:
    message = WrenchTemplate(frame).message
    return Output(topic, WRENCH, (output,), lambda sample: message(sample.stamp, sample.outputs[output]))


def _sigma_output() -> Output:
    message = WrenchTemplate(SHAFT_FRAME).message
    return Output(SIGMA_TOPIC, WRENCH, (TORQUE,), lambda sample: message(sample.stamp, sample.torque_sigma_Nm))


def _point_output(topic: str, point: str, z_m: float) -> Output:
    needs = (f"point_{point}_x_m", f"point_{point}_y_m")
    place, message = itemgetter(*needs), PointTemplate(BASE_FRAME, z_m).message
    return Output(topic, POINT, needs, lambda sample: message(sample.stamp, *place(sample.outputs)))


def _number_output(topic: str, output: str) -> Output:
    return Output(topic, FLOAT64, (output,), lambda sample: float_message(sample.outputs[output]))


def _joint_output(machine: AnyMachine, rate_hz: Callable[[], float]) -> Output:
    """Positions and velocities of every joint of a machine, passive ones too, at a limited rate."""
    message, keeps = JointTemplate(tuple(machine.joint_outputs)).full_message, Thinning(rate_hz).keeps
    positions, velocities = zip(*machine.joint_outputs.values(), strict=True)
    needs, count = (*positions, *velocities), len(positions)
    values_of = itemgetter(*needs)

    def pack(sample: Sample) -> bytes | None:
        if not keeps(sample.stamp):
            return None
        values = values_of(sample.outputs)
        return message(sample.stamp, values[:count], values[count:])

    return Output("joint_states", JOINT_STATE, needs, pack)


class Thinning:
    """Chooses by their stamps which samples a limited rate leaves over.

    Args:
        rate_hz: returns the largest rate, 0 for no limit.
    """

    def __init__(self, rate_hz: Callable[[], float]) -> None:
        self._rate_hz = rate_hz
        self._slot: int | None = None

    def keeps(self, stamp_ns: int) -> bool:
        """True for the first sample in each period of the rate."""
        rate = self._rate_hz()
        if rate <= 0.0:
            return True
        slot = int(stamp_ns * rate) // SECOND_NS
        first, self._slot = slot != self._slot, slot
        return first


def outputs_of(machine: AnyMachine, joint_rate_hz: Callable[[], float]) -> list[Output]:
    """The topics that a machine has, without the residual.

    Each measure of a linkage (needle, beater, sley) gives the topic of its point's position; for an elastic shaft see
    `predicted_topics`.
    """
    topics = predicted_topics(machine)
    outputs = [_torque_output("balancing_torque/predicted"), _sigma_output()] if machine.has_complete_torque else []
    outputs += [_point_output(topic, point, topics.depths_m.get(topic, 0.0)) for topic, point in topics.points.items()]
    outputs += [_torque_output(topic, output, frame) for topic, (output, frame) in topics.pieces.items()]
    outputs += [_number_output(topic, output) for topic, output in topics.numbers.items()]
    return [*outputs, _joint_output(machine, joint_rate_hz)]


def topics_of(machine: AnyMachine) -> dict[str, str]:
    """Every topic that comes of a machine's samples, with its message type."""
    topics = {output.topic: output.msgtype for output in outputs_of(machine, lambda: 0.0)}
    if machine.has_complete_torque:
        topics[RESIDUAL_TOPIC] = WRENCH
    if machine.has_history:
        topics[contact_events.TOPIC] = contact_events.MSGTYPE
    return topics


def twins_of(machine: AnyMachine) -> Callable[[tuple[str, ...]], CompiledTwin]:
    """Compiles twins of a machine and keeps each that it has made."""
    made: dict[tuple[str, ...], CompiledTwin] = {}

    def compile_twin(outputs: tuple[str, ...]) -> CompiledTwin:
        if outputs not in made:
            made[outputs] = ttc.compile(machine, outputs=outputs) if outputs else idle_twin(machine)
        return made[outputs]

    return compile_twin


class PublishQueue:
    """Publisher for callbacks: refused messages wait, in their order, for the next call of `send` or `retry`.

    Args:
        publish: publishes one message.
        depth: messages that wait at most; beyond it the oldest are dropped and counted in `dropped`.
    """

    def __init__(self, publish: Publish, depth: int) -> None:
        self._publish, self._depth = publish, depth
        self._waiting: deque[Any] = deque()
        self._refused_s = 0.0
        self.dropped = 0

    def send(self, message: Any) -> None:
        """Publish a message behind those that wait."""
        if not self._waiting:
            try:
                return self._publish(message)
            except RCLError:
                self._refused_s = time.monotonic()
        self._waiting.append(message)
        if len(self._waiting) > self._depth:
            self._waiting.popleft()
            self.dropped += 1
        return self.retry()

    def retry(self) -> None:
        """Publish the messages that wait, until one is refused; at most once in 50 ms."""
        if not self._waiting or time.monotonic() - self._refused_s < _PAUSE_S:
            return
        try:
            while self._waiting:
                self._publish(self._waiting[0])
                self._waiting.popleft()
        except RCLError:
            self._refused_s = time.monotonic()


class TwinStream:
    """Angle samples and measured torques in, messages out, by one session of the engine.

    Args:
        node: gives the publishers.
        machine: what the twin is of.
        shaft: the estimator, with its settings.
        depth: of the publishers' queues.
        joint_rate_hz: returns the largest rate of joint_states.
        on_matched: called where a topic has gained or lost a subscriber.
    """

    def __init__(
        self,
        node: LifecycleNode,
        machine: AnyMachine,
        shaft: str,
        settings: Mapping[str, float],
        depth: int,
        joint_rate_hz: Callable[[], float],
        on_matched: Callable[[], None],
    ) -> None:
        self._node, self._on_matched = node, on_matched
        self._machine = machine.name
        self._compile = twins_of(machine)
        self._outputs = outputs_of(machine, joint_rate_hz)
        # A machine with a history goes through all of it, with or without listeners.
        self._has_history = machine.has_history
        self._idle = self._compile(self._needs(self._outputs) if self._has_history else ())
        self._has_torque = machine.has_complete_torque
        self._has_second = has_second_encoder(machine)
        jumps = load_steps(self._compile((TORQUE,))) if self._has_torque else ()
        self._residuals = ResidualStream(machine.sensors.torque, jumps)
        self._recent_residuals = CountWindow()
        self._residual_message = WrenchTemplate(SHAFT_FRAME).message
        self._session = self._idle.session(shaft, **settings)
        # One by one then costs less than a block, and gives the first of a block that came late sooner.
        self._at_once = self._session.at_once and not self._has_history
        self._wanted: list[Output] = []
        self._wants_residual = self._wants_sigma = False
        self._calls: list[tuple[Pack, Publish]] = []
        self._warm_up()
        self.subscribers: Counter[str] = Counter()
        """Number of subscribers by topic."""
        self.publishers: dict[str, LifecyclePublisher] = {
            topic: node.create_lifecycle_publisher(
                message_class(msgtype),
                topic,
                samples_qos(depth),
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
                event_callbacks=PublisherEventCallbacks(matched=partial(self._match, topic)),
            )
            for topic, msgtype in topics_of(machine).items()
        }
        self._queues = {topic: PublishQueue(publisher.publish, depth) for topic, publisher in self.publishers.items()}

    def _match(self, topic: str, event: QoSPublisherMatchedInfo) -> None:
        self.subscribers[topic] = event.current_count
        self._on_matched()

    def destroy(self) -> None:
        """Remove the publishers."""
        for publisher in self.publishers.values():
            self._node.destroy_lifecycle_publisher(publisher)

    def reset(self) -> None:
        """Forget all samples."""
        self._session.reset()
        self._residuals.reset()

    def choose_outputs(self, measured: bool) -> None:
        """Compile the outputs that have listeners now.

        Args:
            measured: whether there is measured torque, so that residuals can be.
        """
        wanted = [output for output in self._outputs if self.subscribers[output.topic]]
        residual = self._has_torque and measured
        if wanted == self._wanted and residual == self._wants_residual:
            return
        self._wanted, self._wants_residual = wanted, residual
        self._wants_sigma = any(output.topic == SIGMA_TOPIC for output in wanted)
        self._calls = [(output.pack, self._queues[output.topic].send) for output in wanted]
        if not self._has_history:
            needs = self._needs(wanted, (TORQUE,) if residual else ())
            self._session.use(self._compile(needs) if needs else self._idle)

    @staticmethod
    def _needs(outputs: Iterable[Output], more: tuple[str, ...] = ()) -> tuple[str, ...]:
        """Outputs of the engine that these topics need, each once."""
        return tuple(dict.fromkeys([name for output in outputs for name in output.needs] + list(more)))

    def wanted_topics(self) -> list[str]:
        """The topics that are computed at present."""
        return [output.topic for output in self._wanted] + ([RESIDUAL_TOPIC] if self._wants_residual else [])

    def take_angles(self, block: list[tuple[int, float, float]]) -> None:
        """Predict from samples: stamp [ns], angle [rad], speed [rad/s] or NaN."""
        before = self._session.restarts
        if len(block) < 2 or (self._at_once and not self._wants_sigma):
            for stamp, angle, speed in block:
                known = None if math.isnan(speed) else speed
                self._publish(self._session.step_one(stamp, angle, known, self._wants_sigma))
        else:
            stamps, angles, speeds = zip(*block, strict=True)
            samples = self._session.step(np.array(stamps, dtype=np.int64), np.array(angles), np.array(speeds))
            self._publish(samples.rows(self._wants_sigma))
        if self._has_history:
            self._publish_events()
        if self._session.restarts > before:
            self._node.get_logger().warning(
                "the stamps of the shaft angle went back and go on from there: the prediction restarts",
                throttle_duration_sec=_REPEAT_S,
            )

    def take_second_angles(self, block: list[tuple[int, float, float]]) -> None:
        """Give the session readings of a second encoder: stamp [ns], angle [rad]."""
        self._session.take_second(
            np.array([stamp for stamp, *_ in block], np.int64), np.array([angle for _, angle, _ in block])
        )

    def take_torques(self, block: list[tuple[int, float]]) -> None:
        """Hold measured torques against the prediction: stamp [ns], torque [N m]."""
        if block and self._has_torque and not self._wants_residual:
            self.choose_outputs(measured=True)  # now, and not when listeners are looked for next
        if self._wants_residual:
            for stamp, torque in block:
                self._publish_residuals(self._residuals.measured(stamp, torque))

    def retry(self) -> int:
        """Publish messages that the middleware refused before; return the number of those dropped so far."""
        for queue in self._queues.values():
            queue.retry()
        return sum(queue.dropped for queue in self._queues.values())

    def flush(self) -> None:
        """Publish the last samples of an estimator that looks ahead."""
        self._publish(self._session.finish().rows(self._wants_sigma))

    @property
    def report(self) -> SampleReport:
        """Counts of the angle samples, and the state of the estimator."""
        return self._session.report

    def sample_counts(self, report: SampleReport) -> dict[str, float]:
        """Counts of the angle samples."""
        return sample_counts(report, self._session.restarts)

    @staticmethod
    def estimator_status(shaft: str, report: SampleReport) -> Status:
        """State of the estimator."""
        level = state_level(report.state)
        values = {key: value for key, value in report.to_json().items() if not isinstance(value, dict | list)}
        return Status("shaft estimator", level, f"{shaft}: {report.text()}", values)

    def residual_status(self, measured_rms_Nm: float, limit_Nm: float, both_come: bool) -> Status:
        """Residual of the torque; `health.residual_findings` reports one beyond its limit.

        both_come: whether neither angles nor torques are silent.
        """
        residuals = self._residuals
        values: dict[str, object] = {"rms_Nm": residuals.rms_Nm, "given": residuals.given}
        values |= {f"skipped_{cause.replace(' ', '_')}": count for cause, count in residuals.skipped.items()}
        text = f"rms {residuals.rms_Nm:.4g} N m" if residuals.given else "no residual yet"
        status = Status(RESIDUAL_TOPIC, OK if residuals.given else WARN, text, values)
        growth = self._recent_residuals.growth({"given": residuals.given, **residuals.skipped})
        findings = residual_findings(residuals.rms_Nm, measured_rms_Nm, limit_Nm)
        apart_s = residuals.apart_s if both_come else math.nan
        return with_findings(status, [*stalled_findings(growth, apart_s), *findings])

    def _publish(self, samples: Iterable[Sample]) -> None:
        for sample in samples:
            for pack, send in self._calls:
                message = pack(sample)
                if message is not None:
                    send(message)
            if self._wants_residual:
                known = self._residuals.predicted((sample.stamp,), (sample.outputs[TORQUE],), (sample.theta_rad,))
                self._publish_residuals(known)

    def _publish_residuals(self, residuals: list[Residual]) -> None:
        if residuals and self.subscribers[RESIDUAL_TOPIC]:
            for item in residuals:  # with the stamp of the measured sample
                self._queues[RESIDUAL_TOPIC].send(self._residual_message(item.stamp_ns, item.residual_Nm))

    def _publish_events(self) -> None:
        """Publish the contact events; they are taken without a listener too, or they would pile up."""
        events = self._session.take_events()
        if events and self.subscribers[contact_events.TOPIC]:
            self._queues[contact_events.TOPIC].send(contact_events.contact_message(events, self._machine))

    def _warm_up(self) -> None:
        """Run every path once, so that the first sample does not wait for objects made at first use."""
        self._node.get_logger().info(
            "warming up: what is compiled takes up to a minute once on a computer, then a second"
        )
        self._session.use(self._compile(self._needs(self._outputs)))
        if self._has_second:
            self.take_second_angles([(2_000_000, 0.03, math.nan), (6_000_000, 0.09, math.nan)])
        for first, count in ((0, 1), (1, 1), (2, 1), (3, 20)):
            number = np.arange(first, first + count)
            samples = self._session.step(number * 2_000_000, number * 0.03)
        last = (*samples.rows(sigma=True), *self._session.step_one(50_000_000, 0.75))
        for output in self._outputs:
            for sample in last:
                output.pack(sample)
        self._session.reset()
        self._session.use(self._idle)
