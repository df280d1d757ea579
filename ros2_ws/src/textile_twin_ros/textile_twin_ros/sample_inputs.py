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

"""Input topics of the twin: subscriptions that take everything that waits at once and hand it on in blocks."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from math import isfinite
from time import monotonic, perf_counter_ns, time_ns
from typing import TypeAlias

import numpy as np
from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, QoSSubscriptionMatchedInfo, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSPolicyKind
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from textile_twin_core.recordings.message_types import FLOAT64, HEADER, JOINT_STATE, WRENCH
from textile_twin_ros.diagnostics import WINDOW_S, InputWatch, Status
from textile_twin_ros.endpoints import (
    NAMELESS,
    describe_publishers,
    publisher_name,
    received_ns,
    samples_qos,
    take_next,
)
from textile_twin_ros.health import (
    CountWindow,
    Finding,
    burst_findings,
    joint_findings,
    late_findings,
    publisher_findings,
    sample_findings,
    stamp_findings,
    with_findings,
)
from textile_twin_ros.messages import (
    ForeignJointsError,
    HeaderReader,
    JointReader,
    MessageError,
    TorqueReader,
    message_class,
    read_float64,
)
from textile_twin_ros.node_runner import run_overdue_tasks

_MOST_SOURCES = 32
_NAMED = 12


class ForeignJoints:
    """Messages that do not have the joint of this input, by the list of joints that they have."""

    def __init__(self) -> None:
        self.count = 0
        self._seen: dict[tuple[str, ...], float] = {}

    def take(self, error: ForeignJointsError) -> None:
        """Count a message."""
        self.count += 1
        if error.joints in self._seen or len(self._seen) < _MOST_SOURCES:
            self._seen[error.joints] = time.monotonic()

    def names(self) -> list[str]:
        """Names of the joints of the last seconds' messages, a dozen at most."""
        return sorted({name for joints in self._recent() for name in joints})[:_NAMED]

    def sources(self) -> int:
        """Number of joint lists in the last seconds' messages without this joint: each is another driver's."""
        return len(self._recent())

    def _recent(self) -> list[tuple[str, ...]]:
        since = time.monotonic() - WINDOW_S
        self._seen = {joints: seen for joints, seen in self._seen.items() if seen > since}
        return list(self._seen)


#: Stamp [ns], that of arrival where the message has none; value; its rate where the message has it, otherwise NaN.
Sample: TypeAlias = tuple[int, float, float]
Reading: TypeAlias = "tuple[int | None, float, float]"
Reader: TypeAlias = Callable[[bytes], Reading]
#: Message type, and what makes a reader of it for a joint.
Kind: TypeAlias = tuple[str, Callable[[str], Reader]]
# Reliability is the node's own parameter, which knows a third value.
_OVERRIDABLE = QoSOverridingOptions((QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH))
_BLOCK = 64
_WINDOW = 512
"""Latest samples whose stamps are looked at for bursts."""
_PAUSE_NS = 100_000
_OVERDUE_NS = 200_000_000
_NAN = float("nan")
_NAME_S = 2.0
"""Publishers may be without a name so long."""


def _joint_angle(joint: str) -> Reader:
    joints = JointReader(joint, ("position", "velocity"))

    def read(raw: bytes) -> Reading:
        stamp, (angle, velocity) = joints.read(raw)
        assert angle is not None  # the reader has refused a message without it
        # A speed that its sensor divides by no time at all is none.
        return stamp, angle, velocity if velocity is not None and isfinite(velocity) else _NAN

    return read


def _joint_effort(joint: str) -> Reader:
    joints = JointReader(joint, ("effort",))

    def read(raw: bytes) -> Reading:
        stamp, (effort,) = joints.read(raw)
        assert effort is not None
        return stamp, effort, _NAN

    return read


def _wrench_torque(_joint: str) -> Reader:
    wrenches = TorqueReader()

    def read(raw: bytes) -> Reading:
        stamp, (torque,) = wrenches.read(raw)
        return stamp, _NAN if torque is None else torque, _NAN

    return read


def _plain_number(_joint: str) -> Reader:
    return lambda raw: (None, read_float64(raw), _NAN)


