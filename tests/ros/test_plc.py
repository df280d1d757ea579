"""plc_node against pymodbus's own server: angle and torque in, predictions out, nothing lost at 100 Hz."""

from __future__ import annotations

import asyncio
import itertools
import socket
import struct
import threading
from collections import Counter
from collections.abc import Iterator

import numpy as np
import pytest

pytest.importorskip("pymodbus")

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from pymodbus.client import ModbusTcpClient
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from tests.ros.bridged import Bridged
from tests.ros.suite import PATIENCE_S, RELIABLE, SECOND_NS, Suite, wait_until
from tests.ros.test_live_topics import stamp_of
from textile_twin_core.errors import SceneError
from textile_twin_ros.plc_registers import BYTE_ORDERS, Register, Registers

RATE_HZ, SAMPLES = 100.0, 250


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
        assert self._started.wait(PATIENCE_S)
        self._program = ModbusTcpClient("127.0.0.1", port=self.port)
        wait_until(self._program.connect, "the server")

    def _serve(self) -> None:
        async def serve() -> None:
            registers = SimData(0, count=64, values=0, datatype=DataType.REGISTERS)
            self._server = ModbusTcpServer(SimDevice(1, [registers]), address=("127.0.0.1", self.port))
            self._loop.call_soon(self._started.set)
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
        asyncio.run_coroutine_threadsafe(self._server.shutdown(), self._loop).result(PATIENCE_S)
        self._thread.join(PATIENCE_S)


@pytest.fixture
def plc() -> Iterator[Plc]:
    server = Plc()
    yield server
    server.close()


@pytest.mark.slow
def test_a_machine_behind_a_plc(suite: Suite, plc: Plc) -> None:
    kind = ModbusTcpClient.DATATYPE
    node = suite.node()
    heard = Bridged(node, "plc_node: plc")
    angles, torques, predicted, states = heard.angles, heard.torques, heard.predicted, heard.states
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
        "timeout_s:=20.0",
    )
    twin = suite.start("twin_node")
    bridge.wait_for_words("reading 127.0.0.1")
    twin.wait_for_words("predicting from")
    suite.spin_until(lambda: node.count_subscribers("main_shaft/angle") == 2, "the twin on the bridge's topic")

    def counted() -> dict[str, int]:
        return {entry.key: int(entry.value) for entry in states[-1].values}

    def cycle(number: int) -> None:
        """The PLC's program: angle, torque and the counter of its samples, which goes over its end."""
        words = ModbusTcpClient.convert_to_registers(int(counts[number]), kind.UINT32)
        words += ModbusTcpClient.convert_to_registers(float(loads[number]), kind.FLOAT32)
        plc.set(10, [*words, (65_300 + number) % 65_536])

    counts = (np.arange(5000) * 0.0838 / (2 * np.pi) * 2**20).astype(int) % 2**20
    loads = np.float32(10.0 * np.sin(np.arange(5000) * 0.0838))

    def shown(number: int) -> bool:
        """Return whether the latest angle is that of a cycle."""
        return bool(angles) and round(angles[-1].position[0] * 2**20 / (2 * np.pi)) == counts[number]

    def all_here(cycles: int) -> bool:
        """Return whether every cycle and the sample before is accounted for, and the latest is complete."""
        latest = {stamp_of(heard[-1]) if heard else None for heard in (angles, torques, predicted)}
        accounted = bool(states) and counted()["received"] + counted()["missed"] == 1 + cycles
        return accounted and shown(cycles - 1) and len(latest) == 1

    first = 0
    while not predicted:  # until all have found each other
        cycle(first)
        first += 1
        suite.spin_for(1.0 / RATE_HZ)
    suite.spin_until(lambda: all_here(first), "the first samples")
    before = counted()
    for heard in (angles, torques, predicted):
        heard.clear()  # type: ignore[attr-defined]
    stop = threading.Event()

    def turn() -> None:
        for number in range(first, first + SAMPLES):
            # A PLC's cycle may come late, but never early.
            if stop.wait(1.0 / RATE_HZ):
                return
            cycle(number)

    shaft = threading.Thread(target=turn)
    shaft.start()
    try:
        suite.spin_until(lambda: not shaft.is_alive(), "the PLC's program")
        suite.spin_until(lambda: all_here(first + SAMPLES), "every sample")
    finally:
        stop.set()
    # A busy computer may ask too late for one: then it says so, and only then is one missing.
    missed = counted()["missed"] - before["missed"]
    assert len(angles) == len(torques) == SAMPLES - missed and counted()["failures"] == 0
    # A program that waits for each of its samples misses none.
    end = first + SAMPLES + 50
    for number in range(first + SAMPLES, end):
        cycle(number)
        suite.spin_until(lambda number=number: shown(number), f"sample {number}")
    suite.spin_until(lambda: all_here(end), "every sample of it")
    assert counted()["missed"] - before["missed"] == missed and len(angles) == SAMPLES - missed + 50
    place = {int(counts[number]): number for number in range(first, end)}
    numbers = [place[round(m.position[0] * 2**20 / (2 * np.pi))] for m in angles]
    assert numbers == sorted(set(numbers))
    np.testing.assert_allclose([m.wrench.torque.z for m in torques], 0.5 * loads[numbers].astype(float), rtol=1e-12)
    stamps = np.array([m.header.stamp.sec * SECOND_NS + m.header.stamp.nanosec for m in angles])
    assert (np.diff(stamps) > 0).all()
    given = [m.header.stamp.sec * SECOND_NS + m.header.stamp.nanosec for m in predicted]
    assert given == sorted(set(given)) == stamps.tolist()
    # The latest prediction is in the PLC.
    suite.spin_until(
        lambda: (
            ModbusTcpClient.convert_from_registers(plc.words(40, 2), kind.FLOAT32)
            == np.float32(predicted[-1].wrench.torque.z)
        ),
        "the prediction in the PLC",
    )

    plc.close()
    bridge.wait_for_words("trying again every second")
    suite.spin_until(lambda: states[-1].level == DiagnosticStatus.ERROR, "diagnostics of the lost PLC")
    assert bridge.end() == 0 and "Traceback" not in bridge.words()


