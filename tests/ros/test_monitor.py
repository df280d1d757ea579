"""monitor_node learns a machine from its topics and raises an alarm that names the fault."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from tests.generators.configured_machine import configured_machine
from tests.generators.faults import faulty, with_fault
from tests.generators.mill_recordings import MillRecording
from tests.ros.suite import RELIABLE, SECOND_NS, Suite, node_environment, shaft_angles
from tests.ros.test_live_topics import joint_state
from textile_twin_core.comparison import Readings
from textile_twin_core.comparison.fault_watch import WatchSettings
from textile_twin_core.comparison.monitor import Monitor, monitor_recording
from textile_twin_core.machines import tufting
from textile_twin_core.recordings import BagWriter
from textile_twin_ros.diagnostics import ERROR, OK, WARN
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
    states: list[str] = []

    def take(message: DiagnosticArray) -> None:
        states.extend(state.message for state in message.status if state.name == "monitor_node: faults")

    listener.create_subscription(DiagnosticArray, "/diagnostics", take, RELIABLE)
    suite.spin_until(lambda: states, "the monitor")
    waits = 'wait_for:=["main_shaft/angle", "balancing_torque/measured"]'
    replay = suite.start("replay_node", f"bag:={bag}", waits, "rate:=4.0")
    assert replay.wait() == 0, suite.words()
    suite.spin_until(lambda: any("needle side" in text for text in states), "an alarm")
    assert node.end() == 0, node.words()
    assert list(trends.glob("trend_*.parquet"))


@pytest.mark.slow
def test_stamps_that_go_back_are_watched_on(suite: Suite) -> None:
    monitor = suite.start("monitor_node")
    node = suite.node()
    states: dict[str, str] = {}

    def take(message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == "monitor_node: main_shaft/angle":
                states.update({entry.key: entry.value for entry in status.values})

    node.create_subscription(DiagnosticArray, "/diagnostics", take, RELIABLE)
    publisher = node.create_publisher(JointState, "main_shaft/angle", RELIABLE)
    suite.spin_until(publisher.get_subscription_count, "the monitor")
    for _ in range(2):
        for stamp, angle in zip(*shaft_angles(1000), strict=True):
            publisher.publish(joint_state(stamp, angle))
    # Nine of the second time go until it is known that it has begun.
    suite.spin_until(lambda: states.get("set_back") == "1" and states["accepted"] == "991", "the second time")
    assert monitor.end() == 0, monitor.words()


@contextmanager
def monitor_in_here(folder: Path, patch: pytest.MonkeyPatch, *parameters: str) -> Iterator[MonitorNode]:
    """A monitor in this process, whose timers do not run."""
    for name, value in node_environment(folder, domain=101).items():
        patch.setenv(name, value)
    words = [word for text in ("learn_turns:=20", *parameters) for word in ("-p", text)]
    rclpy.init(args=["test", "--ros-args", *words])
    node = MonitorNode()
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.shutdown()


def give(node: MonitorNode, made: MillRecording, later_ns: int = 0) -> None:
    """Give the node's inputs the messages of a recording since the last look."""
    angles = zip(made.angle_stamps_ns + later_ns, made.angle, strict=True)
    node._angles.extend((int(stamp), float(angle), math.nan) for stamp, angle in angles)
    torques = zip(made.torque_stamps_ns + later_ns, made.torque, strict=True)
    node._torques.extend((int(stamp), float(torque), math.nan) for stamp, torque in torques)


