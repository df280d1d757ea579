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

"""Records topics as they come off the wire into a rosbag2 folder that a power loss shortens by a second at most."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rclpy.task import Future
from std_srvs.srv import Trigger

from textile_twin_core.errors import RecordingError, SceneError, TwinError
from textile_twin_core.files import remove
from textile_twin_ros.diagnostics import OK, WARN, WINDOW_S, DiagnosticsPublisher, Status
from textile_twin_ros.endpoints import depth_for, topic_name
from textile_twin_ros.node_runner import EXECUTORS, call_every, run
from textile_twin_ros.parameters import declare, parameter
from textile_twin_ros.recording_path import RecordingPath
from textile_twin_ros.topic_subscriptions import Received, Recorder, TopicSubscriptions

# Goes on for as long as any node lives.
_NEVER_SILENT = ("/diagnostics", "/clock")
_AFTERMATH_S = 1.5


class Progress:
    """Counts the messages of a recording.

    Args:
        enough: numbers of messages of topics with which the recording is complete.
        idle_s: and after so long without a message, once there was one; 0 is never.
    """

    def __init__(self, enough: Mapping[str, int], idle_s: float) -> None:
        self._enough, self._idle_s = enough, idle_s
        self.counts: Counter[str] = Counter()
        self.begin()

    def begin(self) -> None:
        """Another recording."""
        self.counts.clear()
        self.anything = False
        """Whether there was a message of a topic that can fall silent."""
        self._last_s = time.monotonic()

    def take(self, topic: str) -> None:
        """A message has been written."""
        self.counts[topic] += 1
        if topic not in _NEVER_SILENT:
            self._last_s = time.monotonic()
            self.anything = True

    def is_complete(self) -> bool:
        """Return whether the recording has all its messages."""
        quiet_s = time.monotonic() - self._last_s
        if self._ends_by_silence and quiet_s > self._idle_s:
            return True
        # Other topics may still have something to say of the last messages counted.
        enough = all(self.counts[topic] >= count for topic, count in self._enough.items())
        return bool(self._enough) and enough and quiet_s > _AFTERMATH_S

    def is_silent(self, timeout_s: float) -> bool:
        """Return whether the topics are silent for `timeout_s`; where silence ends the recording it is no fault."""
        return time.monotonic() - self._last_s > timeout_s and not self._ends_by_silence

    @property
    def _ends_by_silence(self) -> bool:
        return bool(self._idle_s) and self.anything

    def __str__(self) -> str:
        """Messages by topic, for people."""
        return ", ".join(f"{topic} {count}" for topic, count in sorted(self.counts.items()) if count) or "nothing came"


if TYPE_CHECKING:
    from textile_twin_core.recordings import BagWriter

_LOOK_S = 0.1
_HOUSEKEEPING_S = 0.25
_RETENTION_S = 1.0
LONGEST_DRAIN_S = 2.0
"""Who ends a node by a signal kills it some seconds later."""
_LEAST_STANDSTILL_S = 1.0
"""Every process waits for less now and then, however short its queues are."""


@dataclass
class RecordParameters:
    """Parameters of record_node."""

    bag: str = parameter("", "folder to write; a later recording of the same node gets _2, _3 and so on")
    folder: str = parameter("", "instead of bag: folder in which each recording is named by its date and time")
    topics: tuple[str, ...] = parameter(
        (), "topics to record; none given means all of this namespace's machine, later ones too"
    )
    types: tuple[str, ...] = parameter(
        (), "message types known beforehand, as main_shaft/angle=sensor_msgs/msg/JointState; others are discovered"
    )
    start: bool = parameter(True, "begin to record at once; otherwise at the service ~/start")
    overwrite: bool = parameter(False, "replace a recording of that name")
    rate_hz: float = parameter(
        1000.0, "messages a second of the fastest topic: queues hold some seconds", between=(1.0, 1e5)
    )
    queue_s: float = parameter(5.0, "how many seconds of messages the queues hold", between=(0.01, 1e4))
    split_MB: float = parameter(500.0, "begin a new file of the recording at this size; 0 never", between=(0.0, 1e6))
    split_minutes: float = parameter(60.0, "begin a new file after this time; 0 never", between=(0.0, 1e5))
    keep_GB: float = parameter(
        0.0,
        "remove the oldest files of the recording, with folder the oldest recordings, beyond this; 0 keeps all",
        between=(0.0, 1e6),
    )
    stop_when_idle_s: float = parameter(0.0, "end this long after the last message; 0 is never", between=(0.0, 1e6))
    stop_after: tuple[str, ...] = parameter(
        (), "end when this number of messages of each topic is recorded, as balancing_torque/predicted=22682"
    )
    no_data_timeout_s: float = parameter(
        2.0, "report a topic that is silent for longer than this", between=(0.1, 1e6), live=True
    )
    executor: str = parameter("single", "how callbacks are run; events records no times of sending", choices=EXECUTORS)


class RecordNode(Recorder):
    """Subscribes to bytes and writes them as they are: log time is that of reception, publish time that of sending.

    A recording begins with the last message of each latched topic.
    """

    def __init__(self) -> None:
        super().__init__("record_node")
        self.settings = declare(self, RecordParameters)
        self._place = RecordingPath(self.settings.bag, self.settings.folder, self.get_namespace())
        self.executor_name = self.settings.executor
        self.finished = Future()
        enough = dict(self._parse_count(text) for text in self.settings.stop_after)
        self._progress = Progress(enough, self.settings.stop_when_idle_s)
        self._writer: BagWriter | None = None
        self._retained = time.monotonic()
        self._reported_silent = self._reported_stuck = False
        self._looked = time.monotonic()
        self._stood_still, self._stood_until = "", -math.inf
        depth = depth_for(self.settings.rate_hz, self.settings.queue_s)
        self._topics = TopicSubscriptions(self, self.settings.topics, self.settings.types, depth, self._take)
        if self.settings.start:
            self._open()
        self.create_service(Trigger, "~/start", self._on_start)
        self.create_service(Trigger, "~/stop", self._on_stop)
        call_every(self, _LOOK_S, self._discover)
        call_every(self, _HOUSEKEEPING_S, self._keep_house)
        self._diagnostics = DiagnosticsPublisher(self, lambda: "", self._statuses)
        self._discover()

    def close(self) -> None:
        """Complete the recording and print its contents.

        Raises:
            RecordingError: the disk takes no more, or the file has gone.
        """
        if self._writer is None:
            return
        self._drain(self._writer)
        writer, path, self._writer = self._writer, self._writer.path, None
        self._topics.write_to(None)
        try:
            writer.close()
        except OSError as error:
            self._drop_if_empty(path)
            raise self._cut_short(path, error) from error
        if self._drop_if_empty(path):
            print("nothing came: no recording is kept", flush=True)
            return
        print(f"recorded {self._progress.counts.total()} messages in {path}: {self._progress}", flush=True)

    def _drain(self, writer: BagWriter) -> None:
        """Take the messages that wait at the end, within the time that a service manager allows.

        Raises:
            RecordingError: the disk takes no more, or the file has gone.
        """
        until = time.monotonic() + LONGEST_DRAIN_S
        for topic, message in self._topics.waiting():
            if time.monotonic() > until:
                self.get_logger().warning(
                    f"more messages wait than {LONGEST_DRAIN_S:g} s are enough for: those left are not recorded"
                )
                return
            try:
                self._write(writer, topic, message)
            except OSError as error:
                self._close_writer()
                raise self._cut_short(writer.path, error) from error

    def _drop_if_empty(self, path: Path) -> bool:
        """Remove a recording of this node's own naming in which there is nothing; whether it was one."""
        empty = self._place.by_time and not self._progress.anything
        if empty:
            remove(path)
        return empty

    def _parse_count(self, text: str) -> tuple[str, int]:
        topic, _, count = text.partition("=")
        if not topic or not count.isdigit():
            raise SceneError(f"parameter 'stop_after': '{text}' is not written as topic=number")
        return topic_name(self, topic, "stop_after"), int(count)

    def _open(self) -> None:
        # Optional packages are imported where they are used, so that a missing one gives one line.
        from textile_twin_core.recordings import BagWriter

        path = self._place.take_next()
        settings = self.settings
        writer = self._writer = BagWriter(
            path,
            live=True,
            overwrite=settings.overwrite,
            split_bytes=round(settings.split_MB * 1e6),
            split_s=settings.split_minutes * 60.0,
        )
        self._progress.begin()
        self._topics.write_to(writer)
        self.get_logger().info(f"recording to {path}")
        if settings.keep_GB and (room_GB := self._place.room_bytes(path) * 1e-9) < settings.keep_GB:
            self.get_logger().warning(
                f"keep_GB: {settings.keep_GB:g} are more than the {room_GB:.3g} that the disk of {path} has room for:"
                " the recording ends when it is full; set less"
            )
        for topic, message in self._topics.latched():  # published once, perhaps before this recording
            self._take(topic, message)

    def _discover(self) -> None:
        """Subscribe to new topics and declare them in the recording."""
        try:
            self._topics.discover()
        except OSError as error:
            if self._writer is None:
                raise
            self._end_recording(self._writer.path, error)

    def _take(self, topic: str, message: Received) -> None:
        if self._writer is None:
            return
        try:
            self._write(self._writer, topic, message)
        except OSError as error:
            self._end_recording(self._writer.path, error)

    def _write(self, writer: BagWriter, topic: str, message: Received) -> None:
        if not self._topics.is_anothers(topic, message.raw):
            writer.write(topic, message.received_ns, message.raw, message.sent_ns)
            self._progress.take(topic)

    def _keep_house(self) -> None:
        self._notice_standstill()
        if self._writer is None:
            return
        try:
            self._writer.flush()
        except OSError as error:
            self._end_recording(self._writer.path, error)
            return
        now = time.monotonic()
        if self.settings.keep_GB and now - self._retained > _RETENTION_S:
            self._retained = now
            stuck = self._place.retain(self._writer, round(self.settings.keep_GB * 1e9))
            if stuck and not self._reported_stuck:
                self.get_logger().warning(f"keep_GB: {stuck[0]}, {len(stuck)} such: more is kept than asked for")
            self._reported_stuck = bool(stuck)
        if self._progress.is_complete() and not self.finished.done():
            self.finished.set_result(0)
        silent = self._progress.is_silent(self.settings.no_data_timeout_s)
        if silent and not self._reported_silent:
            self.get_logger().warning(self._silence())
        self._reported_silent = silent

    def _notice_standstill(self) -> None:
        """Say so where this process stood still for longer than queues hold messages."""
        now = time.monotonic()
        still_s, self._looked = now - self._looked, now
        queue_s = max(self.settings.queue_s, _LEAST_STANDSTILL_S)
        if self._writer is None or still_s <= queue_s + _HOUSEKEEPING_S:
            return
        self._stood_until = now
        self._stood_still = (
            f"no processor time for {still_s:.1f} s (or a disk that waits): messages of that time are missing,"
            f" but for what queues of {self.settings.queue_s:g} s held"
        )
        self.get_logger().warning(self._stood_still)

    def _end_recording(self, path: Path, error: OSError) -> None:
        """End the node where the disk is full or the file has gone; written messages stay."""
        self._close_writer()
        if not self.finished.done():
            self.finished.set_exception(self._cut_short(path, error))

    def _close_writer(self) -> None:
        """Leave the recording as it is on the disk; one without a message goes where its name is ours."""
        writer, self._writer = self._writer, None
        self._topics.write_to(None)
        if writer is not None:
            with suppress(TwinError, OSError):
                writer.close()
            self._drop_if_empty(writer.path)

    def _cut_short(self, path: Path, error: OSError) -> RecordingError:
        """Error for a recording that ends so."""
        reason = f"{path}: {error.strerror or error}: the recording ends after {self._progress.counts.total()} messages"
        if self._progress.anything and not isinstance(error, FileNotFoundError):
            reason += "; make room, and keep it with textile-twin recover"
        return RecordingError(reason)

    def _silence(self) -> str:
        wanted = self._topics.wanted
        if not wanted:
            return f"nothing to record for {self.settings.no_data_timeout_s:g} s"
        silent = self._topics.describe({topic for topic in wanted if not self._progress.counts[topic]})
        return f"no data to record for {self.settings.no_data_timeout_s:g} s: {silent or 'all topics fell silent'}"

    def _statuses(self) -> list[Status]:
        values: dict[str, object] = {topic: self._progress.counts[topic] for topic in self._topics.topics}
        if self._writer is None:
            return [Status("recording", OK, "not recording", values)]
        if self._reported_silent:
            return [Status("recording", WARN, self._silence(), values)]
        if time.monotonic() - self._stood_until < WINDOW_S:
            return [Status("recording", WARN, self._stood_still, values)]
        return [Status("recording", OK, f"recording to {self._writer.path}", values)]

    def _on_start(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._writer is not None:
            response.success, response.message = False, f"already recording to {self._writer.path}"
            return response
        try:
            self._open()
            if self._writer is not None:
                self._writer.flush()  # a full disk shows now
        except (TwinError, OSError) as error:
            self._close_writer()
            response.success, response.message = False, str(error)
            return response
        if self._writer is None:
            response.success, response.message = False, "the recording ended at once: its disk is full"
            return response
        response.success, response.message = True, str(self._writer.path)
        return response

    def _on_stop(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._writer is None:
            response.success, response.message = False, "not recording: call ~/start first"
            return response
        path = self._writer.path
        try:
            self.close()
        except RecordingError as error:
            self.get_logger().error(str(error))
            response.success, response.message = False, str(error)
            return response
        response.success, response.message = True, f"{self._progress.counts.total()} messages in {path}"
        return response


def main(arguments: list[str] | None = None) -> int:
    """Run record_node."""
    return run("record_node", RecordNode, RecordParameters, arguments)
