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

"""Subscriptions of a recorder: the wanted topics, each from when its type is known."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

from textile_twin_core.errors import RecordingError, SceneError
from textile_twin_core.recordings.schemas import message_schema
from textile_twin_ros.endpoints import (
    describe_publishers,
    offered_qos,
    received_ns,
    recording_qos,
    take_next,
    topic_name,
)
from textile_twin_ros.machine_namespace import MachineNamespace
from textile_twin_ros.messages import message_class

if TYPE_CHECKING:
    from textile_twin_core.recordings import BagWriter

#: Stamps of a message by the middleware [ns], by name.
MessageInfo: TypeAlias = dict[str, Any]
# Topics between nodes, not of a machine.
_OWN_BUSINESS = ("/rosout", "/parameter_events")
_DIAGNOSTICS = "/diagnostics"
_GATHER_S = 0.005


class Received(NamedTuple):
    """A message as bytes: when it came in here, and when its publisher sent it [ns]."""

    raw: bytes
    received_ns: int
    sent_ns: int


class Recorder(Node):
    """A node with the name of its executor."""

    executor_name: str


class TopicSubscriptions:
    """Subscriptions to the bytes of topics; none wanted by name means all of this namespace's machine.

    Args:
        node: the recorder.
        wanted: names of topics.
        types: types known beforehand, as topic=package/msg/Type.
        depth: messages that may wait.
        take: called with a topic and a message of it, with its stamps.

    Raises:
        SceneError: a type that is not written so or not installed, a name that no topic has.
    """

    def __init__(
        self,
        node: Recorder,
        wanted: tuple[str, ...],
        types: tuple[str, ...],
        depth: int,
        take: Callable[[str, Received], None],
    ) -> None:
        self._node, self._depth, self._take = node, depth, take
        self._types = dict(self._parsed(text) for text in types)
        self.wanted = {topic_name(node, topic, "topics") for topic in wanted}
        self._open: dict[str, Subscription] = {}
        self._last: dict[str, Received] = {}
        """The last message of each topic."""
        self._refused: set[str] = set()
        self._other_types: defaultdict[str, set[str]] = defaultdict(set)
        self._unheard: dict[str, str] = {}
        """Topics with a publisher that is not heard, and by which policy."""
        self._own = MachineNamespace(node.get_namespace())
        self._writer: BagWriter | None = None
        self._is_draining = False
        for topic in self.wanted & set(self._types):
            self._subscribe(topic, self._types[topic])

    @property
    def topics(self) -> list[str]:
        """Names of the topics that are heard, in their order."""
        return sorted(self._open)

    def write_to(self, writer: BagWriter | None) -> None:
        """Declare the topics in a recording that begins, and all that are still to come; None: in none."""
        self._writer = writer
        for topic, subscription in self._open.items():
            self._declare(topic, subscription)

    def latched(self) -> list[tuple[str, Received]]:
        """Topics that keep their last message for late subscribers, each with it where there was one.

        They come in now, into a recording that begins.
        """
        now_ns = time.time_ns()
        latched = ((topic, last) for topic, last in self._last.items() if self._is_latched(topic))
        return [(topic, last._replace(received_ns=now_ns)) for topic, last in latched]

    def discover(self) -> None:
        """Subscribe to wanted topics whose type is known by now, and again where a publisher is not heard."""
        self._renew()
        if self.wanted and self.wanted <= self._open.keys():
            return
        there = self._node.get_topic_names_and_types()
        self._own.learn(topic for topic, _ in there)
        for topic, types in there:
            if topic in self._open:
                self._tell_of_other_types(topic, types)
            if topic in self._open or topic in self._refused:
                continue
            wanted = topic in self.wanted if self.wanted else topic not in _OWN_BUSINESS and self._own.has(topic)
            if wanted and self._node.count_publishers(topic):
                self._subscribe(topic, types[0])

    def waiting(self) -> Iterator[tuple[str, Received]]:
        """Messages that have come and are not taken yet, topic by topic, each with its topic."""
        for topic, subscription in self._open.items():
            for message in _waiting(subscription, message_class(self._types[topic])):
                self._last[topic] = message
                yield topic, message

    def is_anothers(self, topic: str, raw: bytes) -> bool:
        """Return whether a message of the diagnostics, which all machines share, is of another machine's node."""
        if self.wanted or topic != _DIAGNOSTICS:
            return False
        array = deserialize_message(raw, DiagnosticArray)
        return not all(self._own.speaks_of(status.name) for status in array.status)

    def describe(self, topics: set[str]) -> str:
        """Publishers of topics."""
        return "; ".join(
            f"{topic}: {describe_publishers(self._node, topic, self._types.get(topic, ''))}" for topic in sorted(topics)
        )

    def _parsed(self, text: str) -> tuple[str, str]:
        topic, _, msgtype = text.partition("=")
        if not topic or not msgtype:
            raise SceneError(f"parameter 'types': '{text}' is not written as topic=package/msg/Type")
        try:
            message_class(msgtype)
        except LookupError as error:
            raise SceneError(f"parameter 'types': {error}; it is written as topic=package/msg/Type") from error
        return topic_name(self._node, topic, "types"), msgtype

    def _subscribe(self, topic: str, msgtype: str) -> None:
        try:
            message_type = message_class(msgtype)
            message_schema(msgtype)  # one topic whose definition is not found must not end the recording of the others
        except (LookupError, RecordingError) as error:
            self._refused.add(topic)
            self._node.get_logger().error(f"{topic} is not recorded: {error}")
            return
        qos: QoSProfile = recording_qos(self._node.get_publishers_info_by_topic(topic), self._depth)
        self._types[topic] = msgtype
        # The events executor of rclpy fails on a callback that asks for a message's stamps.
        hear = partial(self._hear if self._node.executor_name == "single" else self._hear_alone, topic)
        events = partial(self._on_incompatible, topic)
        self._open[topic] = self._node.create_subscription(
            message_type,
            topic,
            hear,
            qos,
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=events),
            raw=True,
        )
        self._declare(topic, self._open[topic])

    def _hear(self, topic: str, raw: bytes, info: MessageInfo) -> None:
        """Take a message and all that wait, of every topic: waking costs more than taking a dozen."""
        self._keep(topic, _received(raw, info))
        if not self._is_draining:
            self._is_draining = True
            time.sleep(_GATHER_S)
            for other, message in self.waiting():
                self._take(other, message)
            self._is_draining = False

    def _hear_alone(self, topic: str, raw: bytes) -> None:
        now_ns = time.time_ns()
        self._keep(topic, Received(raw, now_ns, now_ns))

    def _keep(self, topic: str, message: Received) -> None:
        self._last[topic] = message
        self._take(topic, message)

    def _is_latched(self, topic: str) -> bool:
        # A subscription to a type known beforehand, made before its publishers came, does not know.
        now = recording_qos(self._node.get_publishers_info_by_topic(topic), self._depth)
        known = self._open[topic].qos_profile
        return DurabilityPolicy.TRANSIENT_LOCAL in (known.durability, now.durability)

    def _tell_of_other_types(self, topic: str, types: list[str]) -> None:
        """A topic of a recording has one type: messages of another one are not in it."""
        for other in set(types) - {self._types[topic], *self._other_types[topic]}:
            self._other_types[topic].add(other)
            self._node.get_logger().warning(
                f"{topic} now carries {other}, too, which is not recorded: it is recorded as {self._types[topic]};"
                " start another recording for it"
            )

    def _on_incompatible(self, topic: str, event: QoSRequestedIncompatibleQoSInfo) -> None:
        self._unheard[topic] = QoSPolicyKind(int(event.last_policy_kind)).name.lower()

    def _renew(self) -> None:
        """Subscribe again so that every publisher can be heard; not from within the subscription's own events."""
        for topic, policy in self._unheard.items():
            seen = describe_publishers(self._node, topic, self._types[topic])
            self._node.get_logger().info(f"{topic}: subscribing again, for its publishers' {policy}: {seen}")
            before = self._open.pop(topic)
            for message in _waiting(before, message_class(self._types[topic])):
                self._keep(topic, message)
            self._node.destroy_subscription(before)
            self._subscribe(topic, self._types[topic])
        self._unheard.clear()

    def _declare(self, topic: str, subscription: Subscription) -> None:
        if self._writer is not None:
            self._writer.add_topic(topic, self._types[topic], offered_qos(subscription.qos_profile))


def _received(raw: bytes, info: MessageInfo) -> Received:
    """Add the stamps of the middleware; one that gives no time of sending leaves that of reception."""
    came_ns = received_ns(info)
    return Received(raw, came_ns, info["source_timestamp"] or came_ns)


def _waiting(subscription: Subscription, message_type: type) -> Iterator[Received]:
    """The messages that a subscription still holds."""
    while (taken := take_next(subscription, message_type)) is not None:
        yield _received(*taken)
