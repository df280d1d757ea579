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

"""Plays a recording onto its topics, byte for byte, at its own pace or a multiple of it, and loses nothing."""

from __future__ import annotations

import threading
import time
from collections import Counter
from dataclasses import dataclass

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.task import Future
from rosgraph_msgs.msg import Clock

from textile_twin_core.errors import RecordingError, SceneError
from textile_twin_ros.endpoints import relative_name, replayed_qos, samples_qos
from textile_twin_ros.machine_namespace import published_by_twins
from textile_twin_ros.messages import SECOND_NS, has_header, message_class, shift_stamp, stamp_of
from textile_twin_ros.node_runner import EXECUTORS, finish_with, run
from textile_twin_ros.pacing import Pace, PlaybackClock
from textile_twin_ros.parameters import declare, parameter
from textile_twin_ros.publishing import retry_publish

_LOOK_S = 0.02
_SETTLED_S = 0.5
_WAITED_S = 2.0
_NOT_PLAYED = ("/rosout", "/parameter_events")


@dataclass
class ReplayParameters:
    """Parameters of replay_node."""

    bag: str = parameter("", "folder or .mcap file of the recording")
    rate: float = parameter(1.0, "speed of playing, 1 is that of the recording", between=(1e-3, 1e3), live=True)
    topics: tuple[str, ...] = parameter((), "topics to play; none given means all but what a twin publishes")
    twin_outputs: bool = parameter(
        False, "play what a twin published too, such as balancing_torque/predicted; for views without a running twin"
    )
    longest_pause_s: float = parameter(
        60.0, "a longer pause in the log times is played as one second; 0 plays all", between=(0.0, 1e9)
    )
    wait_for: tuple[str, ...] = parameter(
        (),
        "topics that need subscribers before playing begins, as main_shaft/angle or, for two, main_shaft/angle=2;"
        " none given means one on any topic",
    )
    wait_timeout_s: float = parameter(30.0, "give up without them after this time; 0 does not wait", between=(0.0, 1e6))
    loop: bool = parameter(False, "begin again at the end; the stamps in headers go on")
    clock_rate_hz: float = parameter(0.0, "publish recorded time on /clock this often; 0 is never", between=(0.0, 1e4))
    qos_depth: int = parameter(
        5000, "messages of a topic kept until every subscriber has them", between=(1, 10_000_000)
    )
    acknowledge_timeout_s: float = parameter(
        30.0,
        "longest wait at the end until every subscriber has everything; one that was killed is waited for 20 s,"
        " until the middleware forgets it",
        between=(0.0, 1e6),
    )
    exit_when_done: bool = parameter(True, "end the node after the last message")
    executor: str = parameter("events", "how callbacks are run", choices=EXECUTORS)


