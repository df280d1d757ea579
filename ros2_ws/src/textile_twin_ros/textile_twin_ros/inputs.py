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

"""Input topics of a machine: angle, index pulses and torque of its shaft, in blocks of all samples that wait."""

from __future__ import annotations

import math
import time
from collections import Counter, deque
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

from textile_twin_core.machine import AnyMachine
from textile_twin_core.machine.sizes import LARGEST
from textile_twin_core.recordings.counter import CounterUnwrapper, find_angle_counter
from textile_twin_core.recordings.schemas import FLOAT64, HEADER
from textile_twin_core.twin.encoder_reference import reference_of
from textile_twin_core.twin.restart import RestartWatch
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
    unit_findings,
    with_findings,
)
from textile_twin_ros.machine_namespace import SECOND_ANGLE
from textile_twin_ros.messages import (
    ANGLE_READERS,
    EDGES,
    TORQUE_READERS,
    ForeignJointsError,
    Kind,
    MessageError,
    message_class,
)
from textile_twin_ros.node_runner import run_overdue_tasks
from textile_twin_ros.sensor_parameters import SensorParameters

_MOST_SOURCES = 32
_NAMED = 12
_LEAP_RAD = 4.0 * math.pi
"""Move of an angle that is neither a shaft's nor a turn's end."""
_MOVES = 64
_REMEMBERED = 16384
"""Angles that show the unit: the shaft has to turn twice in them."""


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
        unit: value of one unit of the messages.
        is_angle: whether the values are angles.
    """

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
        unit: float = 1.0,
        is_angle: bool = False,
    ) -> None:
        self._node, self._topic, self._depth, self._take = node, topic, depth, take
        self._unit, self._is_angle = unit, is_angle
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
        return burst_findings(np.array(stamps, np.int64), np.array(values), self._is_angle)

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
        block, unit = list[Sample](), self._unit
        waiting: bytes | None = None if self._ended else raw
        received = of_others = 0
        while waiting is not None:
            received += 1
            stamped = True
            try:
                stamp, values = self._read(waiting)
                value, rate = (*values, _NAN, _NAN)[:2]
                if stamp is None:
                    stamped, stamp = False, self._node.get_clock().now().nanoseconds
                # A speed that its sensor divides by no time at all is none.
                block.append((stamp, value * unit, rate * unit if isfinite(rate) else _NAN))
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
        """Hand on the samples of a block; subclasses correct them first."""
        self._take(block)

    def _next(self) -> bytes | None:
        """Take the next message that waits: waking for it is a third of the work."""
        taken = take_next(self._subscription, self._message_class)
        self._late_s = 0.0 if taken is None else (time_ns() - received_ns(taken[1])) * 1e-9
        return None if taken is None else taken[0]


class AngleInput(SampleInput):
    """The topic `main_shaft/angle`, and `main_shaft/index` if the parameter `index` is set.

    Args:
        node: the node that listens.
        settings: its parameters.
        machine: whose encoder it is.
        depth: messages that may wait.
        take: called with blocks of samples: angles as the encoder measures them.

    Raises:
        SceneError: edges that this machine's encoder cannot count.
    """

    def __init__(
        self,
        node: Node,
        settings: SensorParameters,
        machine: AnyMachine,
        depth: int,
        take: Callable[[list[Sample]], None],
    ) -> None:
        self._create = lambda: reference_of(machine.sensors.encoder, settings.angle_type == "edges", settings.index)
        self._reference = self._create()
        common = (settings.joint, depth, settings.qos_reliability, lambda: settings.no_data_timeout_s)
        self._step_rad = machine.sensors.encoder.resolution_rad
        self._begin_counter()
        self._latest: deque[float] = deque(maxlen=0 if settings.angle_type == "edges" else _REMEMBERED)
        kind = ANGLE_READERS[settings.angle_type]
        super().__init__(node, "main_shaft/angle", kind, *common, take, settings.angle_unit_rad, is_angle=True)
        self._index = SampleInput(node, "main_shaft/index", EDGES, *common, self._on_pulses) if settings.index else None

    def statuses(self, counts: Mapping[str, float] | None = None) -> list[Status]:
        """The diagnostics of this moment, of the angle and of the index; `counts` as in `status`."""
        own = {} if self._reference is None else dict(self._reference.counts)
        index = [] if self._index is None else [self._index.status()]
        return [self.status({**own, **(counts or {})}, self._unit_findings()), *index]

    def restart(self) -> None:
        """Restart the watch, and forget the shaft's angle."""
        super().restart()
        self._reference = self._create()
        self._begin_counter()
        self._latest.clear()
        if self._index is not None:
            self._index.restart()

    def renew(self) -> None:
        """Renew the subscriptions of both topics, as SampleInput does."""
        super().renew()
        if self._index is not None:
            self._index.renew()

    def destroy(self) -> None:
        """End the subscriptions."""
        super().destroy()
        if self._index is not None:
            self._index.destroy()

    def _unit_findings(self) -> list[Finding]:
        return unit_findings(np.fromiter(self._latest, np.float64, len(self._latest)), self._unit)

    def _accept(self, block: list[Sample]) -> None:
        """Undo the wraps of a counter whose range is no number of turns, and count from the reference.

        `replay` does the same in a recording.
        """
        if self._counter is None:
            last = self._latest[-1] if self._latest else _NAN
            for _, angle, _ in block:
                if abs(angle - last) > _LEAP_RAD:
                    self._find_counter(block)
                    break
                last = angle
        if self._counter is not None:
            block = [(stamp, self._counter.step(angle), speed) for stamp, angle, speed in block]
        self._latest.extend([angle for _, angle, _ in block])
        if self._reference is not None:
            block = self._reference.take(block)
        if block:
            self._take(block)

    def _begin_counter(self) -> None:
        self._counter: CounterUnwrapper | None = None
        self._look_again_s = 0.0

    def _find_counter(self, block: list[Sample]) -> None:
        """Find the counter that passes its end in a block; looked for once a second at most."""
        if time.monotonic() < self._look_again_s:
            return
        self._look_again_s = time.monotonic() + 1.0
        readings = np.array([*self._latest, *(angle for _, angle, _ in block)])
        found = find_angle_counter(readings[np.isfinite(readings)], self._step_rad)
        if found is None:
            return
        self._counter = CounterUnwrapper([found.width])
        for angle in readings[: len(self._latest)][-_MOVES:].tolist():
            self._counter.step(angle)
        self._node.get_logger().warning(
            f"{self.name}: the angle is {found.text}, no multiple of a turn: continued from there"
        )

    def _on_pulses(self, block: list[Sample]) -> None:
        assert self._reference is not None
        for stamp, _, _ in block:
            if known := self._reference.index(stamp):
                self._take(known)


