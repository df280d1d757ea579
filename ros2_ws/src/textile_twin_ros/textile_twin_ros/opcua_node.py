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

"""A PLC in place of sensor drivers: angle and torque from its OPC UA server, the prediction back into it."""

from __future__ import annotations

import asyncio
import math
import threading
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import JointState

from textile_twin_core.errors import SceneError
from textile_twin_core.recordings.counter import CounterUnwrapper
from textile_twin_ros.diagnostics import ERROR, OK, WARN, DiagnosticsPublisher, Status
from textile_twin_ros.endpoints import depth_for, samples_qos
from textile_twin_ros.health import CountWindow, Finding, with_findings
from textile_twin_ros.messages import JointTemplate, TorqueReader, WrenchTemplate
from textile_twin_ros.node_runner import EXECUTORS, finish_with, run
from textile_twin_ros.opcua_security import (
    CertificateWatch,
    ClientSecurity,
    ClientSecurityParameters,
    declare_connection,
)
from textile_twin_ros.opcua_values import NodeName, Value, Values
from textile_twin_ros.parameters import parameter
from textile_twin_ros.plc_registers import counter_of
from textile_twin_ros.publishing import Publish, create_publish

if TYPE_CHECKING:
    from asyncua.client.client import Client

_RETRY_S = 1.0
_WRITE_S = 0.02
_CHECK_S = 1.0


@dataclass
class OpcuaParameters(ClientSecurityParameters):
    """Parameters of opcua_node; variables are written as node ids: ns=2;s=Loom.Angle or nsu=URI;s=Loom.Angle."""

    url: str = parameter("", "address of the server, such as opc.tcp://10.0.0.5:4840")
    angle: str = parameter(
        "", "variable of the shaft's angle: ns=2;s=Loom.Angle, or nsu=URI;s=Loom.Angle by its namespace"
    )
    angle_unit_rad: float = parameter(1.0, "radians of one unit of it", between=(1e-12, 1e3))
    torque: str = parameter("", "variable of the shaft's torque, or of the drive's current; none where there is none")
    torque_unit_Nm: float = parameter(1.0, "N m of one unit of it, or the motor constant", between=(-1e6, 1e6))
    predicted: str = parameter("", "variable that takes the latest predicted torque, in N m")
    stamps: str = parameter(
        "source",
        "of the messages: the source's, by the PLC's clock (the server's where it gives none), or of arrival here",
        choices=("source", "arrival"),
    )
    sampling_ms: float = parameter(
        0.0, "how often the server looks at a variable; 0: as fast as it can, or at each change", between=(0.0, 1e4)
    )
    rate_hz: float = parameter(
        200.0, "samples a second at most: the server and queues here hold five seconds of them", between=(0.1, 1e4)
    )
    timeout_s: float = parameter(4.0, "how long an answer may take", between=(0.1, 60.0))
    executor: str = parameter("events", "how callbacks are run", choices=EXECUTORS)


