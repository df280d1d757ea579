"""The twin's lifecycle by its services, as `ros2 lifecycle` uses them."""

from __future__ import annotations

import re
import threading

import pytest
from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from sensor_msgs.msg import JointState

from tests.campaign import more
from tests.ros.suite import RELIABLE, SECOND_NS, Suite, shaft_angles
from tests.ros.test_live_topics import joint_state, stamp_of
from textile_twin_ros.node_runner import EXECUTORS
from textile_twin_ros.pacing import Pace


@pytest.mark.slow
def test_configure_activate_deactivate_cleanup(suite: Suite) -> None:
    twin = suite.start("twin_node", "autostart:=false")
    node = suite.node()
    torques: list[WrenchStamped] = []
    angle = node.create_publisher(JointState, "main_shaft/angle", RELIABLE)
    node.create_subscription(WrenchStamped, "balancing_torque/predicted", torques.append, RELIABLE)

    def change(transition: int, expected: int) -> None:
        request = ChangeState.Request(transition=Transition(id=transition))
        assert suite.call(node, ChangeState, "twin_node/change_state", request).success, twin.words()
        state = suite.call(node, GetState, "twin_node/get_state", GetState.Request())
        assert state.current_state.id == expected

    def run_shaft(start_ns: int) -> None:
        """Wait for predictions: the twin computes them once it knows of a listener."""
        suite.spin_until(angle.get_subscription_count, "subscription of the twin")
        samples = zip(*shaft_angles(300_000, start_ns=start_ns), strict=True)

        def predicted() -> bool:
            angle.publish(joint_state(*next(samples)))
            return sum(stamp_of(torque) >= start_ns for torque in torques) >= 90

        suite.spin_until(predicted, "predictions")

    assert node.count_subscribers("main_shaft/angle") == 0
    change(Transition.TRANSITION_CONFIGURE, State.PRIMARY_STATE_INACTIVE)
    change(Transition.TRANSITION_ACTIVATE, State.PRIMARY_STATE_ACTIVE)
    run_shaft(0)
    change(Transition.TRANSITION_DEACTIVATE, State.PRIMARY_STATE_INACTIVE)
    suite.spin_until(lambda: not angle.get_subscription_count(), "end of the subscription")
    change(Transition.TRANSITION_ACTIVATE, State.PRIMARY_STATE_ACTIVE)
    torques.clear()
    run_shaft(3600 * SECOND_NS)
    change(Transition.TRANSITION_DEACTIVATE, State.PRIMARY_STATE_INACTIVE)
    change(Transition.TRANSITION_CLEANUP, State.PRIMARY_STATE_UNCONFIGURED)
    suite.spin_until(lambda: not node.count_publishers("balancing_torque/predicted"), "end of the publisher")
    change(Transition.TRANSITION_CONFIGURE, State.PRIMARY_STATE_INACTIVE)
    request = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_INACTIVE_SHUTDOWN))
    assert suite.call(node, ChangeState, "twin_node/change_state", request).success
    assert twin.wait() == 0, twin.words()


@pytest.mark.campaign
@pytest.mark.slow
@pytest.mark.parametrize("executor", [EXECUTORS[0], *more(*EXECUTORS[1:])])
def test_ten_cycles_under_load(suite: Suite, executor: str) -> None:
    """Angles go on at 1 kHz while the twin is configured, activated, deactivated and cleaned up ten times."""
    twin = suite.start("twin_node", "autostart:=false", f"executor:={executor}")
    node = suite.node()
    angle = node.create_publisher(JointState, "main_shaft/angle", RELIABLE)
    torques: list[WrenchStamped] = []
    node.create_subscription(WrenchStamped, "balancing_torque/predicted", torques.append, RELIABLE)
    stop = threading.Event()

    def feed() -> None:
        stamps, angles = shaft_angles(600_000, rate_hz=1000.0)  # for longer than a busy computer takes
        pace = Pace(stop)
        for number, (stamp, value) in enumerate(zip(stamps, angles, strict=True)):
            if not pace.wait_until(number * 1e-3):
                return
            angle.publish(joint_state(stamp, value))

    feeder = threading.Thread(target=feed)
    feeder.start()
    try:
        for _ in range(10):
            torques.clear()
            for transition in (
                Transition.TRANSITION_CONFIGURE,
                Transition.TRANSITION_ACTIVATE,
                None,
                Transition.TRANSITION_DEACTIVATE,
                Transition.TRANSITION_CLEANUP,
            ):
                if transition is None:
                    suite.spin_until(lambda: len(torques) > 100, "predictions")
                    continue
                request = ChangeState.Request(transition=Transition(id=transition))
                assert suite.call(node, ChangeState, "twin_node/change_state", request).success, twin.words()
    finally:
        stop.set()
        feeder.join()
    assert twin.end() == 0
    assert not re.search("Traceback|Exception|FATAL", twin.words()), twin.words()


@pytest.mark.parametrize("executor", [EXECUTORS[0], *more(*EXECUTORS[1:])])
def test_transitions_that_a_state_does_not_have_are_refused(suite: Suite, executor: str) -> None:
    twin = suite.start("twin_node", f"executor:={executor}")
    node = suite.node()

    def change(transition: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=transition))
        return bool(suite.call(node, ChangeState, "twin_node/change_state", request).success)

    twin.wait_for_words("predicting from")
    nothing = 200
    assert not any(map(change, (Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_CONFIGURE, nothing)))
    assert change(Transition.TRANSITION_DEACTIVATE)
    assert not any(map(change, (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CONFIGURE)))
    assert change(Transition.TRANSITION_ACTIVATE)
    assert twin.end() == 0
    assert not re.search("Traceback|Exception|FATAL", twin.words()), twin.words()


def test_configuring_that_fails_leaves_no_topics(suite: Suite) -> None:
    twin = suite.start("twin_node", "autostart:=false", "wait_for:=[needle]")
    node = suite.node()
    request = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_CONFIGURE))
    assert not suite.call(node, ChangeState, "twin_node/change_state", request).success
    assert "no output 'needle'" in twin.words()
    suite.spin_for(0.5)
    suite.spin_until(lambda: not node.count_publishers("balancing_torque/predicted"), "end of the publisher")
    assert twin.end() == 0


@pytest.mark.slow
def test_activated_by_hand_while_it_waits_for_subscribers(suite: Suite) -> None:
    twin = suite.start("twin_node", "wait_for:=[balancing_torque/predicted]")
    node = suite.node()

    def change(transition: int) -> str:
        request = ChangeState.Request(transition=Transition(id=transition))
        assert suite.call(node, ChangeState, "twin_node/change_state", request).success, twin.words()
        return str(suite.call(node, GetState, "twin_node/get_state", GetState.Request()).current_state.label)

    assert change(Transition.TRANSITION_ACTIVATE) == "active"
    node.create_subscription(WrenchStamped, "balancing_torque/predicted", lambda _: None, RELIABLE)
    suite.spin_for(1.0)
    assert twin.process.poll() is None, twin.words()
    assert change(Transition.TRANSITION_DEACTIVATE) == "inactive"
    suite.spin_for(1.0)
    state = suite.call(node, GetState, "twin_node/get_state", GetState.Request())
    assert state.current_state.label == "inactive"
    assert twin.end() == 0