class SecondAngleInput(SampleInput):
    """The topic `main_shaft/second_angle` of a second encoder on an elastic shaft, in the unit of the first one.

    Args:
        node: the node that listens.
        settings: its parameters.
        depth: messages that may wait.
        take: called with blocks of samples: angles as the encoder measures them.
    """

    def __init__(
        self, node: Node, settings: SensorParameters, depth: int, take: Callable[[list[Sample]], None]
    ) -> None:
        kind = ANGLE_READERS["joint_state" if settings.angle_type == "edges" else settings.angle_type]
        common = (settings.joint, depth, settings.qos_reliability, lambda: settings.no_data_timeout_s)
        super().__init__(node, SECOND_ANGLE, kind, *common, take, settings.angle_unit_rad, is_angle=True)


class TorqueInput(SampleInput):
    """The topic `balancing_torque/measured`; its samples are in N m, NaN where a message holds no torque that can be.

    Args:
        node: the node that listens.
        settings: its parameters.
        depth: messages that may wait.
        take: called with blocks of samples.
    """

    def __init__(
        self, node: Node, settings: SensorParameters, depth: int, take: Callable[[list[Sample]], None]
    ) -> None:
        self._begin()
        common = (settings.joint, depth, settings.qos_reliability, lambda: settings.no_data_timeout_s)
        kind = TORQUE_READERS[settings.torque_type]
        super().__init__(node, "balancing_torque/measured", kind, *common, take, settings.torque_unit_Nm)

    def status(self, counts: Mapping[str, float] | None = None, seen: Iterable[Finding] = ()) -> Status:
        """Status as of SampleInput, with the faults of the samples."""
        own = {**self._rejected, "set_back": self._restarts.count}
        return super().status({**own, **(counts or {})}, seen)

    def restart(self) -> None:
        """Restart the watch."""
        super().restart()
        self._begin()

    def _begin(self) -> None:
        self._rejected = Counter(rejected_not_finite=0, rejected_duplicate_stamp=0, rejected_older_stamp=0)
        self._restarts = RestartWatch()
        self._last_ns: int | None = None

    def _accept(self, block: list[Sample]) -> None:
        self._take([(stamp, self._checked(stamp, value), rate) for stamp, value, rate in block])

    def _checked(self, stamp_ns: int, torque_Nm: float) -> float:
        """The torque, NaN where it is unusable; counts the unusable ones."""
        if not abs(torque_Nm) <= LARGEST:  # one number that is absurd would spoil sums and scales for long
            self._rejected["rejected_not_finite"] += 1
            return _NAN
        if not self._restarts.restarted(stamp_ns) and self._last_ns is not None and stamp_ns <= self._last_ns:
            cause = "duplicate" if stamp_ns == self._last_ns else "older"
            self._rejected[f"rejected_{cause}_stamp"] += 1
        else:
            self._last_ns = stamp_ns
        return torque_Nm