def test_a_plc_that_refuses_predictions_and_restarts_gives_angles_all_the_same(suite: Suite, plc: Plc) -> None:
    """It has no register 200; its program, started once more, counts its samples from one on."""
    plc.set(14, [499])
    heard = Bridged(suite.node(), "plc_node: plc")
    words = ["sequence:=14:uint16", "predicted:=200:float32", "rate_hz:=200.0", "timeout_s:=20.0"]
    bridge = suite.start("plc_node", "host:=127.0.0.1", f"port:={plc.port}", "angle:=10:uint32", *words)
    bridge.wait_for_words("reading 127.0.0.1")
    twin = suite.node().create_publisher(WrenchStamped, "balancing_torque/predicted", RELIABLE)
    suite.spin_until(lambda: twin.get_subscription_count() == 2, "the bridge on predictions")
    given = [499]

    def give(number: int) -> None:
        """A sample whose angle is its number, and a prediction."""
        given.append(number)
        plc.set(10, [0, number, 0, 0, number])
        twin.publish(WrenchStamped())

    def shown() -> list[int]:
        return [round(message.position[0] * 65536 / (2 * np.pi)) for message in heard.angles]

    def wait_for_it() -> None:
        suite.spin_until(lambda: shown()[-1] == given[-1], f"sample {given[-1]}")

    while not heard.angles:  # until the bridge knows that it is heard
        give(given[-1] + 1)
        suite.spin_for(0.05)
    wait_for_it()
    both = [*range(given[-1] + 1, given[-1] + 61), *range(1, 60)]
    for number in both:
        give(number)
        wait_for_it()
    bridge.wait_for_words("the PLC does not take register 200")

    def counted() -> dict[str, int]:
        return {entry.key: int(entry.value) for entry in heard.states[-1].values} if heard.states else Counter()

    suite.spin_until(
        lambda: counted()["received"] + counted()["missed"] == len(given), "every sample in the diagnostics"
    )
    suite.spin_until(lambda: "does not take" in heard.states[-1].message, "the refusal in the diagnostics")
    assert heard.states[-1].level == DiagnosticStatus.WARN
    assert counted()["failures"] == 0
    assert shown()[-len(both) :] == both
    assert bridge.end() == 0


@pytest.mark.parametrize("text", ["4", "x:int16", "4:int8", "-1:int16", "70000:int16", "4:float32:2"])
def test_a_register_written_wrongly(text: str) -> None:
    with pytest.raises(SceneError, match=r"parameter .angle. is .*: write ADDRESS:TYPE"):
        Register.parse("angle", text)


