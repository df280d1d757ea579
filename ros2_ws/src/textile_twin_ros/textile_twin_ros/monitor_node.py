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

"""Watches a running machine for faults: learns its torque over the first turns, then raises alarms on /diagnostics."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from textile_twin_core.comparison.fault_watch import SERIES, WatchSettings
from textile_twin_core.comparison.monitor import Monitor, Trend
from textile_twin_core.comparison.process_force import COLUMNS, ProcessForce
from textile_twin_core.errors import SceneError, TwinError
from textile_twin_core.files import machine_document
from textile_twin_core.twin.restart import RestartWatch
from textile_twin_ros.diagnostics import ERROR, OK, WARN, DiagnosticsPublisher, Status
from textile_twin_ros.endpoints import depth_for, samples_qos
from textile_twin_ros.health import Finding, TurnWatch, sample_counts, with_findings
from textile_twin_ros.inputs import AngleInput, Sample, TorqueInput
from textile_twin_ros.machine import load_linkage
from textile_twin_ros.machine_namespace import FORCE_PEAK, WORK
from textile_twin_ros.messages import SECOND_NS
from textile_twin_ros.monitor_records import FaultLog, TrendFolder
from textile_twin_ros.node_runner import EXECUTORS, call_every, run
from textile_twin_ros.outputs import PublishQueue
from textile_twin_ros.parameters import declare, parameter
from textile_twin_ros.sensor_parameters import SensorParameters

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


_LOOK_S = 1.0
_RENEW_S = 0.05
_WRITE_S = 3600.0
"""A power loss takes the trend of so long at most."""
_MOST_WRITES = 24
"""While its folder cannot be written, the trend of a day is held."""


@dataclass
class MonitorParameters(SensorParameters):
    """Parameters of monitor_node."""

    shaft: str = parameter("lag", "estimator of the shaft's state", choices=("causal", "lag"))
    learn_turns: int = parameter(100, "turns from which the machine's own band is learnt", between=(20, 100_000))
    raise_sigmas: float = parameter(8.0, "an alarm is raised this far outside the band", between=(3.0, 1000.0))
    clear_sigmas: float = parameter(4.0, "and cleared within this", between=(1.0, 1000.0))
    parquet: str = parameter("", "folder for the trend of every turn, a file for each hour; empty writes none")
    book: str = parameter("", "folder of the fault book: alarms and what was learnt outlive this process; empty: none")
    executor: str = parameter("events", "how callbacks are run", choices=EXECUTORS)


class MonitorNode(Node):
    """Hands angles and torque to a Monitor once a second, and reports its findings."""

    def __init__(self) -> None:
        super().__init__("monitor_node")
        self.settings = settings = declare(self, MonitorParameters)
        self.executor_name = settings.executor
        self.finished = Future()
        if settings.clear_sigmas > settings.raise_sigmas:
            raise SceneError("parameter 'clear_sigmas' is larger than 'raise_sigmas': an alarm would go as it comes")
        self._machine = load_linkage(settings.machine, settings.encoder())
        self._trends = TrendFolder(settings.parquet, _MOST_WRITES) if settings.parquet else None
        self._restarts = RestartWatch()
        self._process: ProcessTopics | None = None
        self._book = FaultLog(settings.book, self.get_namespace(), settings.machine) if settings.book else None
        self._begin()
        if self._monitor.process is not None:
            self._process = ProcessTopics(self, self._monitor.process)
        if self._book is not None and self._book.resume(self._monitor.watch, self._fingerprint):
            self.get_logger().info(
                f"continues with the band learnt before, and {len(self._monitor.watch.standing)} alarms"
            )
        depth = depth_for(settings.rate_hz)
        self._angles: list[Sample] = []
        self._torques: list[Sample] = []
        self._angle = AngleInput(self, settings, self._machine, depth, self._take_angles)
        self._torque = TorqueInput(self, settings, depth, self._torques.extend)
        self.create_service(Trigger, "~/learn_again", self._learn_again)
        call_every(self, _RENEW_S, self._renew)
        call_every(self, _LOOK_S, self._look)
        call_every(self, _WRITE_S, self._write_meanwhile)
        self._diagnostics = DiagnosticsPublisher(self, lambda: settings.machine, self._statuses)

    def close(self) -> None:
        """Watch the turns that are left, and write the trend.

        Raises:
            TwinError: it cannot be written.
        """
        self._look()
        self._write()

    def _begin(self) -> None:
        s = self.settings
        watch = WatchSettings(s.learn_turns, raise_sigmas=s.raise_sigmas, clear_sigmas=s.clear_sigmas)
        self._monitor = Monitor(self._machine, watch, s.shaft)
        self._fingerprint = repr((machine_document(self._machine), watch, s.shaft, SERIES))
        self._turns = TurnWatch()
        self._notes: tuple[str, ...] = ()

    def _learn_again(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Forget the band, as after a repair."""
        self._begin()
        response.success = True
        response.message = f"learning from the next {self.settings.learn_turns} turns"
        if self._book is not None:
            self._book.forget(self._monitor.watch)
        return response

    def _renew(self) -> None:
        self._angle.renew()
        self._torque.renew()
        if self._process is not None:
            self._process.retry()

    def _take_angles(self, block: list[Sample]) -> None:
        for sample in block:
            if self._restarts.restarted(sample[0]):
                self.get_logger().warning(
                    "the stamps of the shaft angle went back and go on from there: the watch restarts"
                )
                self._look()
                self._monitor.restart()
                self._turns = TurnWatch()
            self._angles.append(sample)

    def _look(self) -> None:
        angles, torques = _columns(self._angles), _columns(self._torques)
        self._angles.clear()
        self._torques.clear()
        if angles is not None:
            speeds = angles[2] if np.isfinite(angles[2]).any() else None
            self._monitor.add_angles(angles[0], angles[1], speeds)
        if torques is not None:
            self._monitor.add_torques(torques[0], torques[1])
        trend = self._monitor.advance()
        watched = len(trend.columns.get("turn", ())) > 0
        self._turns.look(self._monitor.newest, watched, torques and torques[:2])
        if watched:
            self._notes = trend.notes
        if watched and self._trends is not None:
            self._trends.take(trend)
        if watched and self._process is not None:
            self._process.take(trend)
        for alarm in trend.alarms:
            self.get_logger().warning(f"turn {alarm.turn}: {alarm.text}")
        if self._book is not None and (watched or self._book.trouble):
            self._book.enter(self._monitor.watch, trend.alarms, self._fingerprint)

    def _statuses(self) -> list[Status]:
        counts = sample_counts(self._monitor.report, self._restarts.count)
        inputs = [*self._angle.statuses(counts), self._torque.status()]
        notes = [Finding("torques at an end of their range", WARN, note) for note in self._notes]
        if self._book is not None and self._book.trouble:
            notes.append(Finding("fault book", ERROR, self._book.trouble))
        process = [] if self._process is None else [self._process.status()]
        return [*inputs, with_findings(self._faults(), [*self._turns.findings(), *notes]), *process]

    def _faults(self) -> Status:
        """Standing faults of the machine."""
        watch = self._monitor.watch
        if not watch.learnt:
            text = f"learning: {watch.turns_learnt} of {self.settings.learn_turns} turns"
            return Status("faults", OK, text, {"turns": self._monitor.turns})
        values: dict[str, object] = {f"{name}_sigmas": float(v) for name, v in zip(SERIES, watch.latest, strict=True)}
        values["turns"] = self._monitor.turns
        if not watch.standing:
            return Status("faults", OK, "as learnt", values)
        level = WARN if all(alarm.side == "sensor" for alarm in watch.standing) else ERROR
        return Status("faults", level, "; ".join(alarm.text for alarm in watch.standing), values)

    def _write_meanwhile(self) -> None:
        """Write the trend while the machine runs; a failed write is tried again with the next."""
        try:
            self._write()
        except TwinError as error:
            self.get_logger().warning(str(error))

    def _write(self) -> None:
        if self._trends is not None:
            self._trends.write()


def _columns(samples: list[Sample]) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Stamps [ns], values and rates of samples in order of time; None without any."""
    if not samples:
        return None
    stamps = np.array([sample[0] for sample in samples], dtype=np.int64)
    order = np.argsort(stamps, kind="stable")
    rows = np.array([sample[1:] for sample in samples], dtype=np.float64)[order]
    return stamps[order], rows[:, 0], rows[:, 1]


def main(arguments: list[str] | None = None) -> int:
    """Run monitor_node."""
    return run("monitor_node", MonitorNode, MonitorParameters, arguments)
