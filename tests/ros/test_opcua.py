"""opcua_node against asyncua's own server: angle and torque in, predictions out, nothing lost at 100 Hz."""

from __future__ import annotations

import asyncio
import itertools
import socket
import threading
from collections.abc import Awaitable, Callable, Coroutine, Iterator, Sequence
from concurrent.futures import Future
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("asyncua")

from asyncua import Client, Server, ua
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped

from tests.campaign import more
from tests.ros.bridged import Bridged
from tests.ros.suite import PATIENCE_S, RELIABLE, SECOND_NS, Suite
from tests.ros.test_live_topics import stamp_of
from textile_twin_ros.opcua_values import Value, Values
from textile_twin_ros.plc_registers import counter_of

RATE_HZ, SAMPLES = 100.0, 250
START = datetime(2031, 3, 1, 12, 0, 0, tzinfo=UTC)
VARIABLES = {
    "Angle": 0.0,
    "Load": 0.0,
    "Predicted": ua.Variant(0.0, ua.VariantType.Float),
    "Byte": ua.Variant(0, ua.VariantType.Byte),
    "Short": ua.Variant(0, ua.VariantType.Int16),
}


def free_port(port: int = 0) -> int:
    """A closed port of this computer."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind(("127.0.0.1", port))
        return int(probe.getsockname()[1])


class Plc:
    """asyncua's server in a thread of its own, on a port of its own."""

    def __init__(
        self,
        port: int = 0,
        secure: Callable[[Server], Awaitable[None]] | None = None,
        namespaces_before: Sequence[str] = (),
    ) -> None:
        self.port, self._secure, self._before = free_port(port), secure, namespaces_before
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever)
        self._thread.start()
        self.call(self._start())

    def begin(self, work: Coroutine[Any, Any, Any]) -> Future[Any]:
        """Run a task in the server's thread; return its future."""
        return asyncio.run_coroutine_threadsafe(work, self._loop)

    def call(self, work: Coroutine[Any, Any, Any]) -> Any:
        """Run a task in the server's thread and wait for its result."""
        return self.begin(work).result(PATIENCE_S)

    async def _start(self) -> None:
        self.server = Server()
        await self.server.init()
        self.server.set_endpoint(f"opc.tcp://127.0.0.1:{self.port}")
        if self._secure is not None:
            await self._secure(self.server)
        for name in self._before:
            await self.server.register_namespace(name)
        space = await self.server.register_namespace("loom")
        self.nodes = {}
        for name, value in VARIABLES.items():
            node = await self.server.nodes.objects.add_variable(ua.NodeId(name, space), name, value)
            await node.set_writable()
            self.nodes[name] = node
        await self.server.start()

    async def cycle(self, number: int) -> None:
        """One cycle of the PLC's program: angle and torque, with its time."""
        stamp = START + timedelta(seconds=number / RATE_HZ)
        for name, value in (("Angle", angle(number)), ("Load", load(number))):
            await self.nodes[name].write_value(ua.DataValue(ua.Variant(value), SourceTimestamp=stamp))

    async def _end(self) -> None:
        await self.server.stop()
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    def close(self) -> None:
        """End the server, once."""
        if self._thread.is_alive():
            self.call(self._end())
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join(PATIENCE_S)


def angle(number: int) -> float:
    """Angle in tenths of a degree; it stands still for a while."""
    return float(np.float32(48.0 * (number if number < 150 else max(150, number - 50)) % 3600.0))


def load(number: int) -> float:
    """Load in amperes."""
    return 10.0 + 3.0 * float(np.sin(0.1 * number))


@pytest.fixture
def plc() -> Iterator[Plc]:
    server = Plc()
    yield server
    server.close()


