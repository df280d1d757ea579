"""What a recorder listens to: the topics that are wanted, each from when its type is known."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

from textile_twin_core.errors import SceneError
from textile_twin_ros.endpoints import describe_publishers, offered_qos, recording_qos
from textile_twin_ros.messages import message_class
from textile_twin_ros.own_topics import OwnTopics

if TYPE_CHECKING:
    from textile_twin_core.recordings import BagWriter

# What nodes tell each other, not what a machine does.
_OWN_BUSINESS = ("/rosout", "/parameter_events")
_DIAGNOSTICS = "/diagnostics"


class Inlets:
    """Subscriptions to the bytes of topics; none wanted by name means all of this namespace's machine.

    Args:
        node: the recorder.
        wanted: names of topics.
        types: types known beforehand, as topic=package/msg/Type.
        depth: messages that may wait.
        take: called with a topic and a message of it.

    Raises:
        SceneError: a type that is not written so.
    """

    def __init__(
        self,
        node: Node,
        wanted: tuple[str, ...],
        types: tuple[str, ...],
        depth: int,
        take: Callable[[str, bytes], None],
    ) -> None:
        self._node, self._depth, self._take = node, depth, take
        self._types = dict(self._parsed(text) for text in types)
        self.wanted = {node.resolve_topic_name(topic) for topic in wanted}
        self._open: dict[str, Subscription] = {}
        self._refused: set[str] = set()
        self._own = OwnTopics(node.get_namespace())
        self._writer: BagWriter | None = None
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

    def discover(self) -> None:
        """Subscribe to wanted topics whose type is known by now."""
        if self.wanted and self.wanted <= self._open.keys():
            return
        there = self._node.get_topic_names_and_types()
        self._own.learn(topic for topic, _ in there)
        for topic, types in there:
            if topic in self._open or topic in self._refused:
                continue
            wanted = topic in self.wanted if self.wanted else topic not in _OWN_BUSINESS and self._own.has(topic)
            if wanted and self._node.count_publishers(topic):
                self._subscribe(topic, types[0])

    def is_anothers(self, topic: str, raw: bytes) -> bool:
        """Whether a message of the diagnostics, which all machines share, is of another machine's node."""
        if self.wanted or topic != _DIAGNOSTICS:
            return False
        array = deserialize_message(raw, DiagnosticArray)
        return not all(self._own.speaks_of(status.name) for status in array.status)

    def describe(self, topics: set[str]) -> str:
        """Who publishes on topics."""
        return "; ".join(
            f"{topic}: {describe_publishers(self._node, topic, self._types.get(topic, ''))}" for topic in sorted(topics)
        )

    def _parsed(self, text: str) -> tuple[str, str]:
        topic, _, msgtype = text.partition("=")
        if not topic or not msgtype:
            raise SceneError(f"parameter 'types': '{text}' is not written as topic=package/msg/Type")
        return self._node.resolve_topic_name(topic), msgtype

    def _subscribe(self, topic: str, msgtype: str) -> None:
        try:
            message_type = message_class(msgtype)
        except LookupError as error:
            self._refused.add(topic)
            self._node.get_logger().error(f"{topic} is not recorded: {error}")
            return
        qos: QoSProfile = recording_qos(self._node.get_publishers_info_by_topic(topic), self._depth)
        self._types[topic] = msgtype
        take = partial(self._take, topic)
        self._open[topic] = self._node.create_subscription(message_type, topic, take, qos, raw=True)
        self._declare(topic, self._open[topic])

    def _declare(self, topic: str, subscription: Subscription) -> None:
        if self._writer is not None:
            self._writer.add_topic(topic, self._types[topic], offered_qos(subscription.qos_profile))
