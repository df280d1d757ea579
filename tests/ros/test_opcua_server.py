"""opcua_server_node against asyncua's own client: every value, Machinery's nodes, alarms acknowledged from outside."""

from __future__ import annotations

import asyncio
import threading
from collections import Counter, defaultdict, deque
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("asyncua")

from asyncua import ua
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState

from tests.recordings.test_fault_book import FRICTION, NEEDLE
from tests.ros.suite import PATIENCE_S, RELIABLE, SECOND_NS, Suite, wait_until
from tests.ros.test_opcua import free_port
from tests.ros.test_opcua_security import Keys, connected
from tests.ros.test_opcua_security import keys as keys
from textile_twin_core.recordings.fault_book import FaultBook
from textile_twin_ros.opcua_server_node import VARIABLES, OpcuaServerNode

RATE_HZ, SAMPLES = 100.0, 250
START_NS = 1_930_000_000 * SECOND_NS
MACHINERY, DI = "http://opcfoundation.org/UA/Machinery/", "http://opcfoundation.org/UA/DI/"


class Outside:
    """asyncua's own client in a thread of its own: subscribed to everything, encrypted."""

    def __init__(self, url: str, keys: Keys) -> None:
        self.values: dict[str, list[ua.DataValue]] = defaultdict(list)
        self.events: list[Any] = []
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever)
        self._thread.start()
        self.client = self.call(connected(url, keys))

    def call(self, work: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(PATIENCE_S)

    def close(self) -> None:
        self.call(self.client.disconnect())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(PATIENCE_S)

    async def subscribe(self, machine: str) -> None:
        own = await self.client.get_namespace_index("urn:textile-twin:machine")
        self.subscription = await self.client.create_subscription(50.0, self)
        for name in VARIABLES:
            node = self.client.get_node(ua.NodeId(f"{machine}.{name}", own))
            await self.subscription.subscribe_data_change(node, queuesize=1000, sampling_interval=0.0)
        kind = ua.ObjectIds.AlarmConditionType
        await self.subscription.subscribe_alarms_and_conditions(ua.ObjectIds.Server, kind)

    def datachange_notification(self, node: Any, _value: Any, data: Any) -> None:
        self.values[node.nodeid.Identifier.rpartition(".")[2]].append(data.monitored_item.Value)

    def event_notification(self, event: Any) -> None:
        self.events.append(event)

    async def read(self, *path: str) -> Any:
        """The value of a variable below Objects, by a path of NAMESPACE:NAME."""
        spaces = {"M": MACHINERY, "DI": DI, "own": "urn:textile-twin:machine"}
        names = []
        for text in path:
            space, name = text.split(":")
            index = await self.client.get_namespace_index(spaces[space]) if space in spaces else 0
            names.append(ua.QualifiedName(name, index))
        return await (await self.client.nodes.objects.get_child(names)).read_value()


def started(suite: Suite, keys: Keys, *parameters: str) -> str:
    url = f"opc.tcp://127.0.0.1:{free_port()}"
    own = [f"{name}:={value}" for name, value in keys.of_server().items()]
    node = suite.start("opcua_server_node", f"url:={url}", "name:=loom_3", *own, *parameters)
    node.wait_for_words("serving loom_3")
    return url


def reach_an_encrypted_client(suite: Suite, keys: Keys, samples: int) -> None:
    """Publish a number of samples of all topics at 100 Hz: each value arrives once, in its order, with its stamp."""
    outside = Outside(started(suite, keys, "no_data_timeout_s:=1.0"), keys)
    try:
        outside.call(outside.subscribe("loom_3"))
        node = suite.node()
        joints = node.create_publisher(JointState, "joint_states", RELIABLE)
        topics = ("balancing_torque/predicted", "balancing_torque/measured", "balancing_torque/residual")
        torques = [node.create_publisher(WrenchStamped, topic, RELIABLE) for topic in topics]
        for publisher in (joints, *torques):
            suite.spin_until(publisher.get_subscription_count, "the server node")
        assert outside.call(outside.read("M:Machines", "own:loom_3", *STATE)).Text == "NotAvailable"
        for number in range(samples):
            joint, wrench = JointState(), WrenchStamped()
            stamp = START_NS + number * round(SECOND_NS / RATE_HZ)
            joint.header.stamp.sec, joint.header.stamp.nanosec = divmod(stamp, SECOND_NS)
            joint.name, joint.position, joint.velocity = ["main_shaft"], [0.1 * number], [16.0 + 0.25 * number]
            wrench.header.stamp = joint.header.stamp
            joints.publish(joint)
            for which, publisher in enumerate(torques):
                wrench.wrench.torque.z = number + 0.25 * which
                publisher.publish(wrench)
            suite.spin_for(1.0 / RATE_HZ)
        suite.spin_until(lambda: len(good(outside, "TorqueResidual")) == samples, "the last value")
        assert outside.call(outside.read("M:Machines", "own:loom_3", *STATE)).Text == "Executing"
        for name, value_of in VALUES.items():
            values = good(outside, name)
            assert len(values) == samples
            np.testing.assert_array_equal([each.Value.Value for each in values], value_of(np.arange(samples)))
            stamps = [round(each.SourceTimestamp.timestamp() * 1e3) for each in values]
            assert stamps == [START_NS // 1_000_000 + 10 * number for number in range(samples)]
        # Nothing comes any more: the values say that they are old, and the state that nothing is known.
        suite.spin_until(lambda: not outside.values["ShaftAngle"][-1].StatusCode.is_good(), "a status")
        assert outside.values["ShaftAngle"][-1].StatusCode.name == "UncertainLastUsableValue"
        assert outside.call(outside.read("M:Machines", "own:loom_3", *STATE)).Text == "NotAvailable"
    finally:
        outside.close()


@pytest.mark.slow
def test_every_value_reaches_an_encrypted_client_once(suite: Suite, keys: Keys) -> None:
    reach_an_encrypted_client(suite, keys, SAMPLES)


STATE = ("M:MachineryBuildingBlocks", "M:MachineryItemState", "0:CurrentState")
VALUES: dict[str, Any] = {
    "ShaftAngle": lambda number: 0.1 * number,
    "ShaftSpeed": lambda number: 16.0 + 0.25 * number,
    "PredictedTorque": lambda number: number + 0.0,
    "MeasuredTorque": lambda number: number + 0.25,
    "TorqueResidual": lambda number: number + 0.5,
}


def good(outside: Outside, name: str) -> list[ua.DataValue]:
    return [value for value in outside.values[name] if value.StatusCode.is_good()]


@pytest.mark.slow
def test_a_machine_of_opc_40001_and_its_alarms(suite: Suite, keys: Keys, tmp_path: Path) -> None:
    book = FaultBook(tmp_path / "book", create=True)
    plate = ("manufacturer:='Loom Works'", "serial_number:='4711'", "location:='hall 2'")
    outside = Outside(started(suite, keys, f"book:={book.folder}", *plate), keys)
    try:
        outside.call(look_at_machinery(outside))
        outside.call(outside.subscribe("loom_3"))
        book.update("/", "tufting", [FRICTION], [FRICTION])
        wait_until(lambda: outside.events, "the alarm")
        raised = outside.events[-1]
        assert (raised.Message.Text, raised.Severity) == (FRICTION.text, 700)
        assert getattr(raised, "ActiveState/Id") and not getattr(raised, "AckedState/Id") and raised.Retain
        book.update("/", "tufting", [NEEDLE], [FRICTION, NEEDLE])
        wait_until(lambda: len(outside.events) == 2, "the other alarm")

        async def acknowledge(event: Any, event_id: bytes) -> None:
            method = ua.NodeId(ua.ObjectIds.AcknowledgeableConditionType_Acknowledge)
            words = ua.Variant(event_id), ua.Variant(ua.LocalizedText("belt changed"))
            await outside.client.get_node(event.NodeId).call_method(method, *words)

        with pytest.raises(ua.uaerrors.BadEventIdUnknown):
            outside.call(acknowledge(raised, b"fault 99"))
        outside.call(acknowledge(raised, raised.EventId))
        with pytest.raises(ua.uaerrors.BadConditionBranchAlreadyAcked):
            outside.call(acknowledge(raised, raised.EventId))
        friction, needle = book.faults()
        assert friction.acknowledged_by == "OPC UA: belt changed" and needle.acknowledged_ns is None
        wait_until(lambda: len(outside.events) == 3, "the acknowledgement")
        assert getattr(outside.events[-1], "AckedState/Id") and outside.events[-1].Comment.Text.endswith("belt changed")
        book.update("/", "tufting", [], [NEEDLE])
        wait_until(lambda: len(outside.events) == 4, "the end of the fault")
        assert not getattr(outside.events[-1], "ActiveState/Id") and not outside.events[-1].Retain
        assert outside.call(outside.read("M:Machines", "own:loom_3", "own:Faults", "own:Standing")) == 1
        assert outside.call(outside.read("M:Machines", "own:loom_3", "own:Faults", "own:NotAcknowledged")) == 1
        shown = ("own:Faults", "own:load_force", "0:ActiveState", "0:Id")
        assert outside.call(outside.read("M:Machines", "own:loom_3", *shown)) is True
        with pytest.raises(ua.UaError):  # variables are read-only from outside
            outside.call(outside.client.get_node("ns=2;s=loom_3.ShaftAngle").write_value(1.0))
    finally:
        outside.close()


async def look_at_machinery(outside: Outside) -> None:
    """Ids, names and types of OPC 40001-1, from the published nodesets (Machinery 1.03, DI 1.04)."""
    client = outside.client
    m, di = await client.get_namespace_index(MACHINERY), await client.get_namespace_index(DI)
    machines = client.get_node(ua.NodeId(1001, m))
    assert (await machines.read_browse_name()) == ua.QualifiedName("Machines", m)
    (machine,) = await machines.get_children()
    identification = await machine.get_child(ua.QualifiedName("Identification", di))
    assert await identification.read_type_definition() == ua.NodeId(1012, m)
    for name, space, value in (
        ("Manufacturer", di, ua.LocalizedText("Loom Works")),
        ("SerialNumber", di, "4711"),
        ("ProductInstanceUri", di, "urn:textile-twin:loom_3:4711"),
        ("Location", m, "hall 2"),
    ):
        assert await (await identification.get_child(ua.QualifiedName(name, space))).read_value() == value
    blocks = await machine.get_child(ua.QualifiedName("MachineryBuildingBlocks", m))
    state = await blocks.get_child(ua.QualifiedName("MachineryItemState", m))
    assert await state.read_type_definition() == ua.NodeId(1002, m)
    reference = ua.NodeId(ua.ObjectIds.HasAddIn)
    added = {each.nodeid for each in await blocks.get_referenced_nodes(reference)}
    assert added == {identification.nodeid, state.nodeid}
    current = await state.get_child("0:CurrentState")
    assert await (await current.get_child("0:Id")).read_value() == ua.NodeId(5005, m)
    numbers = {}
    for node in (5004, 5005, 5006, 5007):
        each = client.get_node(ua.NodeId(node, m))
        number = await (await each.get_child("0:StateNumber")).read_value()
        numbers[(await each.read_browse_name()).Name] = number
    assert numbers == {"NotAvailable": 0, "OutOfService": 1, "NotExecuting": 2, "Executing": 3}
    speed = await machine.get_child(ua.QualifiedName("ShaftSpeed", machine.nodeid.NamespaceIndex))
    unit = await (await speed.get_child("0:EngineeringUnits")).read_value()
    assert unit.UnitId == 12865 and await speed.read_type_definition() == ua.NodeId(ua.ObjectIds.AnalogUnitType)


def test_clients_are_served_where_values_come_faster_than_they_are_written() -> None:
    """A server whose writing never waits, and a value that comes with each written one."""
    node = OpcuaServerNode.__new__(OpcuaServerNode)
    node._values, node.counts = deque(maxlen=300), Counter(values=0, dropped=0)
    node._stop, node._last_s = threading.Event(), 0.0
    node.settings = SimpleNamespace(no_data_timeout_s=0.0)  # type: ignore[assignment]
    served: list[int] = []

    class Written:
        async def write_attribute_value(self, _node_id: Any, _value: ua.DataValue) -> None:
            node._put("ShaftAngle", START_NS, 1.0)
            assert node.counts["values"] < 10_000, "no client is ever served"

    async def client() -> None:
        while len(served) < 10:
            served.append(node.counts["values"])
            await asyncio.sleep(0.0)
        node._stop.set()

    async def both() -> None:
        space = SimpleNamespace(variables={"ShaftAngle": SimpleNamespace(nodeid="angle")})
        await asyncio.gather(node._feed(Written(), space, None), client())  # type: ignore[arg-type]

    node._put("ShaftAngle", START_NS, 1.0)
    asyncio.run(both())
    assert len(served) == 10 and node.counts["dropped"] == 0
    node._values.clear()
    for _ in range(301):
        node._put("ShaftAngle", START_NS, 1.0)
    assert len(node._values) == 300 and node.counts["dropped"] == 1