@pytest.mark.slow
def test_a_machine_behind_an_opc_ua_server(suite: Suite, plc: Plc) -> None:
    node = suite.node()
    heard = Bridged(node, "opcua_node: plc")
    angles, torques, predicted, states = heard.angles, heard.torques, heard.predicted, heard.states
    bridge = suite.start(
        "opcua_node",
        f"url:=opc.tcp://127.0.0.1:{plc.port}",
        "angle:='ns=2;s=Angle'",
        f"angle_unit_rad:={np.deg2rad(0.1)}",
        "torque:='ns=2;s=Load'",
        "torque_unit_Nm:=0.5",
        "predicted:='ns=2;s=Predicted'",
        "timeout_s:=20.0",
        "allow_insecure:=true",
    )
    twin = suite.start("twin_node", "wait_for:=[balancing_torque/predicted]")
    bridge.wait_for_words("reading opc.tcp")
    twin.wait_for_words("predicting from")
    first = round(START.timestamp()) * SECOND_NS

    def all_here(number: int) -> bool:
        """Return whether this sample has come, with its torque and its prediction."""
        stamp = first + number * round(SECOND_NS / RATE_HZ)
        return all(heard and stamp_of(heard[-1]) == stamp for heard in (angles, torques, predicted))

    before = -3600 * round(RATE_HZ)
    while not predicted or not torques:  # until all have found each other
        before += 1
        plc.call(plc.cycle(before))
        suite.spin_for(1.0 / RATE_HZ)
    suite.spin_until(lambda: all_here(before), "the samples before")
    for heard in (angles, torques, predicted):
        heard.clear()  # type: ignore[attr-defined]

    async def turn() -> None:
        for number in range(SAMPLES):
            await plc.cycle(number)
            await asyncio.sleep(1.0 / RATE_HZ)

    shaft = plc.begin(turn())
    suite.spin_until(shaft.done, "the PLC's program")
    suite.spin_until(lambda: all_here(SAMPLES - 1), "every sample")
    expected = [first + number * round(SECOND_NS / RATE_HZ) for number in range(SAMPLES)]
    assert [stamp_of(message) for message in angles] == expected
    assert [stamp_of(message) for message in torques] == expected
    given = [np.deg2rad(0.1) * angle(number) for number in range(SAMPLES)]
    np.testing.assert_allclose([message.position[0] for message in angles], given, rtol=1e-12)
    measured = [message.wrench.torque.z for message in torques]
    np.testing.assert_allclose(measured, [0.5 * load(number) for number in range(SAMPLES)], rtol=1e-12)
    # The first samples give no prediction, nor do some where it stops at once; all others go out once.
    assert [stamp_of(message) for message in predicted][-100:] == expected[-100:]
    latest = predicted[-1].wrench.torque.z
    suite.spin_until(
        lambda: plc.call(plc.nodes["Predicted"].read_value()) == pytest.approx(latest, abs=1e-5), "the prediction there"
    )
    states.clear()
    suite.spin_until(lambda: states, "diagnostics")
    assert states[-1].level == DiagnosticStatus.OK, states[-1].message

    plc.close()
    bridge.wait_for_words("trying again every second")
    again = Plc(plc.port)
    try:
        angles.clear()
        suite.spin_until(lambda: "reading opc.tcp" in bridge.words().split("trying again")[-1], "the server again")
        again.call(again.cycle(1000))
        suite.spin_until(lambda: any(stamp_of(message) > expected[-1] for message in angles), "an angle")
    finally:
        again.close()
    assert "Traceback" not in bridge.words() and bridge.end() == 0