class ReplayNode(Node):
    """Publishes the bytes of a recording from a thread of its own, paced by their log times, as they were offered."""

    def __init__(self) -> None:
        # Optional packages are imported where they are used, so that a missing one gives one line.
        from textile_twin_core.recordings import open_bag

        super().__init__("replay_node")
        self.settings = declare(self, ReplayParameters, self._on_change)
        if not self.settings.bag:
            raise RecordingError("parameter 'bag' is not set: give the recording to play, -p bag:=FOLDER")
        self.executor_name = self.settings.executor
        self.finished = Future()
        self._bag = open_bag(self.settings.bag)
        self._topics = self._chosen_topics()
        self._outlets = {topic: self._create_publisher(topic) for topic in self._topics}
        self._senders = {topic: retry_publish(outlet.publish) for topic, outlet in self._outlets.items()}
        self._headed = {topic for topic in self._topics if has_header(message_class(self._bag.topics[topic].msgtype))}
        self._clock_publisher = (
            self.create_publisher(Clock, "/clock", samples_qos(10)) if self.settings.clock_rate_hz else None
        )
        self._needed = dict(self._parse_need(text) for text in self.settings.wait_for)
        self._matched: dict[str, int] = {}
        self._matched_at = 0.0
        self._stop = threading.Event()
        self._pace = Pace(self._stop, self.settings.rate)
        self.played: Counter[str] = Counter()
        self._thread = threading.Thread(target=finish_with, args=(self.finished, self._play), name="replay")
        self._thread.start()

    def close(self) -> None:
        """End the playing thread."""
        self._stop.set()
        self._thread.join()

    def _on_change(self, name: str) -> None:
        if name == "rate":
            self._pace.set_rate(self.settings.rate)

    def _chosen_topics(self) -> list[str]:
        if self.settings.topics:
            topics = [self._bag.find_topic(name).name for name in self.settings.topics]
        else:
            there = {name: info.msgtype for name, info in self._bag.topics.items() if info.count}
            left_out = set() if self.settings.twin_outputs else published_by_twins(there)
            topics = [name for name in there if name not in _NOT_PLAYED and name not in left_out]
            if left_out and topics:
                self.get_logger().info(
                    f"left out, as a twin publishes it: {', '.join(sorted(left_out))}; -p twin_outputs:=true plays it"
                )
        if not topics:
            raise RecordingError(f"{self.settings.bag}: there is no message in it to play")
        return topics

    def _create_publisher(self, topic: str) -> Publisher:
        try:
            message_type = message_class(self._bag.topics[topic].msgtype)
        except LookupError as error:
            others = ", ".join(name for name in self._topics if name != topic)
            raise RecordingError(
                f"{self.settings.bag}: {topic}: {error}; choose with 'topics' among {others}"
            ) from error
        qos = replayed_qos(self._bag.topics[topic].qos, self.settings.qos_depth)
        return self.create_publisher(message_type, relative_name(topic), qos)

    def _parse_need(self, text: str) -> tuple[str, int]:
        name, _, count = text.partition("=")
        topic = self._bag.find_topic(name).name
        if topic not in self._outlets or not (count or "1").isdigit():
            raise SceneError(f"parameter 'wait_for': '{text}' is no played topic with a number of subscribers")
        return topic, int(count or "1")

    def _play(self) -> int:
        if not self._wait_for_subscribers():
            return 0
        self.get_logger().info(f"playing {self.settings.bag}: {', '.join(sorted(self._topics))}")
        began = time.monotonic()
        self._pace.start()
        times = PlaybackClock(round(self.settings.longest_pause_s * SECOND_NS))
        shift_ns = 0
        while self._play_once(times, shift_ns) and self.settings.loop:
            shift_ns += times.repeat()
        complete = self._wait_for_acknowledgement()
        counts = ", ".join(f"{topic} {count}" for topic, count in sorted(self.played.items()))
        self.get_logger().info(f"played {self.played.total()} messages in {time.monotonic() - began:.3f} s: {counts}")
        if not self.settings.exit_when_done:
            self._stop.wait()
        return 0 if complete else 1

    def _play_once(self, times: PlaybackClock, shift_ns: int) -> bool:
        """Play the recording once, stamps moved by so much [ns]; False when stopped in the middle."""
        clock_ns: int | None = None
        for topic, log_ns, raw in self._bag.raw_messages(self._topics):
            played_ns, skipped_ns = times.take(log_ns)
            if skipped_ns:
                self.get_logger().warning(
                    f"the log times step by {skipped_ns / SECOND_NS:.4g} s after {self.played.total()} messages: played"
                    " without this pause (parameter longest_pause_s)"
                )
            if self._clock_publisher is not None:
                if clock_ns is None or skipped_ns:
                    clock_ns = log_ns
                while clock_ns <= log_ns:
                    if not self._pace.wait_until((played_ns - (log_ns - clock_ns)) / SECOND_NS):
                        return False
                    self._publish_clock(clock_ns + shift_ns)
                    clock_ns += round(SECOND_NS / self.settings.clock_rate_hz)
            if not self._pace.wait_until(played_ns / SECOND_NS):
                return False
            if topic in self._headed:
                times.note_stamp(stamp_of(raw))
                raw = shift_stamp(raw, shift_ns) if shift_ns else raw
            self._senders[topic](raw)
            self.played[topic] += 1
        return True

    def _publish_clock(self, now_ns: int) -> None:
        assert self._clock_publisher is not None
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(now_ns, SECOND_NS)
        self._clock_publisher.publish(message)

    def _wait_for_subscribers(self) -> bool:
        """Wait until those are matched who are to hear it all; False when stopped.

        Raises:
            SceneError: they did not come in time.
        """
        deadline = time.monotonic() + self.settings.wait_timeout_s
        while self.settings.wait_timeout_s and not self._subscribers_are_there():
            if time.monotonic() > deadline:
                needed = self._needed or dict.fromkeys(self._topics, 1)
                found = ", ".join(
                    f"{self._outlets[topic].topic_name} has {self._outlets[topic].get_subscription_count()}"
                    + (f" of {count}" if self._needed else "")
                    for topic, count in sorted(needed.items())
                )
                raise SceneError(
                    f"too few subscribers after {self.settings.wait_timeout_s:g} s ({found}): start the nodes that"
                    " are to listen, in the same ROS_DOMAIN_ID, or set wait_timeout_s to 0"
                )
            if self._stop.wait(_LOOK_S):
                return False
        return not self._stop.is_set()

    def _subscribers_are_there(self) -> bool:
        matched = {topic: publisher.get_subscription_count() for topic, publisher in self._outlets.items()}
        if self._needed:
            return all(matched[topic] >= count for topic, count in self._needed.items())
        # Late subscribers are not announced: those who are here have to be the same for a while.
        if matched != self._matched:
            self._matched, self._matched_at = matched, time.monotonic()
        return any(matched.values()) and time.monotonic() - self._matched_at > _SETTLED_S

    def _wait_for_acknowledgement(self) -> bool:
        began = time.monotonic()
        waiting = list(self._outlets.items())
        said = False
        while waiting and not self._stop.is_set():
            waiting = [entry for entry in waiting if not entry[1].wait_for_all_acked(Duration(seconds=0.05))]
            names = ", ".join(topic for topic, _ in waiting)
            waited_s = time.monotonic() - began
            if waiting and waited_s > self.settings.acknowledge_timeout_s:
                self.get_logger().error(
                    f"a subscriber has not acknowledged all messages of {names}: it hangs, or it comes late and needs"
                    " a longer acknowledge_timeout_s"
                )
                return False
            if waiting and waited_s > _WAITED_S and not said:
                said = True
                self.get_logger().info(f"all is sent; waits until subscribers have, or have ended: {names}")
        return True


def main(arguments: list[str] | None = None) -> int:
    """Run replay_node."""
    return run("replay_node", ReplayNode, ReplayParameters, arguments)
