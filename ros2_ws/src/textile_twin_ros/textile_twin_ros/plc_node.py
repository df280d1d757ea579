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

"""A PLC in place of sensor drivers: angle and torque from its registers (Modbus TCP), the prediction back into them."""

from __future__ import annotations

import math
import threading
from collections import Counter
from dataclasses import dataclass

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import JointState

from textile_twin_core.errors import SceneError
from textile_twin_ros.diagnostics import ERROR, OK, WARN, DiagnosticsPublisher, Status
from textile_twin_ros.endpoints import depth_for, samples_qos
from textile_twin_ros.health import CountWindow
from textile_twin_ros.messages import JointTemplate, TorqueReader, WrenchTemplate
from textile_twin_ros.node_runner import EXECUTORS, finish_with, run
from textile_twin_ros.pacing import Pace
from textile_twin_ros.parameters import declare, parameter
from textile_twin_ros.plc_registers import BYTE_ORDERS, RefusedError, Register, Registers, counter_of
from textile_twin_ros.publishing import Publish, create_publish

_RETRY_S = 1.0
_TINY = 1e-30
_ORDER = "is not finite, or beyond its range: check the register, its type and the parameter byte_order"


@dataclass
class PlcParameters:
    """Parameters of plc_node; registers are written as ADDRESS:TYPE, such as 4:float32."""

    host: str = parameter("", "name or address of the PLC")
    port: int = parameter(502, "its Modbus TCP port", between=(1, 65535))
    device: int = parameter(1, "number of the device behind it", between=(0, 255))
    table: str = parameter("holding", "registers that angle, torque and sequence are in", choices=("holding", "input"))
    byte_order: str = parameter(
        "ABCD",
        "bytes of a long value, A the highest: CDAB, lower half first; BADC and DCBA, lower byte of a register first",
        choices=BYTE_ORDERS,
    )
    word_order: str = parameter(
        "", "earlier form of byte_order: big or little half first", choices=("", "big", "little")
    )
    angle: str = parameter("0:uint16", "register of the shaft's angle")
    angle_unit_rad: float = parameter(2.0 * math.pi / 65536, "radians of one count of it", between=(1e-12, 1e3))
    torque: str = parameter("", "register of the shaft's torque, or of the drive's current; none where there is none")
    torque_unit_Nm: float = parameter(1.0, "N m of one count of it, or the motor constant", between=(-1e6, 1e6))
    largest_angle_rad: float = parameter(1e9, "a larger angle, either way, is not published", between=(1e-3, 1e12))
    largest_torque_Nm: float = parameter(1e6, "a larger torque, either way, is not published", between=(1e-6, 1e12))
    sequence: str = parameter(
        "", "register that counts the PLC's samples: each is then taken once, and those missed are counted"
    )
    predicted: str = parameter("", "holding register that takes the latest predicted torque, in N m")
    rate_hz: float = parameter(
        200.0, "requests a second; with sequence, twice the PLC's samples or more", between=(0.1, 2000.0)
    )
    timeout_s: float = parameter(0.5, "how long an answer may take", between=(0.01, 60.0))
    executor: str = parameter("events", "how callbacks are run", choices=EXECUTORS)