@pytest.mark.slow
def test_a_namespace_by_its_uri_and_values_without_a_source_time(suite: Suite, plc: Plc) -> None:
    """The server numbers its namespaces otherwise after its restart, and its PLC gives no times."""
    heard = Bridged(suite.node(), "opcua_node: plc")
    words = (f"url:=opc.tcp://127.0.0.1:{plc.port}", "angle:='nsu=loom;s=Angle'", "allow_insecure:=true")
    bridge = suite.start("opcua_node", *words)
    numbers = itertools.count()

    def heard_from(server: Plc, before: int) -> bool:
        server.call(server.cycle(next(numbers)))
        return len(heard.angles) > before

    suite.spin_until(lambda: heard_from(plc, 0), "the first angle")
    plc.close()
    later = Plc(plc.port, namespaces_before=("urn:first", "urn:second"))
    try:
        before = len(heard.angles)
        suite.spin_until(lambda: heard_from(later, before), "an angle of the restarted server")
        later.call(later.nodes["Angle"].write_value(ua.DataValue(ua.Variant(7.5), SourceTimestamp=None)))
        there = later.call(later.nodes["Angle"].read_data_value(raise_on_bad_status=False))
        suite.spin_until(lambda: heard.angles[-1].position[0] == 7.5, "the angle without a source time")
        suite.spin_until(lambda: "without a source time" in heard.states[-1].message, "the warning")
        assert heard.states[-1].level == DiagnosticStatus.WARN and "stamps:=arrival" in heard.states[-1].message
        assert "stamps are the server's" in heard.states[-1].message and there.SourceTimestamp is None
        since = there.ServerTimestamp.replace(tzinfo=UTC) - datetime(1970, 1, 1, tzinfo=UTC)
        assert stamp_of(heard.angles[-1]) == since // timedelta(microseconds=1) * 1000
        assert bridge.end() == 0
        other = suite.start("opcua_node", words[0], "angle:='nsu=urn:loom:7;s=Angle'", "allow_insecure:=true")
        other.wait_for_words("the server has no namespace urn:loom:7; available")
        assert other.end() == 0
    finally:
        later.close()


@pytest.mark.slow
def test_a_variable_that_goes_is_looked_up_again(suite: Suite, plc: Plc) -> None:
    """A PLC that loads another program says so of its variables, while the connection stays."""
    heard = Bridged(suite.node(), "opcua_node: plc")
    words = (f"url:=opc.tcp://127.0.0.1:{plc.port}", "angle:='nsu=loom;s=Angle'", "allow_insecure:=true")
    bridge = suite.start("opcua_node", *words)
    numbers = itertools.count()

    def heard_more(before: int) -> bool:
        plc.call(plc.cycle(next(numbers)))
        return len(heard.angles) > before

    suite.spin_until(lambda: heard_more(0), "the first angle")
    gone = ua.DataValue(ua.Variant(0.0), StatusCode=ua.StatusCode(ua.StatusCodes.BadNodeIdUnknown))
    plc.call(plc.nodes["Angle"].write_value(gone))
    bridge.wait_for_words("BadNodeIdUnknown")
    before = len(heard.angles)
    suite.spin_until(lambda: heard_more(before), "an angle of the new variable")
    assert bridge.end() == 0


@pytest.mark.parametrize(
    ("kind", "counts", "expected"),
    [
        (ua.VariantType.UInt16, [65_000, 500], [65_000, 66_036]),
        (ua.VariantType.Int16, [-32_000, 32_000], [-32_000, -33_536]),
        (ua.VariantType.UInt32, [4_294_967_000, 200], [4_294_967_000, 4_294_967_496]),
        (ua.VariantType.Int32, [-5, 5], [-5, 5]),
    ],
)
def test_a_counter_continues_over_its_end(kind: ua.VariantType, counts: list[int], expected: list[int]) -> None:
    values: list[Value] = []
    known = Values.__new__(Values)
    node = SimpleNamespace(nodeid="angle")
    known._takers = {"angle": values.append}
    for count in counts:
        change = SimpleNamespace(monitored_item=SimpleNamespace(Value=ua.DataValue(ua.Variant(count, kind))))
        known.datachange_notification(node, count, change)
    counter = counter_of(values[0].counter_width, 2.0 * np.pi / 4000)
    assert counter is not None and [counter.step(value.number) for value in values] == expected
    assert counter_of(values[0].counter_width, 2.0 * np.pi / 4096) is None  # a number of turns


