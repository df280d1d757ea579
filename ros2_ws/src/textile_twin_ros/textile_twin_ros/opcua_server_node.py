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

"""An OPC UA server of a machine's twin: angle, speed, torques, residual, alarms, identification and state."""

from __future__ import annotations

import asyncio
import math
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import JointState

from textile_twin_core.errors import SceneError, TwinError
from textile_twin_core.recordings.fault_book import FaultBook
from textile_twin_ros.diagnostics import ERROR, OK, WARN, DiagnosticsPublisher, Status
from textile_twin_ros.endpoints import depth_for, samples_qos
from textile_twin_ros.health import CountWindow, with_findings
from textile_twin_ros.machine import load_machine
from textile_twin_ros.messages import JointReader, MessageError, TorqueReader
from textile_twin_ros.node_runner import EXECUTORS, finish_with, run
from textile_twin_ros.opcua_alarms import Alarms
from textile_twin_ros.opcua_machinery import MachineSpace
from textile_twin_ros.opcua_security import (
    CertificateWatch,
    ServerSecurity,
    ServerSecurityParameters,
    declare_connection,
)
from textile_twin_ros.outputs import Thinning
from textile_twin_ros.parameters import parameter

if TYPE_CHECKING:
    from asyncua import Server

_WRITE_S = 0.005
_MOST_AT_ONCE = 100
"""Values written until clients are served: writing one does not give way."""
_LOOK_S = 0.25
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
VARIABLES = {
    "ShaftAngle": "rad",
    "ShaftSpeed": "rad/s",
    "PredictedTorque": "N·m",
    "MeasuredTorque": "N·m",
    "TorqueResidual": "N·m",
}
"""Variables of a machine, with their units."""
_TORQUES = {
    "PredictedTorque": "balancing_torque/predicted",
    "MeasuredTorque": "balancing_torque/measured",
    "TorqueResidual": "balancing_torque/residual",
}


@dataclass
class OpcuaServerParameters(ServerSecurityParameters):
    """Parameters of opcua_server_node."""

    machine: str = parameter("tufting", "machine name, or path of a machine file: the same as the twin's")
    url: str = parameter("opc.tcp://0.0.0.0:4840", "address that the server listens on")
    book: str = parameter("", "folder of the fault book, for alarms; empty: none")
    name: str = parameter("", "browse name of the machine; empty: its namespace, or the machine's name")
    manufacturer: str = parameter("unknown", "manufacturer of the machine, as its nameplate says")
    serial_number: str = parameter("unknown", "its serial number")
    product_instance_uri: str = parameter("", "its globally unique name; empty: made of name and serial number")
    location: str = parameter("", "where it stands")
    rate_hz: float = parameter(0.0, "values of a variable a second at most; 0: every one", between=(0.0, 1e4))
    standstill_rad_s: float = parameter(0.1, "below this speed the machine is not executing", between=(0.0, 100.0))
    no_data_timeout_s: float = parameter(2.0, "not available after this time without samples", between=(0.1, 1e6))
    executor: str = parameter("events", "how callbacks are run", choices=EXECUTORS)


