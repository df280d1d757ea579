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

"""Force of the process, a message a turn: peak force with its depth, and work in and out."""

from __future__ import annotations

import math

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState

from textile_twin_core.comparison.monitor import Trend
from textile_twin_core.comparison.process_force import COLUMNS, ProcessForce
from textile_twin_ros.diagnostics import OK, Status
from textile_twin_ros.endpoints import samples_qos
from textile_twin_ros.machine_namespace import FORCE_PEAK, WORK
from textile_twin_ros.messages import SECOND_NS
from textile_twin_ros.outputs import PublishQueue

_DEPTH = 1000


class ProcessTopics:
    """Publishes the force of the process; std_msgs/Float64 has no stamp, so each message is a JointState.

    `process/force_peak` has the load's name, its depth as position [m] and its force as effort [N]. `process/work` has
    the names `work_in` and `work_out` and their work as effort [J]. The stamp is that of the turn's first torque.

    Args:
        node: publishes.
        force: of the machine.
    """

    def __init__(self, node: Node, force: ProcessForce) -> None:
        self._force = force
        topics = (FORCE_PEAK, WORK)
        qos = samples_qos(_DEPTH)
        self._queues = [PublishQueue(node.create_publisher(JointState, name, qos).publish, _DEPTH) for name in topics]
        self._latest = dict[str, float]()

    def take(self, trend: Trend) -> None:
        """Publish the turns of a trend whose force is determined."""
        columns = [trend.columns[name] for name in COLUMNS]
        rows = np.stack(columns, axis=1) if columns else np.zeros((0, len(COLUMNS)))
        for stamp, row in zip(trend.columns["stamp_ns"], rows.tolist(), strict=True):
            if not all(map(math.isfinite, row)):
                continue
            peak, depth, work_in, work_out = row
            self._queues[0].send(_message(int(stamp), [self._force.place.name], [peak], [depth]))
            self._queues[1].send(_message(int(stamp), ["work_in", "work_out"], [work_in, work_out]))
            self._latest = dict(zip(COLUMNS, row, strict=True))

    def retry(self) -> None:
        """Publish again what the middleware refused."""
        for queue in self._queues:
            queue.retry()

    def status(self) -> Status:
        """Status with the newest turn in words."""
        if not self._latest:
            return Status("process", OK, "no turn with a force yet")
        peak, depth, work_in, work_out = self._latest.values()
        count = self._force.count
        each = f", the mean of {count} linkages" if count > 1 else ""
        text = (
            f"{self._force.place.name}: at most {peak:.0f} N, {1e3 * depth:.1f} mm deep; work {work_in:.2f} J in,"
            f" {work_out:.2f} J out{each}"
        )
        return Status("process", OK, text, self._latest)


def _message(stamp_ns: int, names: list[str], effort: list[float], position: list[float] | None = None) -> JointState:
    message = JointState(name=names, effort=effort, position=position or [])
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, SECOND_NS)
    return message
