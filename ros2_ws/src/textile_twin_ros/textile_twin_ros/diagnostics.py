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

"""Diagnostics of the nodes: states for /diagnostics, and a watch over silent inputs."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.qos import QoSProfile

from textile_twin_ros.node_runner import call_every

OK, WARN, ERROR, STALE = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE
WINDOW_S = 5.0
"""A level reports what went wrong within this time."""
_LOOK_S = 0.5
_PERIOD_S = 1.0
_REFUSALS_S = 10.0
_SILENCE_S = (10.0, 60.0, 600.0, 3600.0)
"""Lasting silence is reported again after these times [s], then at intervals of the last."""
_REASON = 300
"""Largest number of reported characters of a reason: a message may name very many joints."""
_RATE_S = 1.0


@dataclass(frozen=True)
class Status:
    """One line of the diagnostics: its name, level and message, and the values behind it.

    log: lines for the log by kind: each once when its kind appears, and one when all have gone.
    """

    name: str
    level: bytes
    message: str
    values: Mapping[str, object] = field(default_factory=dict)
    log: Mapping[str, str] = field(default_factory=dict)


class DiagnosticsPublisher:
    """Publisher of /diagnostics: once a second and when a level changes; the log reports each fault once.

    Args:
        node: the node; its full name precedes each status.
        hardware: name of the machine.
        collect: returns the statuses of this moment.
    """

    def __init__(self, node: Node, hardware: Callable[[], str], collect: Callable[[], list[Status]]) -> None:
        self._node, self._hardware, self._collect = node, hardware, collect
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", QoSProfile(depth=10))
        self._reported: dict[str, set[str]] = {}
        self._levels: dict[str, bytes] = {}
        self._published = -math.inf
        call_every(node, _LOOK_S, self._look)

    def _look(self) -> None:
        statuses = self._collect()
        levels = {status.name: status.level for status in statuses}
        now = time.monotonic()
        # Looks do not come to the moment: one that is a little early serves.
        if levels != self._levels or now - self._published > _PERIOD_S - 0.5 * _LOOK_S:
            self._levels, self._published = levels, now
            self._publish(statuses)

    def _publish(self, statuses: list[Status]) -> None:
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        own_name = self._node.get_fully_qualified_name().lstrip("/")
        for status in statuses:
            self._log(status)
            values = [KeyValue(key=key, value=_text(value)) for key, value in status.values.items()]
            message.status.append(
                DiagnosticStatus(
                    level=status.level,
                    name=f"{own_name}: {status.name}",
                    message=status.message,
                    hardware_id=self._hardware(),
                    values=values,
                )
            )
        self._publisher.publish(message)

    def _log(self, status: Status) -> None:
        reported = self._reported.setdefault(status.name, set())
        for kind, text in status.log.items():
            if kind not in reported:
                reported.add(kind)
                self._node.get_logger().warning(f"{status.name}: {text}")
        if reported and status.level == OK:
            reported.clear()
            self._node.get_logger().info(f"{status.name}: recovered")


def _text(value: object) -> str:
    if isinstance(value, float):
        return "none" if math.isnan(value) else f"{value:.6g}"
    return str(value)


class InputWatch:
    """Watches one input topic: its rate and age, and says so when nothing comes, and again ever more seldom.

    Args:
        node: the node that listens.
        topic: the input, as resolved.
        timeout_s: silence that is worth a warning.
        describe: returns who publishes there.
    """

    def __init__(self, node: Node, topic: str, timeout_s: Callable[[], float], describe: Callable[[], str]) -> None:
        self._node, self._topic = node, topic
        self._timeout_s, self._describe = timeout_s, describe
        self.received = 0
        self.refused = 0
        self.refusal = ""
        self.restart()

    def restart(self) -> None:
        """Restart the wait, with all counts at zero."""
        self.received = self.refused = 0
        self.refusal = ""
        self._refusal_reported = -math.inf
        self._since = self._last = time.monotonic()
        self._past = deque([(self._since, 0)])
        self._warnings, self._warned_at = 0, -math.inf

    def took(self, count: int = 1) -> None:
        """Note messages that have come in."""
        self.received += count
        self._last = time.monotonic()

    def refuse(self, reason: str) -> None:
        """Note a message that cannot be used; a reason is logged when it is a new one, every ten seconds at most."""
        self.refused += 1
        reason = reason if len(reason) <= _REASON else f"{reason[:_REASON]} ..."
        now = time.monotonic()
        new, self.refusal = reason != self.refusal, reason
        if new and now - self._refusal_reported >= _REFUSALS_S:
            self._refusal_reported = now
            self._node.get_logger().warning(f"a message on {self._topic} {reason}: such messages are left out")

    @property
    def silent_s(self) -> float:
        """Seconds since the last message, or since the watch began."""
        return time.monotonic() - self._last

    def status(self, name: str, values: Mapping[str, object], refusing: bool = False) -> Status:
        """The input's status of this moment; logs a warning when the input has been silent for long.

        refusing: whether messages were refused lately.
        """
        now = time.monotonic()
        self._past.append((now, self.received))
        while self._past[1][0] <= now - _RATE_S:
            self._past.popleft()
        since, before = self._past[0]
        rate = (self.received - before) / max(now - since, 1e-9)
        shown = {
            "topic": self._topic,
            "rate_hz": rate,
            "age_s": self.silent_s if self.received else math.nan,
            "received": self.received,
            "unreadable": self.refused,
            **values,
        }
        if self.silent_s <= self._timeout_s():
            if self._warnings:
                self._node.get_logger().info(f"data on {self._topic} again")
                self._warnings = 0
            if not self.received:
                return Status(name, WARN, f"waiting for the first message: {self._describe()}", shown)
            return Status(name, OK, f"{rate:.1f} Hz" + (f"; some messages: {self.refusal}" * refusing), shown)
        text = f"no data on {self._topic} for {self.silent_s:.1f} s: {self._describe()}"
        if not self._warnings or now - self._warned_at >= _SILENCE_S[min(self._warnings, len(_SILENCE_S)) - 1]:
            self._warnings, self._warned_at = self._warnings + 1, now
            self._node.get_logger().warning(text)
        return Status(name, STALE if self.received else ERROR, text, shown)
