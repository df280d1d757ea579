"""view_node draws what the nodes publish into a file that a rerun reader opens."""

from __future__ import annotations

import itertools
import re
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState

from tests.ros.suite import PATIENCE_S, RELIABLE, SECOND_NS, Program, Suite, shaft_angles, write_bag
from textile_twin_ros.view_feeds import ElementFeed, LinkageFeed

rerun_chunk = pytest.importorskip("rerun.chunk")


def received_by_the_view(node: Node) -> dict[str, list[int]]:
    """Number of messages that each of the view's inputs has taken, by topic, from its diagnostics from now on."""
    taken: dict[str, list[int]] = {}

    def hear(array: DiagnosticArray) -> None:
        if not any(status.name.startswith("view_node: ") for status in array.status):
            return
        taken.clear()
        for status in array.status:
            counts = [int(entry.value) for entry in status.values if entry.key == "received"]
            taken.setdefault(status.name.removeprefix("view_node: "), []).extend(counts)

    node.create_subscription(DiagnosticArray, "/diagnostics", hear, RELIABLE)
    return taken


@pytest.mark.slow
def test_live_view_is_written(suite: Suite) -> None:
    file = suite.folder / "live.rrd"
    stamps, angles = shaft_angles(1000)
    bag = write_bag(suite.folder / "played", stamps, angles, angles)
    view = suite.start("view_node", f"file:={file}", "port:=0")
    outputs = ("predicted", "predicted_sigma", "residual")
    wanted = ", ".join(f'"balancing_torque/{name}"' for name in outputs)
    twin = suite.start("twin_node", f'wait_for:=[{wanted}, "joint_states"]')
    twin.wait_for_words("predicting from")
    replay = suite.start("replay_node", f"bag:={bag}", 'wait_for:=["main_shaft/angle", "balancing_torque/measured=2"]')
    assert replay.wait() == 0, suite.words()
    # Samples that wait at its end are drawn, too.
    taken = received_by_the_view(suite.node())
    suite.spin_until(
        lambda: (
            taken.get("balancing_torque/measured") == [len(stamps)]
            and taken.get("balancing_torque/predicted") == taken.get("joint_states") == [len(stamps) - 2]
            and taken.get("balancing_torque/residual", [0])[0] > 500
        ),
        "all of it in the view",
    )
    assert view.end() == 0, view.words()
    assert twin.end() == 0
    drawn: Counter[str] = Counter()
    for chunk in rerun_chunk.RrdReader(str(file)).stream():
        if not chunk.is_static:
            drawn[chunk.entity_path] += chunk.to_record_batch().num_rows
    assert drawn["/torque/measured"] == len(stamps)
    assert drawn["/torque/predicted"] == len(stamps) - 2
    assert drawn["/residual/residual"] >= taken["balancing_torque/residual"][0]
    assert any(path.startswith("/world") for path in drawn)


@pytest.mark.slow
def test_a_full_disk_is_one_line_and_an_exit_code(suite: Suite) -> None:
    """The file may grow to 500 kB, of which the machine's drawing alone takes most."""
    file = suite.folder / "live.rrd"
    node = str(Path(sys.executable).parent / "view_node")
    words = ["ulimit -f 500; exec", node, "--ros-args", "-p", f"file:={file}", "-p", "port:=0"]
    view = Program(["bash", "-c", " ".join(words)], suite.folder / "view.log", suite.environment)
    suite.processes.append(view)
    joints = suite.node().create_publisher(JointState, "joint_states", RELIABLE)
    torques = suite.node().create_publisher(WrenchStamped, "balancing_torque/predicted", RELIABLE)
    suite.spin_until(lambda: joints.get_subscription_count() and torques.get_subscription_count(), "the view")
    deadline = time.monotonic() + PATIENCE_S
    for number in itertools.count():
        state, wrench = JointState(name=["main_shaft"], position=[0.01 * number]), WrenchStamped()
        for header in (state.header, wrench.header):
            header.stamp.sec, header.stamp.nanosec = divmod(SECOND_NS + number * 2_000_000, SECOND_NS)
        joints.publish(state)
        torques.publish(wrench)
        if number % 50 == 0:
            suite.spin_for(0.05)
        if view.process.poll() is not None:
            break
        assert time.monotonic() < deadline, view.words()
    assert view.wait() == 2, view.words()
    assert f"view_node: cannot write {file}: File too large" in view.words()
    assert "ERROR" not in view.words() and "Traceback" not in view.words()


