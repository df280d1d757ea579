"""Topics of a machine's recorder: its own and the shared ones, not those of another machine."""

from __future__ import annotations

import pytest

from textile_twin_core.recordings.schemas import JOINT_STATE, WRENCH
from textile_twin_ros.machine_namespace import PROCESS, MachineNamespace, published_by_twins

THERE = [
    "/diagnostics",
    "/main_shaft/angle",
    "/oil/temperature",
    "/twin_node/transition_event",
    "/machine_3/joint_states",
    "/machine_3/twin_node/transition_event",
    "/machine_3/oil/temperature",
    "/mill/m1/balancing_torque/measured",
    "/mill/m1/oil/temperature",
    "/mill/crane/position",
]


@pytest.mark.parametrize(
    ("namespace", "own"),
    [
        ("/", ["/diagnostics", "/main_shaft/angle", "/oil/temperature", "/twin_node/transition_event"]),
        ("/machine_3", ["/diagnostics", *(topic for topic in THERE if topic.startswith("/machine_3/"))]),
        ("/mill/m1", ["/diagnostics", *(topic for topic in THERE if topic.startswith("/mill/m1/"))]),
        ("/machine", ["/diagnostics"]),
    ],
)
def test_a_namespace_is_a_machine(namespace: str, own: list[str]) -> None:
    topics = MachineNamespace(namespace)
    topics.learn(THERE)
    # What is no machine's, such as a crane, is recorded where nothing says whose it is.
    elsewhere = ["/mill/crane/position"] if namespace == "/" else []
    assert [topic for topic in THERE if topics.has(topic)] == own + elsewhere


def test_a_known_name_is_reported_before_its_machine_has_shown_itself() -> None:
    assert not MachineNamespace("/").has("/machine_3/joint_states")
    assert MachineNamespace("/").has("/joint_states")


def test_diagnostics_are_distinguished_by_their_node() -> None:
    root, third = MachineNamespace("/"), MachineNamespace("/machine_3")
    assert root.speaks_of("twin_node: outputs") and not root.speaks_of("machine_3/twin_node: outputs")
    assert third.speaks_of("machine_3/twin_node: outputs") and not third.speaks_of("twin_node: outputs")
    assert not third.speaks_of("mill/machine_3/record_node: recording")
    assert third.speaks_of("drive: temperature") and root.speaks_of("plc/line 3: contactor")


def test_the_forces_that_a_monitor_publishes_are_not_played_beside_it() -> None:
    there = {"/m1/main_shaft/angle": JOINT_STATE, "/m1/balancing_torque/measured": WRENCH}
    process = {f"/m1/{name}": JOINT_STATE for name in PROCESS}
    assert published_by_twins(there | process) == set(process)
    assert published_by_twins(process) == set()