def _stamp_alone(_joint: str) -> Reader:
    headers = HeaderReader()
    return lambda raw: (headers.read(raw)[0], _NAN, _NAN)


#: Events that have a stamp alone: edges of a toothed wheel, index pulses.
EDGES: Kind = (HEADER, _stamp_alone)
#: By the value of the parameter.
ANGLE_READERS: dict[str, Kind] = {
    "joint_state": (JOINT_STATE, _joint_angle),
    "float64": (FLOAT64, _plain_number),
    "edges": EDGES,
}
TORQUE_READERS: dict[str, Kind] = {
    "wrench": (WRENCH, _wrench_torque),
    "joint_state": (JOINT_STATE, _joint_effort),
    "float64": (FLOAT64, _plain_number),
}


class SampleInput:
    """One input topic: bytes in, blocks of samples out, watched for silence.

    A reliable subscription does not hear best-effort publishers. With reliability `auto` the input begins reliable and
    goes over to best effort when such a publisher appears.

    Args:
        node: the node that listens.
        topic: the input's name.
        kind: message type and reader.
        joint: the joint that is read, in types that have joints.
        depth: messages that may wait.
        reliability: "auto", "reliable" or "best_effort".
        silence_s: returns after how many seconds silence is worth a warning.
        take: called with the block's samples.
    """

    angle_unit_rad: float | None = None
    """What one unit of the samples is; None where they are no angles."""

    def __init__(
        self,
        node: Node,
        topic: str,
        kind: Kind,
        joint: str,
        depth: int,
        reliability: str,
        silence_s: Callable[[], float],
        take: Callable[[list[Sample]], None],
    ) -> None:
        self._node, self._topic, self._depth, self._take = node, topic, depth, take
        self.msgtype, create_reader = kind
        self._message_class = message_class(self.msgtype)
        self._read = create_reader(joint)
        self._automatic = reliability == "auto"
        self._renew_due = self._ended = False
        self._joint, self._foreign_joints = joint, ForeignJoints()
        self._recent = CountWindow()
        self._stamped = self.msgtype != FLOAT64
        self._newest_ns: int | None = None
        self._window: deque[tuple[int, float]] = deque(maxlen=_WINDOW)
        self._ready_ns = self._overdue_ns = 0
        self._late_s = 0.0
        self._all_named = monotonic()
        self.name = node.resolve_topic_name(topic)
        self.watch = InputWatch(node, self.name, silence_s, lambda: describe_publishers(node, topic, self.msgtype))
        self._subscription = self._subscribe("reliable" if self._automatic else reliability)

    def status(self, counts: Mapping[str, float] | None = None, seen: Iterable[Finding] = ()) -> Status:
        """The input's diagnostics of this moment.

        Args:
            counts: what became of its samples, as `health.sample_findings` knows it.
            seen: other faults, reported first.
        """
        others = self._foreign_joints
        counts = {"other_joints": others.count, **(counts or {})}
        growth = self._recent.growth({"received": self.watch.received, "unreadable": self.watch.refused, **counts})
        status = self.watch.status(self._topic, counts, refusing=growth["unreadable"] > 0)
        publishers = self._publishers()  # which joints they give is known from their messages alone
        findings = [
            *seen,
            *joint_findings(self._joint, others.names() if others.sources() else None, self.watch.silent_s),
            *late_findings(self._late_s),
            *stamp_findings(self._newest_ns, self._stamped),
            *self._burst_findings(),
            *sample_findings(growth, "messages"),
            *publisher_findings(publishers if self.watch.received else (), self.name, others.sources()),
        ]
        return with_findings(status, findings)

    def _burst_findings(self) -> list[Finding]:
        """Detect stamps in bursts among the latest samples; edges come when they pass."""
        if self.msgtype == HEADER or not self._window:
            return []
        stamps, values = zip(*self._window, strict=True)
        scale = 1.0 if self.angle_unit_rad is None else self.angle_unit_rad
        return burst_findings(np.array(stamps, np.int64), np.array(values) * scale, self.angle_unit_rad is not None)

    def _publishers(self) -> list[str]:
        """Names of who publishes there, without those that have none yet: a node's name may come after its topics."""
        names = [publisher_name(info) for info in self._node.get_publishers_info_by_topic(self.name)]
        named = [name for name in names if name != NAMELESS]
        if len(named) == len(names):
            self._all_named = monotonic()
        return named if monotonic() - self._all_named < _NAME_S else names

    def restart(self) -> None:
        """Restart the watch."""
        self.watch.restart()
        self._recent, self._newest_ns = CountWindow(), None
        self._foreign_joints = ForeignJoints()
        self._window.clear()

    def has_publishers(self) -> bool:
        """Return whether the subscription has a publisher."""
        return self._matched > 0

    def renew(self) -> None:
        """Subscribe again where a best-effort publisher has appeared; not from within the subscription's own events."""
        if self._renew_due:
            self._renew_due = False
            self._node.destroy_subscription(self._subscription)
            self._subscription = self._subscribe("best_effort")

    def destroy(self) -> None:
        """End the subscription; messages that the executor still holds for it are left out."""
        self._ended = True
        self._node.destroy_subscription(self._subscription)

    def _subscribe(self, reliability: str) -> Subscription:
        self._matched = 0
        return self._node.create_subscription(
            self._message_class,
            self._topic,
            self._on_message,
            samples_qos(self._depth, reliability),
            event_callbacks=SubscriptionEventCallbacks(
                incompatible_qos=self._on_incompatible, matched=self._on_matched
            ),
            qos_overriding_options=_OVERRIDABLE,
            raw=True,
        )

    def _on_matched(self, event: QoSSubscriptionMatchedInfo) -> None:
        self._matched = event.current_count

    def _on_incompatible(self, event: QoSRequestedIncompatibleQoSInfo) -> None:
        policy = QoSPolicyKind(int(event.last_policy_kind)).name.lower()
        seen = describe_publishers(self._node, self._topic, self.msgtype)
        if self._automatic and policy == "reliability":
            self._automatic, self._renew_due = False, True
            self._node.get_logger().info(f"listening on {self.name} with best effort, as it is published: {seen}")
            return
        self._node.get_logger().warning(
            f"a publisher on {self.name} offers less than this node asks for ({policy}) and is not heard: {seen};"
            " change its quality of service, or the parameter qos_reliability of this node"
        )

    def _on_message(self, raw: bytes) -> None:
        """Read this message and, where the node comes late, all that wait behind it."""
        # Asking in vain costs a tenth of a sample's work: nothing waits where there was time since the last one.
        now_ns = perf_counter_ns()
        due = now_ns > self._overdue_ns
        late = due or now_ns - self._ready_ns < _PAUSE_NS
        block: list[Sample] = []
        waiting: bytes | None = None if self._ended else raw
        received = of_others = 0
        while waiting is not None:
            received += 1
            stamped = True
            try:
                stamp, value, rate = self._read(waiting)
                stamped = stamp is not None
                block.append((self._node.get_clock().now().nanoseconds if stamp is None else stamp, value, rate))
            except ForeignJointsError as error:
                self._foreign_joints.take(error)
                of_others += 1
            except MessageError as error:
                self.watch.refuse(str(error))
            # Messages without a stamp come one by one, so that each has a time of its own.
            waiting = self._next() if late and stamped and received < _BLOCK else None
        if block:
            self._newest_ns = block[-1][0]
            self._window.extend([(stamp, value) for stamp, value, _ in block])
            self._accept(block)
        if received > of_others:
            self.watch.took(received - of_others)
        self._ready_ns = perf_counter_ns()
        if due:
            self._overdue_ns = self._ready_ns + _OVERDUE_NS
            run_overdue_tasks(self._node)

    def _accept(self, block: list[Sample]) -> None:
        """Hand on the samples of a block; subclasses convert them first."""
        self._take(block)

    def _next(self) -> bytes | None:
        """Take the next message that waits: waking for it is a third of the work."""
        taken = take_next(self._subscription, self._message_class)
        self._late_s = 0.0 if taken is None else (time_ns() - received_ns(taken[1])) * 1e-9
        return None if taken is None else taken[0]
