"""A node that gets too little processor time says so while it lasts, and ends on request."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState

from tests.ros.suite import RELIABLE, Program, Suite, shaft_angles
from tests.ros.test_live_topics import joint_state
from textile_twin_ros.pacing import Pace

RATE_HZ = 2000.0


@contextmanager
def meanwhile(work: Callable[[threading.Event], None]) -> Iterator[None]:
    """Do something else until it is stopped."""
    stop = threading.Event()
    thread = threading.Thread(target=work, args=(stop,))
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def fed(publisher: Publisher) -> AbstractContextManager[None]:
    """Shaft angles go on meanwhile."""

    def feed(stop: threading.Event) -> None:
        pace = Pace(stop)
        for number, (stamp, angle) in enumerate(zip(*shaft_angles(400_000, RATE_HZ), strict=True)):
            if not pace.wait_until(number / RATE_HZ):
                return
            publisher.publish(joint_state(stamp, angle))

    return meanwhile(feed)


def starved(program: Program) -> AbstractContextManager[None]:
    """The program has a tenth of the time, and comes back to messages that have waited for long each time."""

    def starve(stop: threading.Event) -> None:
        while not stop.wait(0.2):
            program.process.send_signal(signal.SIGSTOP)
            stop.wait(1.8)
            program.process.send_signal(signal.SIGCONT)

    return meanwhile(starve)


@pytest.mark.campaign
@pytest.mark.slow
def test_a_twin_that_falls_behind_says_so_and_ends(suite: Suite) -> None:
    twin = suite.start("twin_node", f"rate_hz:={RATE_HZ}")
    node = suite.node()
    said: list[tuple[bytes, str]] = []

    def hear(array: DiagnosticArray) -> None:
        said.extend((s.level, s.message) for s in array.status if s.name == "twin_node: main_shaft/angle")

    node.create_subscription(DiagnosticArray, "/diagnostics", hear, RELIABLE)
    node.create_subscription(WrenchStamped, "balancing_torque/predicted_sigma", lambda _: None, RELIABLE)
    publisher = node.create_publisher(JointState, "main_shaft/angle", RELIABLE)
    twin.wait_for_words("predicting from")
    suite.spin_until(publisher.get_subscription_count, "twin")
    with fed(publisher):
        suite.spin_until(lambda: said and said[-1][0] == DiagnosticStatus.OK, "health")
        with starved(twin):
            suite.spin_until(
                lambda: said[-1][0] == DiagnosticStatus.WARN and "behind its input" in said[-1][1], "lateness"
            )
            said.clear()
            suite.spin_until(lambda: len(said) >= 4, "diagnostics that go on")
            assert twin.process.poll() is None
            twin.process.send_signal(signal.SIGTERM)
            assert twin.wait() == 0  # though it is fed on
    assert "Traceback" not in twin.words()
