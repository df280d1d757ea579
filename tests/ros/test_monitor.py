"""monitor_node learns a machine from its topics and raises an alarm that names the fault."""

from __future__ import annotations

import math
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState

from tests.generators.faults import faulty
from tests.ros.suite import RELIABLE, SECOND_NS, Suite, node_environment, shaft_angles
from tests.ros.test_live_topics import joint_state
from textile_twin_core.recordings import BagWriter
from textile_twin_ros.monitor_node import MonitorNode


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


def test_the_trend_is_written_meanwhile_and_what_does_not_go_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in node_environment(tmp_path, domain=101).items():
        monkeypatch.setenv(name, value)
    folder = tmp_path / "trends"
    rclpy.init(args=["test", "--ros-args", "-p", f"parquet:={folder}", "-p", "learn_turns:=20"])
    node = MonitorNode()
    try:
        for hour in (0, 1, 2):
            made = faulty("", 0.0, 985 + hour, duration_s=3.0, onset_s=1.0, rate=200.0).recording
            later = hour * 3600 * SECOND_NS
            angles = zip(made.angle_stamps_ns + later, made.angle, made.angle * math.nan, strict=True)
            node._angles.extend((int(stamp), float(angle), speed) for stamp, angle, speed in angles)
            torques = zip(made.torque_stamps_ns + later, made.torque, strict=True)
            node._torques.extend((int(stamp), float(torque), math.nan) for stamp, torque in torques)
            node._look()
            if hour == 1:  # the disk is away for an hour
                folder.rename(tmp_path / "away")
                folder.write_text("no folder")
            node._write_meanwhile()
            if hour == 1:
                folder.unlink()
                (tmp_path / "away").rename(folder)
    finally:
        node.destroy_node()
        rclpy.shutdown()
    stamps = [pq.read_table(file)["stamp_ns"].to_numpy() for file in sorted(folder.iterdir())]
    assert len(stamps) == 2
    hours = [set((part - made.angle_stamps_ns[0]) // (3600 * SECOND_NS)) for part in stamps]
    assert hours == [{0}, {1, 2}]