@pytest.mark.parametrize("none", [None, datetime(1601, 1, 1), datetime(1601, 1, 1, tzinfo=UTC), datetime(2038, 1, 20)])
def test_a_time_that_is_none_gives_way_to_the_servers(none: datetime | None) -> None:
    """OPC UA writes the lack of a time as 0, which is 1601, and a stamp of ROS ends in 2038."""
    values: list[Value] = []
    known = Values.__new__(Values)
    known._takers = {"angle": values.append}
    served = datetime(2026, 5, 4, 3, 2, 1, 5000)
    for by_server in (served, none):
        shown = ua.DataValue(ua.Variant(1.5), SourceTimestamp=none, ServerTimestamp=by_server)
        change = SimpleNamespace(monitored_item=SimpleNamespace(Value=shown))
        known.datachange_notification(SimpleNamespace(nodeid="angle"), 1.5, change)
    expected = int(np.datetime64(served, "ns").astype(np.int64))
    assert [(value.stamp_ns, value.clock) for value in values] == [(expected, "server"), (None, "")]


@pytest.mark.campaign
def test_a_variable_that_is_not_there(suite: Suite, plc: Plc) -> None:
    program = suite.start(
        "opcua_node", f"url:=opc.tcp://127.0.0.1:{plc.port}", "angle:='ns=2;s=Angel'", "allow_insecure:=true"
    )
    program.wait_for_words("angle, ns=2;s=Angel: BadNodeIdUnknown; trying again every second")
    assert program.end() == 0


@pytest.mark.campaign
@pytest.mark.slow
def test_a_server_that_refuses_predictions_gives_angles_all_the_same(suite: Suite, plc: Plc) -> None:
    """Clients cannot write the server's own level of service."""
    heard = Bridged(suite.node(), "opcua_node: plc")
    words = ["angle:='ns=2;s=Angle'", "predicted:='i=2267'", "timeout_s:=20.0", "allow_insecure:=true"]
    bridge = suite.start("opcua_node", f"url:=opc.tcp://127.0.0.1:{plc.port}", *words)
    bridge.wait_for_words("reading opc.tcp")
    twin = suite.node().create_publisher(WrenchStamped, "balancing_torque/predicted", RELIABLE)
    suite.spin_until(lambda: twin.get_subscription_count() == 2, "the bridge on predictions")
    begin, given = round(START.timestamp()) * SECOND_NS, [0]

    def give() -> None:
        """The next sample, and a prediction."""
        given.append(given[-1] + 1)
        plc.call(plc.cycle(given[-1]))
        twin.publish(WrenchStamped())

    def shown() -> list[int]:
        return [(stamp_of(message) - begin) * round(RATE_HZ) // SECOND_NS for message in heard.angles]

    def wait_for_it() -> None:
        suite.spin_until(lambda: shown()[-1] == given[-1], f"sample {given[-1]}")

    while not heard.angles or shown()[-1] < 0:  # until the bridge knows that it is heard
        give()
        suite.spin_for(0.05)
    wait_for_it()
    for _ in range(100):
        give()
        wait_for_it()
    bridge.wait_for_words("the server does not take 'i=2267'")
    suite.spin_until(lambda: heard.states and "does not take" in heard.states[-1].message, "diagnostics")
    assert heard.states[-1].level == DiagnosticStatus.WARN
    assert {entry.key: entry.value for entry in heard.states[-1].values}["failures"] == "0"
    assert shown()[-100:] == given[-100:]
    assert bridge.end() == 0


@pytest.mark.parametrize(
    ("name", "number", "stored"),
    [
        ("Short", -1e9, -32_768),
        *more(("Short", 12.7, 13), ("Byte", -3.0, 0), ("Predicted", 1e300, np.finfo(np.float32).max)),
    ],
)
def test_a_prediction_goes_into_a_variable_of_any_type(plc: Plc, name: str, number: float, stored: float) -> None:
    async def write() -> Any:
        async with Client(f"opc.tcp://127.0.0.1:{plc.port}") as client:
            await Values(client, 10, 0.0).write(plc.nodes[name].nodeid, number)
            return await client.get_node(plc.nodes[name].nodeid).read_value()

    assert asyncio.run(write()) == stored
