"""monitor_node learns a machine from its topics and raises an alarm that names the fault."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticArray

from tests.generators.faults import faulty
from tests.ros.suite import RELIABLE, Suite
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
