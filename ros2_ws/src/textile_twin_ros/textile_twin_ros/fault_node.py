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

"""Keeps the fault book: a recording of its own for every alarm, services to list and to acknowledge."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from diagnostic_msgs.srv import SelfTest
from rclpy.task import Future
from std_srvs.srv import Trigger

from textile_twin_core.errors import SceneError, TwinError
from textile_twin_core.recordings.fault_book import Fault, FaultBook
from textile_twin_core.recordings.rolling_recording import RollingRecording
from textile_twin_ros.diagnostics import ERROR, OK, WARN, DiagnosticsPublisher, Status
from textile_twin_ros.endpoints import depth_for
from textile_twin_ros.node_runner import EXECUTORS, call_every, run
from textile_twin_ros.parameters import declare, parameter
from textile_twin_ros.topic_subscriptions import Received, Recorder, TopicSubscriptions

_DISCOVER_S = 0.1
_LOOK_S = 0.5
_RETRY_S = 5.0
_MARGIN_S = 1.0
"""Messages reach the disk within a second."""
_DRAIN_S = 2.0


@dataclass
class FaultParameters:
    """Parameters of fault_node."""

    book: str = parameter("", "folder of the fault book and its recordings: the same as the monitor's")
    before_s: float = parameter(10.0, "seconds of all topics before an alarm in its recording", between=(0.0, 600.0))
    after_s: float = parameter(10.0, "seconds of all topics after it", between=(0.0, 600.0))
    topics: tuple[str, ...] = parameter(
        (), "topics to record; none given means all of this namespace's machine, later ones too"
    )
    types: tuple[str, ...] = parameter(
        (), "message types known beforehand, as main_shaft/angle=sensor_msgs/msg/JointState; others are discovered"
    )
    rate_hz: float = parameter(
        1000.0, "messages a second of the fastest topic: queues hold five seconds", between=(1.0, 1e5)
    )
    executor: str = parameter("single", "how callbacks are run; events records no times of sending", choices=EXECUTORS)


class FaultNode(Recorder):
    """Records all topics into files that roll, and cuts a recording out of them for every fault in the book."""

    def __init__(self) -> None:
        super().__init__("fault_node")
        self.settings = settings = declare(self, FaultParameters)
        self.executor_name = settings.executor
        self.finished = Future()
        if not settings.book:
            raise SceneError("parameter 'book' is not set: give the folder of the fault book, -p book:=FOLDER")
        self._source = self.get_namespace()
        self._book = FaultBook(settings.book, create=True)
        self._version = -1
        self._faults: list[Fault] = []
        self._rolling: RollingRecording | None = None
        self._troubles: dict[str, str] = {}
        """What does not work at present: the disk, the book, or a recording that is cut."""
        self._retry_s = 0.0
        self._cutter: threading.Thread | None = None
        self._cut: tuple[int, str] | TwinError | OSError | None = None
        self._topics = TopicSubscriptions(
            self, settings.topics, settings.types, depth_for(settings.rate_hz), self._take
        )
        self._begin()
        self.create_service(SelfTest, "~/list", self._on_list)
        self.create_service(Trigger, "~/acknowledge", self._on_acknowledge)
        call_every(self, _DISCOVER_S, self._discover)
        call_every(self, _LOOK_S, self._look)
        self._diagnostics = DiagnosticsPublisher(self, lambda: settings.book, self._statuses)
        self.get_logger().info(f"fault book {self._book.path}")

    def close(self) -> None:
        """Complete the rolling recording; a fault without its recording gets it at the next start.

        Raises:
            TwinError: the disk takes no more.
        """
        if self._cutter is not None:
            self._cutter.join()
        until = time.monotonic() + _DRAIN_S
        for topic, message in self._topics.waiting():
            if self._rolling is None or time.monotonic() > until:
                break
            self._take(topic, message)
        self._topics.write_to(None)
        if self._rolling is not None:
            self._rolling.close()
        self._book.close()

    def _begin(self) -> None:
        """Begin this run's part of the rolling recording."""
        place = self._source.rstrip("/").replace("/", "_")
        with self._disk():
            self._rolling = RollingRecording(self._book.folder / f".rolling{place}")
            self._topics.write_to(self._rolling.writer)
            self._troubles.pop("disk", None)
            for topic, message in self._topics.latched():  # published once, perhaps before
                self._take(topic, message)

    @contextmanager
    def _disk(self) -> Iterator[None]:
        """Continue without a recording while the disk is full, and try again later."""
        try:
            yield
        except (OSError, TwinError) as error:
            self._topics.write_to(None)
            if self._rolling is not None:
                self._rolling.abandon()
            self._rolling, self._retry_s = None, time.monotonic() + _RETRY_S
            self._troubles["disk"] = f"{_why(error)}: nothing is recorded; make room"

    def _discover(self) -> None:
        with self._disk():
            self._topics.discover()

    def _take(self, topic: str, message: Received) -> None:
        if self._rolling is not None and not self._topics.is_anothers(topic, message.raw):
            with self._disk():
                self._rolling.writer.write(topic, message.received_ns, message.raw, message.sent_ns)

    def _look(self) -> None:
        """Keep the book, the disk and the recordings in step."""
        if self._rolling is None and time.monotonic() > self._retry_s:
            self._begin()
        try:
            self._enter_recording()
            version = self._book.version()
            if version != self._version:
                self._faults, self._version = self._book.faults(self._source), version
        except TwinError as error:
            self._troubles["book"] = f"{_why(error)}; make room"
            return
        self._troubles.pop("book", None)
        now_ns, settings = time.time_ns(), self.settings
        waiting = [fault for fault in self._faults if fault.recording is None]
        oldest_ns = min((fault.raised_ns for fault in waiting), default=now_ns)
        rolling = self._rolling
        if rolling is None:
            return
        with self._disk():
            rolling.writer.flush()
            if self._cutter is None:
                rolling.drop_before(oldest_ns - round((settings.before_s + _MARGIN_S) * 1e9))
        complete_ns = now_ns - round((settings.after_s + _MARGIN_S) * 1e9)
        ready = next((fault for fault in waiting if fault.raised_ns <= complete_ns), None)
        if ready is not None and self._cutter is None and time.monotonic() > self._retry_s:
            latched = self._topics.latched()
            self._cutter = threading.Thread(target=self._cut_out, args=(rolling, ready, latched), name="cutter")
            self._cutter.start()

    def _cut_out(self, rolling: RollingRecording, fault: Fault, latched: list[tuple[str, Received]]) -> None:
        """Make a fault's own recording, beside the callbacks."""
        path = self._book.folder / f"fault_{fault.number}"
        before_ns, after_ns = (round(each * 1e9) for each in (self.settings.before_s, self.settings.after_s))
        custom = {"fault": str(fault.number), "machine": fault.machine, "kind": fault.kind, "text": fault.text}
        try:
            # A process that was killed after the recording took its name did not come to enter it.
            first = [(topic, last.raw) for topic, last in latched]
            made = path.exists() or rolling.cut(
                fault.raised_ns - before_ns, fault.raised_ns + after_ns, path, first, custom
            )
            self._cut = fault.number, path.name if made else ""
        except (OSError, TwinError) as error:
            self._cut = error

    def _enter_recording(self) -> None:
        """Enter the recording that the cutter has made.

        Raises:
            TwinError: the book cannot be written; it is tried again.
        """
        if self._cutter is None or self._cutter.is_alive():
            return
        if isinstance(self._cut, tuple):
            self._book.set_recording(*self._cut)
            self._troubles.pop("recording", None)
        elif self._cut is not None:
            self._troubles["recording"] = f"{_why(self._cut)}; make room"
            self._retry_s = time.monotonic() + _RETRY_S
        self._cutter = self._cut = None

    def _statuses(self) -> list[Status]:
        fresh = [fault for fault in self._faults if fault.acknowledged_ns is None]
        values: dict[str, object] = {
            "faults": len(self._faults),
            "standing": sum(fault.cleared_ns is None for fault in self._faults),
            "not_acknowledged": len(fresh),
            "recordings_to_come": sum(fault.recording is None for fault in self._faults),
        }
        if self._troubles:
            return [Status("fault book", ERROR, "; ".join(self._troubles.values()), values, dict(self._troubles))]
        if fresh:
            text = f"{len(fresh)} not acknowledged, the latest {fresh[-1].number}: {fresh[-1].text}"
            return [Status("fault book", WARN, text, values)]
        return [Status("fault book", OK, f"{len(self._faults)} faults, all acknowledged", values)]

    def _on_list(self, _request: SelfTest.Request, response: SelfTest.Response) -> SelfTest.Response:
        """All faults, the oldest first: a status each."""
        response.id = self.settings.book
        try:
            faults = self._book.faults(self._source)
        except TwinError as error:
            response.passed = ERROR
            response.status = [DiagnosticStatus(level=ERROR, name="fault book", message=str(error))]
            return response
        response.passed, response.status = OK, [_status(fault) for fault in faults]
        return response

    def _on_acknowledge(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Acknowledge all."""
        try:
            numbers = self._book.acknowledge(by="service", source=self._source)
        except TwinError as error:
            response.success, response.message = False, str(error)
            return response
        response.success = True
        response.message = f"acknowledged: {', '.join(map(str, numbers)) or 'all were before'}"
        return response


def _why(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return str(error)


def _status(fault: Fault) -> DiagnosticStatus:
    """A fault as a message: its level by the open actions, its columns as values."""
    level = OK if fault.is_over else WARN if fault.cleared_ns is not None or fault.side == "sensor" else ERROR
    columns = {name: value for name, value in asdict(fault).items() if value is not None}
    return DiagnosticStatus(
        level=level,
        name=f"fault {fault.number}",
        message=fault.text,
        hardware_id=fault.machine,
        values=[KeyValue(key=name, value=str(value)) for name, value in columns.items()],
    )


def main(arguments: list[str] | None = None) -> int:
    """Run fault_node."""
    return run("fault_node", FaultNode, FaultParameters, arguments)