class OpcuaServerNode(Node):
    """Hands values of topics to a server in a thread of its own, each with its stamp as the source's time."""

    def __init__(self) -> None:
        # Optional packages are imported where they are used, so that a missing one is one line.
        import asyncua

        super().__init__("opcua_server_node")
        self.settings = settings = declare_connection(self, OpcuaServerParameters, "opc.tcp://0.0.0.0:4840")
        self.executor_name = settings.executor
        self.finished = Future()
        machine = load_machine(settings.machine)
        self._name = settings.name or self.get_namespace().strip("/").replace("/", "_") or machine.name
        self._security = ServerSecurity(settings)
        self._certificates = CertificateWatch(self._security.certificates)
        if not self._security.is_secure:
            self.get_logger().warning("allow_insecure: anyone in the network may read, and acknowledge alarms")
        self._book = FaultBook(settings.book, create=True) if settings.book else None
        self._create_server: Callable[[], Server] = asyncua.Server
        self._values: deque[tuple[str, int, float]] = deque(maxlen=10 * depth_for(settings.rate_hz or 1e3))
        self.counts: Counter[str] = Counter(values=0, unfit=0, dropped=0)
        self._recent = CountWindow()
        self._speed, self._last_s, self._trouble = 0.0, -math.inf, "not started yet"
        self._listen()
        self._diagnostics = DiagnosticsPublisher(self, lambda: settings.url, self._statuses)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=finish_with, args=(self.finished, self._work), name="opcua")
        self._thread.start()

    def close(self) -> None:
        """End the server."""
        self._stop.set()
        self._thread.join()

    def _listen(self) -> None:
        qos = samples_qos(depth_for(1e3))
        joints, thinning = JointReader("main_shaft", ("position", "velocity")), Thinning(lambda: self.settings.rate_hz)

        def take_shaft(raw: bytes) -> None:
            try:
                stamp_ns, (angle, speed) = joints.read(raw)
            except MessageError:
                self.counts["unfit"] += 1
                return
            self._last_s = time.monotonic()
            self._speed = speed if math.isfinite(speed) else 0.0
            if thinning.keeps(stamp_ns):
                for name, value in (("ShaftAngle", angle), ("ShaftSpeed", speed)):
                    if not math.isnan(value):
                        self._put(name, stamp_ns, value)

        def take_torque(name: str, reader: TorqueReader, thinning: Thinning, raw: bytes) -> None:
            try:
                stamp_ns, (torque,) = reader.read(raw)
            except MessageError:
                self.counts["unfit"] += 1
                return
            if not math.isnan(torque) and thinning.keeps(stamp_ns):
                self._put(name, stamp_ns, torque)

        self.create_subscription(JointState, "joint_states", take_shaft, qos, raw=True)
        for name, topic in _TORQUES.items():
            take = partial(take_torque, name, TorqueReader(), Thinning(lambda: self.settings.rate_hz))
            self.create_subscription(WrenchStamped, topic, take, qos, raw=True)

    def _put(self, name: str, stamp_ns: int, value: float) -> None:
        """Queue a value for the server's thread; a full queue drops its oldest one."""
        self.counts["dropped"] += len(self._values) == self._values.maxlen
        self._values.append((name, stamp_ns, value))

    def _work(self) -> int:
        try:
            asyncio.run(self._serve())
        except OSError as error:
            raise SceneError(f"parameter 'url': {self.settings.url}: {error.strerror or error}") from error
        return 0

    async def _serve(self) -> None:
        server = self._create_server()
        await server.init()
        server.set_endpoint(self.settings.url)
        server.set_server_name("textile-twin")
        await self._security.apply(server)
        space = MachineSpace(server)
        await space.build(self._name, self._identification(), VARIABLES)
        alarms = None
        if self._book is not None:
            alarms = Alarms(server, space, self._book, self.get_namespace())
            await alarms.build()
        async with server:
            self._trouble = ""
            how = "Basic256Sha256, users" if self._security.is_secure else "INSECURE"
            self.get_logger().info(f"serving {self._name} on {self.settings.url} ({how})")
            await self._feed(server, space, alarms)

    async def _feed(self, server: Server, space: MachineSpace, alarms: Alarms | None) -> None:
        """Write values as they come, and the state, until the node ends."""
        from asyncua import ua

        state, looked_s = "NotAvailable", -math.inf
        latest: dict[str, ua.DataValue] = {}
        while not self._stop.is_set():
            for _ in range(min(len(self._values), _MOST_AT_ONCE)):
                name, stamp_ns, value = self._values.popleft()
                stamp = _EPOCH + timedelta(microseconds=stamp_ns // 1000)
                latest[name] = ua.DataValue(ua.Variant(value, ua.VariantType.Double), SourceTimestamp=stamp)
                await server.write_attribute_value(space.variables[name].nodeid, latest[name])
                self.counts["values"] += 1
            if time.monotonic() - looked_s > _LOOK_S:
                looked_s = time.monotonic()
                before, state = state, self._state()
                if state != before:
                    await space.set_state(state)
                    if state == "NotAvailable":
                        await self._mark_old(server, space, latest)
                if alarms is not None:
                    await self._show_alarms(alarms)
            await asyncio.sleep(0.0 if self._values else _WRITE_S)

    async def _show_alarms(self, alarms: Alarms) -> None:
        try:
            await alarms.look()
            self._trouble = ""
        except TwinError as error:
            self._trouble = str(error)

    async def _mark_old(self, server: Server, space: MachineSpace, latest: dict[str, Any]) -> None:
        """Say of the values that nothing renews them."""
        from asyncua import ua

        old = ua.StatusCode(ua.StatusCodes.UncertainLastUsableValue)
        for name, value in latest.items():
            marked = ua.DataValue(value.Value, StatusCode=old, SourceTimestamp=value.SourceTimestamp)
            await server.write_attribute_value(space.variables[name].nodeid, marked)

    def _state(self) -> str:
        if time.monotonic() - self._last_s > self.settings.no_data_timeout_s:
            return "NotAvailable"
        return "Executing" if abs(self._speed) > self.settings.standstill_rad_s else "NotExecuting"

    def _identification(self) -> dict[str, str]:
        s = self.settings
        instance = s.product_instance_uri or f"urn:textile-twin:{self._name}:{s.serial_number}".replace(" ", "_")
        return {
            "Manufacturer": s.manufacturer,
            "SerialNumber": s.serial_number,
            "ProductInstanceUri": instance,
            "Model": s.machine.rpartition("/")[2],
            "SoftwareRevision": version("textile-twin-core"),
            "Location": s.location,
        }

    def _statuses(self) -> list[Status]:
        return [with_findings(self._status(), self._certificates.findings())]

    def _status(self) -> Status:
        values = dict(self.counts) | {"state": self._state()}
        dropped = self._recent.growth(self.counts)["dropped"]
        if self._trouble:
            return Status("opcua server", ERROR, self._trouble, values)
        if dropped:
            text = (
                f"{dropped:.0f} values dropped in the last seconds: more come than the computer can serve; set rate_hz"
            )
            return Status("opcua server", WARN, text, values)
        if not self._security.is_secure:
            return Status("opcua server", WARN, "insecure: allow_insecure is set", values)
        return Status("opcua server", OK, f"{self.counts['values']} values, {self._state()}", values)


def main(arguments: list[str] | None = None) -> int:
    """Run opcua_server_node."""
    return run("opcua_server_node", OpcuaServerNode, OpcuaServerParameters, arguments)
