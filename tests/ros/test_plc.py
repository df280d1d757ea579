"""plc_node against pymodbus's own server: angle and torque in, predictions out, nothing lost at 100 Hz."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Iterator

import numpy as np
import pytest

pytest.importorskip("pymodbus")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from pymodbus.client import ModbusTcpClient
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice
from sensor_msgs.msg import JointState

from tests.ros.suite import RELIABLE, SECOND_NS, Suite
from textile_twin_core.errors import SceneError
from textile_twin_ros.plc_registers import Register, Registers

RATE_HZ, SAMPLES = 100.0, 500


class Plc:
    """pymodbus's server in a thread of its own, on a port of its own."""

    def __init__(self) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = int(probe.getsockname()[1])
        self._loop = asyncio.new_event_loop()
        self._started = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()
        assert self._started.wait(10.0)
        self._program = ModbusTcpClient("127.0.0.1", port=self.port)
        assert self._program.connect()

    def _serve(self) -> None:
        async def serve() -> None:
            registers = SimData(0, count=64, values=0, datatype=DataType.REGISTERS)
            self._server = ModbusTcpServer(SimDevice(1, [registers]), address=("127.0.0.1", self.port))
            self._loop.call_later(0.1, self._started.set)
            await self._server.serve_forever()

        self._loop.run_until_complete(serve())

    def set(self, address: int, words: list[int]) -> None:
        """Write registers all at once, as a PLC's cycle does."""
        assert not self._program.write_registers(address, words).isError()

    def words(self, address: int, count: int) -> list[int]:
        """Registers as they are now."""
        return list(self._program.read_holding_registers(address, count=count).registers)

    def close(self) -> None:
        """End the server, once."""
        if not self._thread.is_alive():
            return
        self._program.close()
        asyncio.run_coroutine_threadsafe(self._server.shutdown(), self._loop).result(10.0)
        self._thread.join(10.0)


@pytest.fixture
def plc() -> Iterator[Plc]:
    server = Plc()
    yield server
    server.close()


def test_a_machine_behind_a_plc(suite: Suite, plc: Plc) -> None:
    kind = ModbusTcpClient.DATATYPE
    node = suite.node()
    angles: list[JointState] = []
    torques: list[WrenchStamped] = []
    predicted: list[float] = []
    told: list[DiagnosticStatus] = []
    node.create_subscription(JointState, "main_shaft/angle", angles.append, RELIABLE)
    node.create_subscription(WrenchStamped, "balancing_torque/measured", torques.append, RELIABLE)
    node.create_subscription(
        WrenchStamped, "balancing_torque/predicted", lambda m: predicted.append(m.wrench.torque.z), RELIABLE
    )
    node.create_subscription(
        DiagnosticArray,
        "/diagnostics",
        lambda message: told.extend(status for status in message.status if status.name == "plc_node: plc"),
        RELIABLE,
    )
    plc.set(14, [65_299])
    bridge = suite.start(
        "plc_node",
        "host:=127.0.0.1",
        f"port:={plc.port}",
        "angle:=10:uint32",
        f"angle_unit_rad:={2 * np.pi / 2**20}",
        "torque:=12:float32",
        "torque_unit_Nm:=0.5",
        "sequence:=14:uint16",
        "predicted:=40:float32",
        "rate_hz:=500.0",
    )
    twin = suite.start("twin_node")
    bridge.wait_for_words("reading 127.0.0.1")
    twin.wait_for_words("predicting from")
    suite.spin_until(lambda: node.count_subscribers("main_shaft/angle") == 2, "the twin on the bridge's topic")
    suite.spin_until(lambda: node.count_publishers("balancing_torque/predicted"), "the twin's predictions")
    suite.spin_for(1.0)
    # The sample that stood there before may have come or not.
    angles.clear()
    torques.clear()

    def counted() -> dict[str, int]:
        return {entry.key: int(entry.value) for entry in told[-1].values}

    counts = (np.arange(SAMPLES) * 0.0838 / (2 * np.pi) * 2**20).astype(int) % 2**20
    loads = np.float32(10.0 * np.sin(np.arange(SAMPLES) * 0.0838))
    stop = threading.Event()

    def turn() -> None:
        for number in range(SAMPLES):
            # A PLC's cycle may come late, but never early.
            if stop.wait(1.0 / RATE_HZ):
                return
            words = ModbusTcpClient.convert_to_registers(int(counts[number]), kind.UINT32)
            words += ModbusTcpClient.convert_to_registers(float(loads[number]), kind.FLOAT32)
            plc.set(10, [*words, (65_300 + number) % 65_536])  # the counter goes over its end

    shaft = threading.Thread(target=turn)
    shaft.start()
    try:
        suite.spin_until(lambda: not shaft.is_alive(), "the PLC's program")
        suite.spin_until(lambda: told and counted()["received"] + counted()["missed"] >= SAMPLES, "every sample")
        # None for the first two; the sample that stood there may have come before the twin listened.
        suite.spin_until(lambda: len(predicted) >= len(angles) - 2, "every prediction")
    finally:
        stop.set()
    # A busy computer may ask too late for one: then it says so, and only then is one missing.
    missed = counted()["missed"]
    assert len(angles) == len(torques) == SAMPLES - missed and missed <= 0.05 * SAMPLES
    place = {int(count): number for number, count in enumerate(counts)}
    numbers = [place[round(m.position[0] * 2**20 / (2 * np.pi))] for m in angles]
    assert numbers == sorted(set(numbers))
    np.testing.assert_allclose([m.wrench.torque.z for m in torques], 0.5 * loads[numbers].astype(float), rtol=1e-12)
    stamps = np.array([m.header.stamp.sec * SECOND_NS + m.header.stamp.nanosec for m in angles])
    assert (np.diff(stamps) > 0).all()
    # The latest prediction is in the PLC.
    suite.spin_until(
        lambda: ModbusTcpClient.convert_from_registers(plc.words(40, 2), kind.FLOAT32) == np.float32(predicted[-1]),
        "the prediction in the PLC",
    )

    plc.close()
    bridge.wait_for_words("trying again every second")
    suite.spin_until(lambda: told[-1].level == DiagnosticStatus.ERROR, "diagnostics of the lost PLC")
    assert bridge.end() == 0 and "Traceback" not in bridge.words()


@pytest.mark.parametrize("text", ["4", "x:int16", "4:int8", "-1:int16", "70000:int16", "4:float32:2"])
def test_a_register_written_wrongly(text: str) -> None:
    with pytest.raises(SceneError, match=r"parameter .angle. is .*: write ADDRESS:TYPE"):
        Register.parse("angle", text)


def test_registers_too_far_apart_for_one_moment() -> None:
    values = {"angle": Register.parse("angle", "0:uint16"), "torque": Register.parse("torque", "200:float64")}
    with pytest.raises(SceneError, match="the registers span 204, more than the 125"):
        Registers(ModbusTcpClient("127.0.0.1"), "holding", values, 1, "big")


@pytest.mark.parametrize(
    ("kind", "length"), [("int16", 1), ("uint32", 2), ("float32", 2), ("float64", 4), ("uint64", 4)]
)
def test_lengths(kind: str, length: int) -> None:
    register = Register.parse("angle", f"7:{kind}")
    assert register is not None and (register.address, register.length) == (7, length)