@pytest.mark.campaign
@pytest.mark.slow
def test_a_torque_sensor_that_is_not_there_is_no_alarm(suite: Suite) -> None:
    view = suite.start("view_node", f"file:={suite.folder / 'live.rrd'}", "port:=0", "no_data_timeout_s:=0.5")
    node = suite.node()
    joints = node.create_publisher(JointState, "joint_states", RELIABLE)
    torques = {
        name: node.create_publisher(WrenchStamped, f"balancing_torque/{name}", RELIABLE)
        for name in ("predicted", "predicted_sigma", "residual")
    }
    said: list[dict[str, bytes]] = []
    node.create_subscription(
        DiagnosticArray,
        "/diagnostics",
        lambda array: said.append({status.name.removeprefix("view_node: "): status.level for status in array.status}),
        RELIABLE,
    )

    def run_until(condition: Callable[[], object], what: str) -> None:
        """The twin goes on meanwhile."""

        def goes_on() -> object:
            state, wrench = JointState(name=["main_shaft"], position=[0.1]), WrenchStamped()
            state.header.stamp = wrench.header.stamp = node.get_clock().now().to_msg()
            joints.publish(state)
            for name, publisher in torques.items():
                if name != "residual":
                    publisher.publish(wrench)
            return condition()

        suite.spin_until(goes_on, what)

    expected = {"balancing_torque/predicted", "balancing_torque/predicted_sigma", "joint_states", "view"}
    sensors = {"balancing_torque/measured", "balancing_torque/residual"}
    # Longer than it takes to be silent; on a busy computer what is published may come late, the sensor's may not.
    run_until(lambda: len(said) > 5, "diagnostics")
    assert all(levels.keys() == expected for levels in said)
    run_until(lambda: set(said[-1].values()) == {DiagnosticStatus.OK}, "health")
    assert not re.search("no data on /balancing_torque/(measured|residual)", view.words())
    sensor = node.create_publisher(WrenchStamped, "balancing_torque/measured", RELIABLE)
    suite.spin_until(lambda: sensor.get_subscription_count() == 1, "the view")
    run_until(
        lambda: {said[-1].get(name, DiagnosticStatus.OK) for name in sensors} == {DiagnosticStatus.ERROR},
        "alarms of a sensor that is there and says nothing",
    )


@pytest.mark.slow
def test_the_elements_of_needle_transfer(suite: Suite) -> None:
    file = suite.folder / "elements.rrd"
    view = suite.start("view_node", "machine:=needle_transfer", f"file:={file}", "port:=0")
    node = suite.node()
    publisher = node.create_publisher(JointState, "joint_states", RELIABLE)
    taken = received_by_the_view(node)
    suite.spin_until(lambda: publisher.get_subscription_count() == 3, "the view")
    for number in range(500):
        message = JointState(name=[f"element_{k}" for k in (1, 2, 3)])
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(SECOND_NS + number * 1_000_000, SECOND_NS)
        message.position, message.velocity = [1e-4 * number, 0.1, 0.2], [0.1, 0.0, 0.0]
        publisher.publish(message)
        if number % 25 == 24:
            suite.spin_for(0.1)  # a burst would only ask how much the middleware holds for a busy computer
    suite.spin_until(lambda: taken.get("joint_states") == [500] * 3, "all of it in the view")
    assert view.end() == 0, view.words()
    drawn: Counter[str] = Counter()
    for chunk in rerun_chunk.RrdReader(str(file)).stream():
        if not chunk.is_static:
            drawn[chunk.entity_path] += chunk.to_record_batch().num_rows
    assert drawn["/position/element_1"] == drawn["/velocity/element_3"] == 500


def test_elements_are_drawn_together_whichever_was_heard_first() -> None:
    """The first element's subscription has heard two messages before the third's; the second's lost one."""
    takers, drawn = [], []
    view = SimpleNamespace(add_motion=lambda *motion: drawn.append(motion))
    feed = ElementFeed(view, ("a", "b", "c"), lambda *words: takers.append(words[-1]))  # type: ignore[arg-type]
    messages = [(stamp * SECOND_NS // 1000, float(stamp), 0.0) for stamp in range(6)]
    heard = (messages, [message for message in messages if message[1] != 3.0], messages[2:])
    for half in (slice(0, 4), slice(4, None)):
        for take, block in zip(takers, heard, strict=True):
            take(block[half])
        feed.hand_over()
    np.testing.assert_array_equal(np.concatenate([stamps for stamps, *_ in drawn]), [2_000_000, 4_000_000, 5_000_000])
    np.testing.assert_array_equal(np.concatenate([places for _, places, _ in drawn]).T, [[2.0, 4.0, 5.0]] * 3)


def test_predictions_without_joint_states_are_forgotten_in_time() -> None:
    """An hour of them would fill the computer's memory; with joint states again the newest are drawn."""
    takers, drawn = {}, []
    view = SimpleNamespace(
        has_complete_torque=True,
        add_predicted=lambda stamps, *more: drawn.append(stamps),
        add_measured=lambda *none: None,
        add_residual=lambda *none: None,
    )
    feed = LinkageFeed(view, lambda topic, *words: takers.setdefault(topic, words[-1]))  # type: ignore[arg-type]
    count = 120_000
    for first in range(0, count, 1000):
        takers["balancing_torque/predicted"]([(stamp, 1.0) for stamp in range(first, first + 1000)])
        feed.hand_over()
    assert not drawn
    takers["joint_states"]([(0, 0.0), (count, 1.0)])
    feed.hand_over()
    (stamps,) = drawn
    assert stamps[-1] == count - 1
    assert 1000 < stamps.size < count / 2
