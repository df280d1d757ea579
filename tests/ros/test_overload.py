"""A node that gets too little processor time says so while it lasts, and ends when it is told to."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

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
def fed(publisher: Publisher) -> Iterator[None]:
    """Shaft angles go on meanwhile."""
    stop = threading.Event()

    def feed() -> None:
        pace = Pace(stop)
        for number, (stamp, angle) in enumerate(zip(*shaft_angles(400_000, RATE_HZ), strict=True)):
            if not pace.wait_until(number / RATE_HZ):
                return
            publisher.publish(joint_state(stamp, angle))

    thread = threading.Thread(target=feed)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@contextmanager
def starved(program: Program) -> Iterator[None]:
    """The program has a tenth of the time."""
    stop = threading.Event()

    def starve() -> None:
        while not stop.wait(0.01):
            program.process.send_signal(signal.SIGSTOP)
            stop.wait(0.09)
            program.process.send_signal(signal.SIGCONT)

    thread = threading.Thread(target=starve)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@pytest.mark.slow
def test_a_twin_that_falls_behind_says_so_and_ends(suite: Suite) -> None:
    twin = suite.start("twin_node", f"rate_hz:={RATE_HZ}")
    node = suite.node()
    said: list[tuple[float, bytes, str]] = []

    def hear(array: DiagnosticArray) -> None:
        said.extend(
            (time.monotonic(), s.level, s.message) for s in array.status if s.name == "twin_node: main_shaft/angle"
        )

    node.create_subscription(DiagnosticArray, "/diagnostics", hear, RELIABLE)
    node.create_subscription(WrenchStamped, "balancing_torque/predicted_sigma", lambda _: None, RELIABLE)
    publisher = node.create_publisher(JointState, "main_shaft/angle", RELIABLE)
    twin.wait_for_words("predicting from")
    suite.spin_until(publisher.get_subscription_count, "twin")
    with fed(publisher):
        suite.spin_until(lambda: said and said[-1][1] == DiagnosticStatus.OK, "health")
        with starved(twin):
            suite.spin_until(
                lambda: said[-1][1] == DiagnosticStatus.WARN and "late to its messages" in said[-1][2], "lateness"
            )
            said.clear()
            suite.spin_for(8.0)
            assert len(said) >= 4, said
            assert twin.process.poll() is None
            twin.process.send_signal(signal.SIGTERM)
            began = time.monotonic()
            assert twin.wait() == 0
            assert time.monotonic() - began < 20.0
    assert "Traceback" not in twin.words()