class PlcNode(Node):
    """Asks the PLC at a steady rate from a thread of its own; a sample's stamp is the middle of its request."""

    def __init__(self) -> None:
        # Optional packages are imported where they are used, so that a missing one gives one line.
        from pymodbus.client import ModbusTcpClient

        super().__init__("plc_node")
        self.settings = settings = declare(self, PlcParameters)
        self.executor_name = settings.executor
        self.finished = Future()
        if not settings.host:
            raise SceneError("parameter 'host' is not set: give the PLC's name or address, -p host:=10.0.0.5")
        values = {name: Register.parse(name, getattr(settings, name)) for name in ("angle", "torque", "sequence")}
        if values["angle"] is None:
            raise SceneError("parameter 'angle' is empty: give the register of the shaft's angle, such as 0:uint16")
        if values["sequence"] is not None and values["sequence"].is_float:
            raise SceneError(f"parameter 'sequence' is '{settings.sequence}': it counts, so give it a whole type")
        self._sequence_bits = 16 * values["sequence"].length if values["sequence"] is not None else 0
        self._predicted = Register.parse("predicted", settings.predicted)
        self._client = ModbusTcpClient(settings.host, port=settings.port, timeout=settings.timeout_s, retries=0)
        self._registers = Registers(self._client, settings.table, values, settings.device, self._byte_order())
        self.counts: Counter[str] = Counter(received=0, implausible=0, missed=0, failures=0)
        self._counter = counter_of(values["angle"].counter_width, settings.angle_unit_rad)
        self._floats = {name for name, value in values.items() if value is not None and value.is_float}
        self._recent, self._trouble, self._refusal = CountWindow(), "not connected yet", ""
        self._last_sequence: int | None = None
        self._implausible = ""
        self._latest: float | None = None
        self._create_topics(has_torque=values["torque"] is not None)
        self._diagnostics = DiagnosticsPublisher(self, lambda: f"{settings.host}:{settings.port}", self._statuses)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=finish_with, args=(self.finished, self._work), name="plc")
        self._thread.start()

    def _byte_order(self) -> str:
        given = {"": self.settings.byte_order, "big": "ABCD", "little": "CDAB"}[self.settings.word_order]
        if self.settings.word_order and self.settings.byte_order not in ("ABCD", given):
            raise SceneError(
                f"parameters 'word_order' is '{self.settings.word_order}' and 'byte_order' is"
                f" '{self.settings.byte_order}': give byte_order alone"
            )
        return given

    def close(self) -> None:
        """End the thread and the connection."""
        self._stop.set()
        self._thread.join()
        self._client.close()

    def _create_topics(self, has_torque: bool) -> None:
        qos = samples_qos(depth_for(self.settings.rate_hz))
        self._angle, self._torque = JointTemplate(["main_shaft"], velocities=False), WrenchTemplate("main_shaft")
        self._send_angle = create_publish(self, JointState, "main_shaft/angle", qos)
        self._send_torque: Publish | None = None
        if has_torque:
            self._send_torque = create_publish(self, WrenchStamped, "balancing_torque/measured", qos)
        if self._predicted is not None:
            reader = TorqueReader()

            def keep(raw: bytes) -> None:
                _, (self._latest,) = reader.read(raw)

            self.create_subscription(WrenchStamped, "balancing_torque/predicted", keep, qos, raw=True)

    def _work(self) -> int:
        pace, number = Pace(self._stop), 0
        while pace.wait_until(number / self.settings.rate_hz):
            number += 1
            try:
                self._ask()
            except OSError as error:
                self._fail(error)
                if self._stop.wait(_RETRY_S):
                    break
                pace, number = Pace(self._stop), 0
        return 0

    def _ask(self) -> None:
        """One request, and the messages that come of it."""
        from pymodbus.exceptions import ModbusException

        if not self._client.connected and not self._client.connect():
            raise OSError("no connection")
        try:
            before = self.get_clock().now().nanoseconds
            values = self._registers.read()
            stamp = (before + self.get_clock().now().nanoseconds) // 2
            self._give(stamp, values)
            self._write_prediction()
        except ModbusException as error:
            raise OSError(str(error)) from error
        if self._trouble:
            self.get_logger().info(f"reading {self.settings.host}:{self.settings.port}")
            self._trouble = ""

    def _write_prediction(self) -> None:
        """Into its register; a PLC that does not take it gives angles all the same."""
        latest, self._latest = self._latest, None
        if self._predicted is None or self._refusal or latest is None or not math.isfinite(latest):
            return
        try:
            self._registers.write(self._predicted, latest)
        except RefusedError as error:
            self._refusal = f"{error}; not tried again before the next connection: see parameter 'predicted'"
            self.get_logger().warning(f"{self.settings.host}:{self.settings.port}: {self._refusal}")

    def _give(self, stamp_ns: int, values: dict[str, float]) -> None:
        if self._sequence_bits:
            sequence = int(values["sequence"])
            if sequence == self._last_sequence:
                return
            if self._last_sequence is not None:
                ahead = (sequence - self._last_sequence) % (1 << self._sequence_bits)
                if 2 * ahead < 1 << self._sequence_bits:  # else the PLC's program restarted
                    self.counts["missed"] += ahead - 1
            self._last_sequence = sequence
        self.counts["received"] += 1
        settings = self.settings
        count = values["angle"] if self._counter is None else self._counter.step(values["angle"])
        angle = count * settings.angle_unit_rad
        if self._is_plausible("angle", values["angle"], angle, settings.largest_angle_rad):
            self._send_angle(self._angle.message(stamp_ns, angle))
        if self._send_torque is not None:
            torque = values["torque"] * settings.torque_unit_Nm
            if self._is_plausible("torque", values["torque"], torque, settings.largest_torque_Nm):
                self._send_torque(self._torque.message(stamp_ns, torque))

    def _is_plausible(self, name: str, count: float, value: float, largest: float) -> bool:
        """Return whether a value may be published; counts it otherwise.

        Bytes in another order give numbers that are not finite, huge, or smaller than any sensor's.
        """
        tiny = name in self._floats and 0.0 < abs(count) < _TINY
        if abs(value) <= largest and not tiny:  # false of NaN, too
            return True
        self.counts["implausible"] += 1
        if not self._implausible:
            self.get_logger().warning(f"{self.settings.host}:{self.settings.port}: {name} {count:.6g} {_ORDER}")
        self._implausible = f"{name} {count:.6g} {_ORDER}"
        return False

    def _fail(self, error: OSError) -> None:
        self._client.close()
        self._last_sequence, self._refusal = None, ""
        self.counts["failures"] += 1
        text = " ".join(str(error).split())
        if text != self._trouble:
            self._trouble = text
            self.get_logger().warning(f"{self.settings.host}:{self.settings.port}: {text}; trying again every second")

    def _statuses(self) -> list[Status]:
        growth = self._recent.growth(self.counts)
        if self._trouble:
            return [Status("plc", ERROR, self._trouble, self.counts)]
        if growth["implausible"]:
            text = f"{growth['implausible']:.0f} values not published in the last seconds, as {self._implausible}"
            return [Status("plc", ERROR, text, self.counts)]
        if growth["missed"] or growth["failures"]:
            text = f"{growth['missed']:.0f} samples missed, {growth['failures']:.0f} failures; raise rate_hz"
            return [Status("plc", WARN, text, self.counts)]
        if self._refusal:
            return [Status("plc", WARN, self._refusal, self.counts)]
        return [Status("plc", OK, f"{self.counts['received']} samples", self.counts)]


def main(arguments: list[str] | None = None) -> int:
    """Run plc_node."""
    return run("plc_node", PlcNode, PlcParameters, arguments)
