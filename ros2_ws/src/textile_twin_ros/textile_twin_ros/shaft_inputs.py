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

"""The shaft's inputs: its angle as samples or as edges of a toothed wheel, index pulses, and its torque."""

from __future__ import annotations

import math
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping

import numpy as np
from rclpy.node import Node

from textile_twin_core.machine import AnyMachine
from textile_twin_core.machine.sizes import LARGEST
from textile_twin_core.shaft.counter import CounterUnwrapper, find_angle_counter
from textile_twin_core.twin.encoder_reference import reference_of
from textile_twin_core.twin.restart import RestartWatch
from textile_twin_ros.diagnostics import Status
from textile_twin_ros.health import Finding, unit_findings
from textile_twin_ros.machine_namespace import SECOND_ANGLE
from textile_twin_ros.sample_inputs import ANGLE_READERS, EDGES, TORQUE_READERS, Sample, SampleInput
from textile_twin_ros.sensor_parameters import SensorParameters

_LEAP_RAD = 4.0 * math.pi
"""Move of an angle that is neither a shaft's nor a turn's end."""
_MOVES = 64
_REMEMBERED = 16384
"""Angles that show the unit: the shaft has to turn twice in them."""


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
        self._unit = self.angle_unit_rad = settings.angle_unit_rad
        self._step_rad = machine.sensors.encoder.resolution_rad
        self._begin_counter()
        self._latest: deque[float] = deque(maxlen=0 if settings.angle_type == "edges" else _REMEMBERED)
        super().__init__(node, "main_shaft/angle", ANGLE_READERS[settings.angle_type], *common, take)
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
        if self._unit != 1.0:
            block = [(stamp, angle * self._unit, speed * self._unit) for stamp, angle, speed in block]
        block = self._without_wraps(block)
        self._latest.extend([angle for _, angle, _ in block])
        if self._reference is not None:
            block = self._reference.take(block)
        if block:
            self._take(block)

    def _begin_counter(self) -> None:
        self._counter: CounterUnwrapper | None = None
        self._look_again_s = 0.0

    def _without_wraps(self, block: list[Sample]) -> list[Sample]:
        """Undo the wraps of a counter whose range is no number of turns, as `replay` does in a recording."""
        if self._counter is None:
            last = self._latest[-1] if self._latest else math.nan
            for _, angle, _ in block:
                if abs(angle - last) > _LEAP_RAD:
                    self._find_counter(block)
                    break
                last = angle
        if self._counter is None:
            return block
        step = self._counter.step
        return [(stamp, step(angle), speed) for stamp, angle, speed in block]

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
        self._unit = self.angle_unit_rad = settings.angle_unit_rad
        kind = ANGLE_READERS["joint_state" if settings.angle_type == "edges" else settings.angle_type]
        common = (settings.joint, depth, settings.qos_reliability, lambda: settings.no_data_timeout_s)
        super().__init__(node, SECOND_ANGLE, kind, *common, take)

    def _accept(self, block: list[Sample]) -> None:
        self._take([(stamp, angle * self._unit, speed) for stamp, angle, speed in block])


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
        self._unit = settings.torque_unit_Nm
        self._begin()
        common = (settings.joint, depth, settings.qos_reliability, lambda: settings.no_data_timeout_s)
        kind = TORQUE_READERS[settings.torque_type]
        super().__init__(node, "balancing_torque/measured", kind, *common, take)

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
        self._take([(stamp, self._checked(stamp, value * self._unit), rate) for stamp, value, rate in block])

    def _checked(self, stamp_ns: int, torque_Nm: float) -> float:
        """The torque, NaN where it is unusable; counts the unusable ones."""
        if not abs(torque_Nm) <= LARGEST:  # one number that is absurd would spoil sums and scales for long
            self._rejected["rejected_not_finite"] += 1
            return math.nan
        if not self._restarts.restarted(stamp_ns) and self._last_ns is not None and stamp_ns <= self._last_ns:
            cause = "duplicate" if stamp_ns == self._last_ns else "older"
            self._rejected[f"rejected_{cause}_stamp"] += 1
        else:
            self._last_ns = stamp_ns
        return torque_Nm