@pytest.mark.slow
def test_all_faults_that_stand_are_on_the_diagnostics(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The worst of them tells the level: a sensor's alone is no error."""
    made = faulty("friction", 0.6, 985, duration_s=62.0, onset_s=28.0, rate=250.0)
    both = with_fault(made.recording, made.case, "sensor_gain", 0.12, 48.0)
    with monitor_in_here(tmp_path, monkeypatch) as node:
        node._monitor = Monitor(configured_machine(made.case), WatchSettings(learn_turns=60))
        give(node, both)
        node._look()
        faults = node._faults()
    assert "friction" in faults.message
    assert "gain" in faults.message
    assert faults.level == ERROR


def test_the_trend_is_written_meanwhile_and_an_unwritten_one_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "trends"
    with monitor_in_here(tmp_path, monkeypatch, f"parquet:={folder}") as node:
        for hour in (0, 1, 2):
            made = faulty("", 0.0, 985 + hour, duration_s=3.0, onset_s=1.0, rate=200.0).recording
            give(node, made, hour * 3600 * SECOND_NS)
            node._look()
            if hour == 1:  # the disk is away for an hour
                folder.rename(tmp_path / "away")
                folder.write_text("no folder")
            node._write_meanwhile()
            if hour == 1:
                folder.unlink()
                (tmp_path / "away").rename(folder)
    stamps = [pq.read_table(file)["stamp_ns"].to_numpy() for file in sorted(folder.iterdir())]
    assert len(stamps) == 2
    hours = [set((part - made.angle_stamps_ns[0]) // (3600 * SECOND_NS)) for part in stamps]
    assert hours == [{0}, {1, 2}]


def test_a_folder_that_stays_away_costs_the_oldest_of_the_trend_and_no_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "trends"
    made = faulty("", 0.0, 985, duration_s=3.0, onset_s=1.0, rate=200.0).recording
    with monitor_in_here(tmp_path, monkeypatch, f"parquet:={folder}") as node:
        folder.rename(tmp_path / "away")
        folder.write_text("no folder")
        for hour in range(27):
            give(node, made, hour * 3600 * SECOND_NS)
            node._look()
            node._write_meanwhile()
        words = capfd.readouterr().err
        folder.unlink()
        node._write_meanwhile()
    (file,) = folder.iterdir()
    table = pq.read_table(file)
    hours = (table["stamp_ns"].to_numpy() - made.angle_stamps_ns[0]) // (3600 * SECOND_NS)
    assert set(hours) == set(range(3, 27))
    assert words.count("parameter 'parquet'") == 27
    assert len(re.findall(r"; too much waits: the trend of the turns \d+ to \d+ is dropped", words)) == 3


def with_torques(made: MillRecording, chosen: slice) -> MillRecording:
    return replace(made, torque=made.torque[chosen], torque_stamps_ns=made.torque_stamps_ns[chosen])


SPOILT: dict[str, tuple[Callable[[MillRecording], MillRecording], str]] = {
    "healthy": (lambda made: made, ""),
    "not finite": (lambda made: replace(made, torque=np.full_like(made.torque, math.nan)), "torques are not finite"),
    "too few": (lambda made: with_torques(made, slice(None, None, 10)), "torques a turn, and at least 12 are needed"),
    "none": (lambda made: with_torques(made, slice(0)), "no torque comes"),
    "late": (
        lambda made: replace(made, torque_stamps_ns=made.torque_stamps_ns - 120 * SECOND_NS),
        "120.0 s behind the angle's",
    ),
}


@pytest.mark.parametrize("kind", SPOILT)
def test_turns_that_are_not_watched_are_reported_with_the_reason(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The band is learnt in 12 s; then the torque is spoilt for 8."""
    whole = faulty("", 0.0, 985, duration_s=20.0, onset_s=19.0, rate=200.0).recording
    spoil, reason = SPOILT[kind]
    states = []
    trends = tmp_path / "trends"
    with monitor_in_here(tmp_path, monkeypatch, f"parquet:={trends}") as node:
        for second in range(20):
            made = a_second_of(whole, second)
            give(node, made if second < 12 else spoil(made))
            node._look()
            states.append(next(status for status in node._statuses() if status.name == "faults"))
            if second == 13:
                node._write_meanwhile()
                written = len(list(trends.iterdir()))
        node._write_meanwhile()  # of no turn there is nothing to write
        assert len(list(trends.iterdir())) == written + (not reason)
        assert (states[11].level, states[11].message) == (OK, "as learnt")
        if not reason:
            assert (states[-1].level, states[-1].message) == (OK, "as learnt")
            return
        assert states[-1].level == WARN and reason in states[-1].message, states[-1].message
        assert states[-1].message.startswith("no turn watched for ") and states[-1].message.endswith("; as learnt")
        assert [status.level for status in states[12:16]] == [OK] * 4
        node._learn_again(Trigger.Request(), Trigger.Response())
        assert node._statuses()[-1].level == OK


def test_a_torque_that_grows_beyond_its_sensors_range_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The sensor ends at 17.6 N m, which a healthy machine does not reach; from the twelfth second on it is used."""
    whole = faulty("needle_force", 0.2, 981, duration_s=20.0, onset_s=12.0, rate=500.0).recording
    whole = replace(whole, torque=np.minimum(whole.torque, 17.6))
    states = []
    with monitor_in_here(tmp_path, monkeypatch) as node:
        for second in range(20):
            give(node, a_second_of(whole, second))
            node._look()
            states.append(next(status for status in node._statuses() if status.name == "faults"))
    assert (states[11].level, states[11].message) == (OK, "as learnt")
    assert " 17.6 N m" in states[-1].message
    assert "needle side: the loads changed by +19.9" in states[-1].message and states[-1].level == ERROR


def test_the_force_of_each_turn_is_published_with_the_stamp_of_a_sample(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = faulty("", 0.0, 981, duration_s=3.0, rate=250.0).recording
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    offline = monitor_recording(readings, tufting(), WatchSettings(learn_turns=20)).columns
    taken: dict[str, list[JointState]] = {"process/force_peak": [], "process/work": []}
    with monitor_in_here(tmp_path, monkeypatch) as node:
        executor = SingleThreadedExecutor()
        listener = rclpy.create_node("listener")
        executor.add_node(listener)
        for topic, messages in taken.items():
            listener.create_subscription(JointState, topic, messages.append, RELIABLE)
        while not all(node.count_subscribers(topic) for topic in taken):
            executor.spin_once(timeout_sec=0.05)
        give(node, made)
        node._look()
        turns = offline["turn"].size
        while not all(len(messages) >= turns for messages in taken.values()):
            executor.spin_once(timeout_sec=1.0)
        status = next(each for each in node._statuses() if each.name == "process")
        listener.destroy_node()
    peaks, works = taken.values()
    assert [message.name for message in peaks] == [["backing"]] * turns
    assert [message.name for message in works] == [["work_in", "work_out"]] * turns
    stamps = [message.header.stamp.sec * SECOND_NS + message.header.stamp.nanosec for message in peaks]
    assert stamps == offline["stamp_ns"][:turns].tolist() and set(stamps) <= set(made.torque_stamps_ns.tolist())
    assert [each.effort[0] for each in peaks] == pytest.approx(offline["force_peak_N"][:turns])
    assert [each.position[0] for each in peaks] == pytest.approx(offline["pierce_depth_m"][:turns])
    assert [each.effort.tolist() for each in works] == pytest.approx(
        np.stack([offline["work_in_J"], offline["work_out_J"]], axis=1)[:turns]
    )
    assert f"backing: at most {peaks[-1].effort[0]:.0f} N" in status.message and status.level == OK


def a_second_of(whole: MillRecording, second: int) -> MillRecording:
    begin = int(whole.angle_stamps_ns[0]) + second * SECOND_NS
    angle = (whole.angle_stamps_ns >= begin) & (whole.angle_stamps_ns < begin + SECOND_NS)
    torque = (whole.torque_stamps_ns >= begin) & (whole.torque_stamps_ns < begin + SECOND_NS)
    return replace(
        whole,
        angle_stamps_ns=whole.angle_stamps_ns[angle],
        angle=whole.angle[angle],
        torque_stamps_ns=whole.torque_stamps_ns[torque],
        torque=whole.torque[torque],
    )
