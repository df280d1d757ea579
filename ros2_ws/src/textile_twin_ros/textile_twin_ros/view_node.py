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

"""Shows a running machine: serves what the nodes publish to rerun viewers, which may come and go, and to a file."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.task import Future
from sensor_msgs.msg import JointState

from textile_twin_core.errors import TwinError
from textile_twin_core.machine import ContactMachine
from textile_twin_ros.contact_events import TOPIC as CONTACT_EVENTS
from textile_twin_ros.diagnostics import ERROR, OK, WARN, DiagnosticsPublisher, Status
from textile_twin_ros.endpoints import depth_for, samples_qos
from textile_twin_ros.inputs import Sample, SampleInput
from textile_twin_ros.machine import load_linkage, load_machine
from textile_twin_ros.messages import Kind
from textile_twin_ros.node_runner import EXECUTORS, call_every, run
from textile_twin_ros.parameters import declare, parameter
from textile_twin_ros.view_feeds import ElementFeed, Feed, LinkageFeed

_HAND_OVER_S = 0.05


@dataclass
class ViewParameters:
    """Parameters of view_node."""

    machine: str = parameter("tufting", "machine name, or path of a machine file: the same as the twin's")
    host: str = parameter("127.0.0.1", "address to serve viewers on; 0.0.0.0 lets other computers look, too")
    port: int = parameter(
        9876, "port to serve viewers on, or the next one that is free; 0 serves none", between=(0, 65535)
    )
    file: str = parameter("", "also write an .rrd file")
    memory_limit: str = parameter("64MB", "how much is kept for viewers that come later")
    limit_Nm: float = parameter(0.0, "residual that is marked, in N m; 0 marks none", between=(0.0, 1e9))
    frames_hz: float = parameter(60.0, "pictures of the linkage a second at most", between=(0.1, 1000.0))
    rate_hz: float = parameter(1000.0, "samples a second at most: queues hold five seconds of them", between=(1.0, 1e5))
    qos_reliability: str = parameter(
        "auto", "of the inputs; auto goes by the publishers", choices=("auto", "reliable", "best_effort")
    )
    no_data_timeout_s: float = parameter(
        2.0, "report an input that is silent for longer than this", between=(0.1, 1e6), live=True
    )
    executor: str = parameter("events", "how callbacks are run", choices=EXECUTORS)


class ViewNode(Node):
    """Collects samples of the twin's topics and hands them in blocks to a live view, which draws in its own thread."""

    def __init__(self) -> None:
        super().__init__("view_node")
        # Optional packages are imported where they are used, so that a missing one gives one line; and after the
        # node, which finds the others meanwhile.
        from textile_twin_core.views import LiveElements, LiveRecording, LiveView

        self.settings = settings = declare(self, ViewParameters)
        self.executor_name = settings.executor
        self.finished = Future()
        machine = load_machine(settings.machine)
        place: dict[str, Any] = {
            "host": settings.host,
            "port": settings.port or None,
            "path": settings.file or None,
            "memory_limit": settings.memory_limit,
            "frames_hz": settings.frames_hz,
        }
        self._view: LiveRecording
        self._feed: Feed
        if isinstance(machine, ContactMachine):
            elements = self._view = LiveElements(machine, **place)
            feed = self._feed = ElementFeed(elements, machine.elements, self._listen)
            depth = depth_for(settings.rate_hz)
            self.create_subscription(DiagnosticArray, CONTACT_EVENTS, feed.hear, samples_qos(depth))
        else:
            linkage = load_linkage(settings.machine)
            view = self._view = LiveView(linkage, limit_Nm=settings.limit_Nm or None, **place)
            stations = () if linkage.shaft is None else linkage.shaft.names
            turning = LinkageFeed(view, self._listen, stations, settings.frames_hz)
            self._feed = turning
            if stations:
                qos = samples_qos(depth_for(settings.rate_hz))
                self.create_subscription(JointState, "joint_states", turning.hear_stations, qos, raw=True)
        self._monitor = f"{self.get_namespace()}/monitor_node: faults".lstrip("/")
        self._alarm = ""
        self.create_subscription(DiagnosticArray, "/diagnostics", self._hear, QoSProfile(depth=10))
        call_every(self, _HAND_OVER_S, self._hand_over)
        self._diagnostics = DiagnosticsPublisher(self, lambda: settings.machine, self._statuses)
        beside = Path(sys.executable).with_name("rerun")
        shown = [f"{beside if beside.exists() else 'rerun'} {self._view.url}"] if self._view.url else []
        self.get_logger().info(f"look at it with: {' or '.join(shown + ([settings.file] if settings.file else []))}")

    def close(self) -> None:
        """Draw the remaining samples and complete the file.

        Raises:
            RecordingError: the file is not complete, and this was not reported before.
        """
        self._feed_view()
        self._view.close()
        if self._view.error is not None and not self.finished.done():
            raise self._view.error

    def _listen(self, topic: str, kind: Kind, joint: str, take: Callable[[list[Sample]], None]) -> SampleInput:
        settings = self.settings
        depth = depth_for(settings.rate_hz)
        return SampleInput(
            self, topic, kind, joint, depth, settings.qos_reliability, lambda: settings.no_data_timeout_s, take
        )

    def _hear(self, message: DiagnosticArray) -> None:
        """Show the alarms of this machine's monitor, each once."""
        for status in message.status:
            if status.name != self._monitor:
                continue
            alarm = "" if status.level == OK else status.message
            if alarm and alarm != self._alarm:
                self._view.say("ERROR" if status.level == ERROR else "WARN", alarm)
            elif self._alarm and not alarm:
                self._view.say("INFO", "as learnt again")
            self._alarm = alarm

    def _feed_view(self) -> None:
        for source in self._feed.inputs:
            source.renew()
        self._feed.hand_over()

    def _hand_over(self) -> None:
        self._feed_view()
        error = self._view.error
        if error is None or self.finished.done():
            return
        if isinstance(error, TwinError):
            self.finished.set_exception(error)
        else:
            self.get_logger().error(f"the view has ended: {error}")
            self.finished.set_result(1)

    def _statuses(self) -> list[Status]:
        inputs = [source.status() for source in self._feed.expected()]
        if self._view.error is not None:
            return [*inputs, Status("view", ERROR, str(self._view.error))]
        dropped = self._view.dropped
        text = f"serving {self._view.url or 'no viewer'}"
        return [*inputs, Status("view", WARN if dropped else OK, text, {"samples_not_drawn": dropped})]


def main(arguments: list[str] | None = None) -> int:
    """Run view_node."""
    return run("view_node", ViewNode, ViewParameters, arguments)
