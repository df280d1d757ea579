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

"""Quality of service of the topics, and descriptions of their publishers for the diagnostics."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from textile_twin_core.errors import SceneError
from textile_twin_core.recordings import OfferedQos
from textile_twin_ros.publishing import RCLError

STARTED = time.monotonic()
_DISCOVERY_S = 5.0
"""How long after its start a node may not know yet who is there."""
_NAMED = 3
"""How many other topics of a type are named."""

NAMELESS = "a publisher not known by name yet"
_UNKNOWN = "_NODE_NAME_UNKNOWN_"
"""What the middleware says where it knows the topic and not yet the node."""

RELIABILITY = {"reliable": ReliabilityPolicy.RELIABLE, "best_effort": ReliabilityPolicy.BEST_EFFORT}


QUEUE_S = 5.0
"""Seconds of samples that queues hold, at both ends: a process that a busy computer lets wait so long loses nothing."""


def topic_name(node: Node, topic: str, parameter: str) -> str:
    """The full name of a topic that a parameter names.

    Raises:
        SceneError: it cannot be one.
    """
    try:
        return str(node.resolve_topic_name(topic))
    except RCLError as error:
        rule = str(error).removeprefix("failed to resolve name: ").partition(", at /")[0]
        raise SceneError(f"parameter '{parameter}': '{topic}' is no topic: {rule}") from error


def refuse_own_outputs(node: Node, inputs: Iterable[str], outputs: Iterable[str]) -> None:
    """Refuse inputs that this node itself publishes, as its remaps and its namespace resolve the names.

    Raises:
        SceneError: an input is one of the outputs; the text names the remap that separates them.
    """
    published = {node.resolve_topic_name(output): output for output in outputs}
    for name in inputs:
        topic = node.resolve_topic_name(name)
        if topic in published:
            output = published[topic]
            raise SceneError(
                f"the input {name} is {topic}, which this node publishes itself as its output {output}: give the output"
                f" another name, -r {output}:=twin/{output}, or take the input from its sensor's topic,"
                f" -r {name}:=TOPIC, and leave out the remap that joins them"
            )


def depth_for(rate_hz: float, seconds: float = QUEUE_S) -> int:
    """Queue depth that holds this many seconds of messages."""
    return max(10, math.ceil(rate_hz * seconds))


def samples_qos(depth: int, reliability: str = "reliable") -> QoSProfile:
    """Quality of service of a stream of samples: no loss while the queue has room."""
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=RELIABILITY[reliability])


def latched_qos() -> QoSProfile:
    """Quality of service of a latched topic: a late subscriber gets the last message."""
    return QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def relative_name(topic: str) -> str:
    """A recorded topic's name without leading slash, so that a namespace can go before it; /tf and the like stay."""
    return topic if topic in ("/tf", "/tf_static", "/diagnostics", "/clock") else topic.lstrip("/")


def take_next(subscription: Subscription, message_type: type) -> tuple[bytes, dict[str, Any]] | None:
    """Take the next message that waits, with its stamps by the middleware; None without one.

    An executor gives one message per wake, and rclpy has no public method to take one.
    """
    handle = subscription.handle
    with handle:
        taken: tuple[bytes, dict[str, Any]] | None = handle.take_message(message_type, True)
    return taken


def received_ns(info: Mapping[str, Any]) -> int:
    """Time of a message's reception [ns]; the present time where the middleware gives none, as that of Cyclone DDS."""
    return int(info["received_timestamp"] or time.time_ns())


def describe_publishers(node: Node, topic: str, msgtype: str) -> str:
    """Publishers of a topic, with type and reliability; without one, other topics of the type."""
    resolved = node.resolve_topic_name(topic)
    publishers = node.get_publishers_info_by_topic(resolved)
    if publishers:
        return "; ".join(_publisher(info, msgtype) for info in publishers)
    elsewhere = [
        name
        for name, types in node.get_topic_names_and_types()
        if msgtype in types and any(not _is_own(node, info) for info in node.get_publishers_info_by_topic(name))
    ]
    ending = resolved.rpartition("/")[2]
    elsewhere.sort(key=lambda name: (name.rpartition("/")[2] != ending, name))  # perhaps another namespace is meant
    more = f" and {len(elsewhere) - _NAMED} more" if len(elsewhere) > _NAMED else ""
    seen = f"; {msgtype} is published on {', '.join(elsewhere[:_NAMED])}{more}" if elsewhere else ""
    silent = "no node publishes there" if time.monotonic() - STARTED > _DISCOVERY_S else "no publisher found there yet"
    return f"{silent}{seen}"


def publisher_name(info: TopicEndpointInfo) -> str:
    """The full name of the node that a publisher is of; `NAMELESS` while it is not known."""
    return NAMELESS if info.node_name == _UNKNOWN else f"{info.node_namespace.rstrip('/')}/{info.node_name}"


def _is_own(node: Node, info: TopicEndpointInfo) -> bool:
    return bool(info.node_name == node.get_name() and info.node_namespace == node.get_namespace())


def _publisher(info: TopicEndpointInfo, msgtype: str) -> str:
    reliability = info.qos_profile.reliability.name.lower().replace("_", " ")
    text = f"{publisher_name(info)} publishes {info.topic_type}, {reliability}"
    return text if info.topic_type == msgtype else f"{text} (this node wants {msgtype})"


def recording_qos(publishers: list[TopicEndpointInfo], depth: int) -> QoSProfile:
    """Quality of service that hears all of these publishers, as well as they offer."""
    profiles = [info.qos_profile for info in publishers]
    reliable = all(profile.reliability is ReliabilityPolicy.RELIABLE for profile in profiles)
    latched = bool(profiles) and all(profile.durability is DurabilityPolicy.TRANSIENT_LOCAL for profile in profiles)
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def replayed_qos(offered: OfferedQos, depth: int) -> QoSProfile:
    """The quality of service that a recorded topic was offered with; its queue holds `depth` messages or more.

    A latched topic keeps its own depth: a late subscriber gets as many messages as from the recorded publisher.
    """
    latched = offered.durability == "transient_local"
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=offered.depth if latched else max(offered.depth, depth),
        reliability=RELIABILITY[offered.reliability],
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def offered_qos(profile: QoSProfile) -> OfferedQos:
    """The profile as recordings keep it."""
    return OfferedQos(
        reliability=profile.reliability.name.lower(), durability=profile.durability.name.lower(), depth=profile.depth
    )
