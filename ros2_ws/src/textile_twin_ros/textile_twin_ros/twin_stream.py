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

"""Twin between its topics: one session, the publishers, and the outputs that listeners need."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from functools import partial

import numpy as np
from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo
from rclpy.lifecycle import LifecycleNode, LifecyclePublisher
from rclpy.qos_overriding_options import QoSOverridingOptions

from textile_twin_core.comparison.residual import Residual, ResidualStream, load_steps
from textile_twin_core.machine import AnyMachine
from textile_twin_core.shaft import SampleReport
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
from textile_twin_ros.messages import message_class
from textile_twin_ros.publishing import Publish, PublishQueue
from textile_twin_ros.twin_outputs import (
    RESIDUAL_TOPIC,
    SIGMA_TOPIC,
    TORQUE,
    Output,
    ResidualMessages,
    outputs_of,
    topics_of,
    twins_of,
)

_REPEAT_S = 10.0
"""Shortest time between reports on stamps that step to and fro [s]."""


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
        self._residual_messages = ResidualMessages()
        self._session = self._idle.session(shaft, **settings)
        # One by one then costs less than a block, and gives the first of a block that came late sooner.
        self._at_once = self._session.at_once and not self._has_history
        self._wanted: list[Output] = []
        self._wants_residual = self._wants_sigma = False
        self._calls: list[tuple[Callable[[Sample], bytes | None], Publish]] = []
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
        self._calls = [(output.message, self._queues[output.topic].send) for output in wanted]
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
            for message_of, send in self._calls:
                message = message_of(sample)
                if message is not None:
                    send(message)
            if self._wants_residual:
                known = self._residuals.predicted((sample.stamp,), (sample.outputs[TORQUE],), (sample.theta_rad,))
                self._publish_residuals(known)

    def _publish_residuals(self, residuals: list[Residual]) -> None:
        if residuals and self.subscribers[RESIDUAL_TOPIC]:
            for message in self._residual_messages.messages(residuals):
                self._queues[RESIDUAL_TOPIC].send(message)

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
                output.message(sample)
        self._session.reset()
        self._session.use(self._idle)