@pytest.mark.parametrize(
    ("kind", "value", "stored"),
    [
        ("int16", 12.7, 13),
        ("int16", -40_000.0, -32_768),
        ("uint16", -0.6, 0),
        ("uint64", 1e300, 2**64 - 1),
        ("float32", 0.1, np.float32(0.1)),
        ("float32", 1e300, np.finfo(np.float32).max),
        ("float64", -1e300, -1e300),
    ],
)
def test_a_prediction_goes_into_a_register_of_any_type(plc: Plc, kind: str, value: float, stored: float) -> None:
    client = ModbusTcpClient("127.0.0.1", port=plc.port)
    assert client.connect()
    register = Register.parse("predicted", f"40:{kind}")
    assert register is not None
    registers = Registers(client, "holding", {"predicted": register}, 1, "CDAB")
    registers.write(register, value)
    assert registers.read()["predicted"] == stored
    client.close()


@pytest.mark.parametrize("order", BYTE_ORDERS)
@pytest.mark.parametrize(
    ("kind", "code", "value"),
    [("float32", ">f", -12.5), ("int32", ">i", -70_000), ("float64", ">d", 1.1), ("uint16", ">H", 1)],
)
def test_values_in_every_byte_order(plc: Plc, order: str, kind: str, code: str, value: float) -> None:
    """Bytes A to D are the highest to the lowest; longer values continue the pattern of their registers."""
    words = list(struct.unpack(f">{struct.calcsize(code) // 2}H", struct.pack(code, value)))
    if order in ("CDAB", "DCBA"):
        words.reverse()
    if order in ("BADC", "DCBA"):
        words = [int.from_bytes(word.to_bytes(2, "big"), "little") for word in words]
    plc.set(20, words)
    client = ModbusTcpClient("127.0.0.1", port=plc.port)
    assert client.connect()
    register = Register.parse("torque", f"20:{kind}")
    assert register is not None
    registers = Registers(client, "holding", {"torque": register}, 1, order)
    assert registers.read()["torque"] == value
    registers.write(register, value)
    assert plc.words(20, len(words)) == words
    client.close()


@pytest.mark.slow
def test_a_counter_continues_and_values_in_a_wrong_byte_order_are_not_published(suite: Suite, plc: Plc) -> None:
    """An encoder of 4000 counts a turn in 16 bits, which are no number of turns, beside a torque in the order ABCD."""
    heard = Bridged(suite.node(), "plc_node: plc")
    torque = ModbusTcpClient.convert_to_registers(10.0, ModbusTcpClient.DATATYPE.FLOAT32)
    counts, sequence = np.arange(64_000, 64_000 + 8 * 900, 900), itertools.count()

    def cycle(number: int) -> None:
        plc.set(10, [int(counts[number]) % 65_536, next(sequence), *torque])

    def angles() -> list[float]:
        return list(dict.fromkeys(message.position[0] for message in heard.angles))

    cycle(0)
    words = ("angle:=10:uint16", f"angle_unit_rad:={2.0 * np.pi / 4000}", "torque:=12:float32", "sequence:=11:uint16")
    place = ("host:=127.0.0.1", f"port:={plc.port}", "rate_hz:=200.0", "timeout_s:=20.0")
    bridge = suite.start("plc_node", *place, *words, "byte_order:=CDAB")
    suite.spin_until(lambda: heard.angles or cycle(0), "the first angle")  # repeated until the topic is matched
    for number in range(1, counts.size):
        cycle(number)
        suite.spin_until(lambda number=number: len(angles()) > number, f"angle {number}")
    given = angles()
    np.testing.assert_allclose(np.diff(given), 900 * 2.0 * np.pi / 4000, rtol=1e-9)
    suite.spin_until(lambda: any(s.level == DiagnosticStatus.ERROR for s in heard.states), "the status")
    worst = next(status for status in heard.states if status.level == DiagnosticStatus.ERROR)
    assert "byte_order" in worst.message and "torque" in worst.message and not heard.torques
    assert bridge.end() == 0 and "byte_order" in bridge.words()


def test_registers_too_far_apart_for_one_moment() -> None:
    values = {"angle": Register.parse("angle", "0:uint16"), "torque": Register.parse("torque", "200:float64")}
    with pytest.raises(SceneError, match="the registers span 204, more than the 125"):
        Registers(ModbusTcpClient("127.0.0.1"), "holding", values, 1)


@pytest.mark.parametrize(
    ("kind", "length"), [("int16", 1), ("uint32", 2), ("float32", 2), ("float64", 4), ("uint64", 4)]
)
def test_lengths(kind: str, length: int) -> None:
    register = Register.parse("angle", f"7:{kind}")
    assert register is not None and (register.address, register.length) == (7, length)
