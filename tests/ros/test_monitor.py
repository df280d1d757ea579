"""monitor_node learns a machine from its topics and raises an alarm that names the fault."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState

from tests.generators.faults import faulty
from tests.ros.suite import RELIABLE, Suite, shaft_angles
from tests.ros.test_live_topics import joint_state
from textile_twin_core.recordings import BagWriter


@pytest.mark.slow
def test_a_fault_is_on_the_diagnostics(suite: Suite) -> None:
    made = faulty("needle_force", 0.2, 985, duration_s=26.0, onset_s=18.0, rate=200.0).recording
    bag = suite.folder / "faulty"
    with BagWriter(bag) as out:
        out.write_joint_states("main_shaft/angle", made.angle_stamps_ns, ["main_shaft"], made.angle)
        out.write_wrenches("balancing_torque/measured", made.torque_stamps_ns, made.torque)
    trends = suite.folder / "trends"
    node = suite.start("monitor_node", "learn_turns:=40", f"parquet:={trends}", "rate_hz:=20000.0")
    listener = suite.node()
    told: list[str] = []

    def take(message: DiagnosticArray) -> None:
        told.extend(state.message for state in message.status if state.name == "monitor_node: faults")

    listener.create_subscription(DiagnosticArray, "/diagnostics", take, RELIABLE)
    waits = 'wait_for:=["main_shaft/angle", "balancing_torque/measured"]'
    replay = suite.start("replay_node", f"bag:={bag}", waits, "rate:=4.0")
    assert replay.wait() == 0, suite.words()
    suite.spin_until(lambda: any("needle side" in text for text in told), "an alarm")
    assert node.end() == 0, node.words()
    assert list(trends.glob("trend_*.parquet"))


def test_stamps_that_go_back_are_watched_on(suite: Suite) -> None:
    monitor = suite.start("monitor_node")
    node = suite.node()
    told: dict[str, str] = {}

    def take(message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == "monitor_node: main_shaft/angle":
                told.update({entry.key: entry.value for entry in status.values})

    node.create_subscription(DiagnosticArray, "/diagnostics", take, RELIABLE)
    publisher = node.create_publisher(JointState, "main_shaft/angle", RELIABLE)
    suite.spin_until(publisher.get_subscription_count, "the monitor")
    for _ in range(2):
        for stamp, angle in zip(*shaft_angles(1000), strict=True):
            publisher.publish(joint_state(stamp, angle))
    # Nine of the second time go until it is known that it has begun.
    suite.spin_until(lambda: told.get("set_back") == "1" and told["accepted"] == "991", "the second time")
    assert monitor.end() == 0, monitor.words()