class OpcuaNode(Node):
    """Subscribes to the server's variables; each change is a message with its stamp."""

    def __init__(self) -> None:
        # Optional packages are imported where they are used, so that a missing one is one line.
        from asyncua.client.client import Client
        from asyncua.ua.uaerrors import BadNodeIdUnknown, UaError

        super().__init__("opcua_node")
        self._create_client, self._refused, self._failures = Client, UaError, (OSError, UaError)
        self._unknown_node = BadNodeIdUnknown
        self.settings = settings = declare_connection(self, OpcuaParameters, "opc.tcp://10.0.0.5:4840")
        self.executor_name = settings.executor
        self.finished = Future()
        if not settings.angle:
            raise SceneError("parameter 'angle' is not set: give the variable's node id, such as ns=2;s=Loom.Angle")
        self._security = ClientSecurity(settings)
        self._certificates = CertificateWatch(self._security.certificates)
        self._names = {
            name: self._node_name(name) for name in ("angle", "torque", "predicted") if getattr(settings, name)
        }
        self._counter: CounterUnwrapper | None = None
        self._counts_width: int | None = None
        self._time_from = "source"
        self.counts: Counter[str] = Counter(angles=0, torques=0, unfit=0, overflows=0, failures=0)
        self._recent, self._trouble, self._refusal = CountWindow(), "not connected yet", ""
        self._latest: float | None = None
        self._create_topics()
        self._diagnostics = DiagnosticsPublisher(self, lambda: settings.url, self._statuses)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=finish_with, args=(self.finished, self._work), name="opcua")
        self._thread.start()

    def close(self) -> None:
        """End the thread and the connection."""
        self._stop.set()
        self._thread.join()

    def _node_name(self, name: str) -> NodeName:
        text = getattr(self.settings, name)
        try:
            return NodeName(text)
        except ValueError as error:
            raise SceneError(
                f"parameter '{name}' is '{text}': write a node id, such as ns=2;s=Loom.Angle ({error})"
            ) from error

    def _create_topics(self) -> None:
        qos = samples_qos(depth_for(self.settings.rate_hz))
        self._angle, self._torque = JointTemplate(["main_shaft"], velocities=False), WrenchTemplate("main_shaft")
        self._send_angle = create_publish(self, JointState, "main_shaft/angle", qos)
        has_torque = "torque" in self._names
        self._send_torque: Publish | None = None
        if has_torque:
            self._send_torque = create_publish(self, WrenchStamped, "balancing_torque/measured", qos)
        if "predicted" in self._names:
            reader = TorqueReader()

            def keep(raw: bytes) -> None:
                _, (self._latest,) = reader.read(raw)

            self.create_subscription(WrenchStamped, "balancing_torque/predicted", keep, qos, raw=True)

    def _work(self) -> int:
        asyncio.run(self._connect_again_and_again())
        return 0

    async def _connect_again_and_again(self) -> None:
        settings = self.settings
        while not self._stop.is_set():
            try:
                client = self._create_client(settings.url, timeout=settings.timeout_s)
                await self._security.apply(client)
                async with client:
                    await self._talk(client)
            except self._failures as error:
                self._fail(" ".join(str(error).split()) or type(error).__name__)
            for _ in range(round(_RETRY_S / _WRITE_S)):
                if self._stop.is_set():
                    return
                await asyncio.sleep(_WRITE_S)

    async def _talk(self, client: Client) -> None:
        """Listen until stopped.

        Raises:
            OSError, TimeoutError, UaError: the server has gone, or has no such variable.
        """
        settings = self.settings
        values = Values(client, depth_for(settings.rate_hz), settings.sampling_ms)
        ids = {name: await node.at(client) for name, node in self._names.items()}
        listened: dict[str, Any] = {name: ids[name] for name in ("angle", "torque") if name in ids}
        await values.subscribe(listened, {"angle": self._give_angle, "torque": self._give_torque})
        self.get_logger().info(f"reading {settings.url}")
        self._trouble = self._refusal = ""
        looks = 0
        while not self._stop.is_set():
            await asyncio.sleep(_WRITE_S)
            latest, self._latest = self._latest, None
            if latest is not None and math.isfinite(latest) and not self._refusal:
                await self._write_prediction(client, values, ids, latest)
            if values.gone:
                raise self._refused(f"{values.gone}: BadNodeIdUnknown: looked up again at the next connection")
            looks += 1
            if looks % round(_CHECK_S / _WRITE_S) == 0:
                await client.check_connection()

    async def _write_prediction(self, client: Client, values: Values, ids: dict[str, Any], torque_Nm: float) -> None:
        """Into its variable; a server that does not take it gives angles all the same."""
        try:
            try:
                await values.write(ids["predicted"], torque_Nm)
            except self._unknown_node:  # its namespace may have another number by now
                ids["predicted"] = await self._names["predicted"].at(client)
                await values.write(ids["predicted"], torque_Nm)
        except self._refused as error:
            await client.check_connection()
            why = " ".join(str(error).split()) or type(error).__name__
            self._refusal = (
                f"the server does not take '{self.settings.predicted}': {why}; not tried again before the next"
                " connection: see parameter 'predicted'"
            )
            self.get_logger().warning(f"{self.settings.url}: {self._refusal}")

    def _give_angle(self, value: Value) -> None:
        number = self._number(value)
        if number is not None:
            self.counts["angles"] += 1
            if value.counter_width != self._counts_width:
                self._counts_width = value.counter_width
                self._counter = counter_of(value.counter_width, self.settings.angle_unit_rad)
            count = number if self._counter is None else self._counter.step(number)
            self._send_angle(self._angle.message(self._stamp(value), count * self.settings.angle_unit_rad))

    def _give_torque(self, value: Value) -> None:
        number = self._number(value)
        if number is not None and self._send_torque is not None:
            self.counts["torques"] += 1
            self._send_torque(self._torque.message(self._stamp(value), number * self.settings.torque_unit_Nm))

    def _number(self, value: Value) -> float | None:
        self.counts["overflows"] += value.overflow
        if value.number is None:
            self.counts["unfit"] += 1
        return value.number

    def _stamp(self, value: Value) -> int:
        if self.settings.stamps == "source":
            self._time_from = value.clock
            if value.stamp_ns is not None:
                return value.stamp_ns
        return int(self.get_clock().now().nanoseconds)

    def _fail(self, text: str) -> None:
        self.counts["failures"] += 1
        if text != self._trouble:
            self._trouble = text
            self.get_logger().warning(f"{self.settings.url}: {text}; trying again every second")

    def _statuses(self) -> list[Status]:
        return [with_findings(self._status(), [*self._clock_findings(), *self._certificates.findings()])]

    def _clock_findings(self) -> list[Finding]:
        if self._time_from == "source" or self._trouble:
            return []
        instead = "stamps are the server's" if self._time_from == "server" else "stamps are of arrival here"
        text = f"the server gives values without a source time: {instead}; set stamps:=arrival, or give it in the PLC"
        return [Finding("no source time", WARN, text)]

    def _status(self) -> Status:
        growth = self._recent.growth(self.counts)
        if self._trouble:
            return Status("plc", ERROR, self._trouble, self.counts)
        wrong = {name: growth[name] for name in ("unfit", "overflows", "failures") if growth[name]}
        if wrong:
            text = ", ".join(f"{count:.0f} {name}" for name, count in wrong.items())
            return Status("plc", WARN, f"{text} in the last seconds", self.counts)
        if self._refusal:
            return Status("plc", WARN, self._refusal, self.counts)
        return Status("plc", OK, f"{self.counts['angles']} angles", self.counts)


def main(arguments: list[str] | None = None) -> int:
    """Run opcua_node."""
    return run("opcua_node", OpcuaNode, OpcuaParameters, arguments)
