"""Faults of an input over real topics: each is diagnosed at WARN or above by the second diagnostics that follow it."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from tests.campaign import more
from tests.ros.suite import RELIABLE, SECOND_NS, Suite
from tests.ros.test_live_topics import joint_state, stamp_of
from textile_twin_ros.pacing import Pace

RATE_HZ = 200.0
PERIOD_NS = round(SECOND_NS / RATE_HZ)


def healthy(number: int) -> JointState:
    return joint_state(SECOND_NS + number * PERIOD_NS, 16.755 * number / RATE_HZ % (2.0 * math.pi))


def spoilt(number: int, change: Callable[[JointState], None], every: int = 1) -> JointState:
    message = healthy(number)
    if number % every == 0:
        change(message)
    return message


def shifted(seconds: int) -> Callable[[JointState], None]:
    def shift(message: JointState) -> None:
        message.header.stamp.sec = max(message.header.stamp.sec + seconds, 0)

    return shift


def no_stamp(message: JointState) -> None:
    message.header.stamp.sec = message.header.stamp.nanosec = 0


def other_joint(message: JointState) -> None:
    message.name = ["brake", "clutch"]


def not_a_number(message: JointState) -> None:
    message.position = [0.0, math.nan]


def in_degrees(message: JointState) -> None:
    message.position = [math.degrees(angle) for angle in message.position]


#: What is published as sample number n after the fault began, and what is said of it.
FAULTS: dict[str, tuple[Callable[[int], JointState], str]] = {
    "not a number": (lambda n: spoilt(n, not_a_number), "not finite"),
    "some not a number": (lambda n: spoilt(n, not_a_number, every=20), "not finite"),
    "duplicates": (lambda n: healthy(n - n % 2), "duplicate stamp"),
    "out of order": (lambda n: healthy(n + (2 if n % 10 == 0 else 0)), "stamp"),
    "clock set forward": (lambda n: spoilt(n, shifted(3600)), "pauses"),
    "clock set back": (lambda n: spoilt(n, shifted(-3600)), "went back"),
    "no stamp": (lambda n: spoilt(n, no_stamp), "stamps are 0"),
    "degrees": (lambda n: spoilt(n, in_degrees), "set angle_unit_rad to 0.01745329252"),
    "another joint": (lambda n: spoilt(n, other_joint), "no message has joint 'main_shaft', there are brake, clutch"),
}


def received(status: DiagnosticStatus) -> int:
    """Number of messages of its topic in a status."""
    return next(int(entry.value) for entry in status.values if entry.key == "received")


class Feeder:
    """Publishes at the pace of a machine from a thread of its own."""

    def __init__(self, publisher: Publisher, sample: Callable[[int], Any] = healthy) -> None:
        self._publisher, self._stop, self._lock = publisher, threading.Event(), threading.Lock()
        self.number = 0
        self.sample: Callable[[int], Any] = sample
        self._thread = threading.Thread(target=self._work)
        self._thread.start()

    def _work(self) -> None:
        pace, sent = Pace(self._stop), 0
        while pace.wait_until(sent / RATE_HZ):
            with self._lock:
                message = self.sample(self.number)
                self.number += 1
            self._publisher.publish(message)
            sent += 1

    def begin(self, number: int, sample: Callable[[int], Any]) -> None:
        """Go on from another number, with samples of another kind."""
        with self._lock:
            self.number, self.sample = number, sample

    def close(self) -> None:
        self._stop.set()
        self._thread.join()


@pytest.mark.slow
def test_every_fault_is_reported(suite: Suite) -> None:
    twin = suite.start("twin_node")
    node = suite.node()
    heard: list[DiagnosticStatus] = []
    node.create_subscription(
        DiagnosticArray,
        "/diagnostics",
        lambda message: heard.extend(s for s in message.status if s.name == "twin_node: main_shaft/angle"),
        RELIABLE,
    )
    predicted: list[int] = []
    node.create_subscription(
        WrenchStamped,
        "balancing_torque/predicted",
        lambda message: predicted.append(stamp_of(message)),
        RELIABLE,
    )
    feeder = Feeder(node.create_publisher(JointState, "main_shaft/angle", RELIABLE))

    def fits(words: str) -> bool:
        return bool(heard) and heard[-1].level != DiagnosticStatus.OK and words in heard[-1].message

    try:
        suite.spin_until(lambda: heard and heard[-1].level == DiagnosticStatus.OK, "health")
        for turn, (name, (sample, words)) in enumerate(FAULTS.items(), 1):
            # A machine that has run for two hours: its clock can be set back.
            begin = turn * int(7200 * RATE_HZ)
            feeder.begin(begin, healthy)
            assert suite.call(node, Trigger, "twin_node/reset", Trigger.Request()).success
            in_order = SECOND_NS + (begin + 40) * PERIOD_NS
            suite.spin_until(lambda begin=in_order: predicted and predicted[-1] >= begin, f"health before '{name}'")  # type: ignore[misc]
            heard.clear()
            feeder.sample = sample
            suite.spin_until(lambda words=words: fits(words), f"diagnostics of '{name}'")  # type: ignore[misc]
            # By the second, or on a busy computer, which comes late to samples, the second that has seen some.
            silent_over = received(heard[-2]) - received(heard[0]) if len(heard) > 2 else 0
            assert silent_over < 0.75 * RATE_HZ, (name, [status.message for status in heard])
        feeder.sample = healthy
        second = node.create_publisher(JointState, "main_shaft/angle", RELIABLE)
        suite.spin_until(lambda: fits("2 publishers"), "diagnostics of two publishers")
        assert heard[-1].level == DiagnosticStatus.WARN
        node.destroy_publisher(second)
        suite.spin_until(lambda: "main_shaft/angle: recovered" in twin.words(), "the log's all-clear")
    finally:
        feeder.close()
    # Once each, however long a fault lasts.
    assert twin.words().count("2 publishers give") == 1


def torque(number: int, value: float = 3.0, late: int = 0) -> WrenchStamped:
    message = WrenchStamped(header=healthy(number - late).header)
    message.wrench.torque.z = value
    return message


TORQUE_FAULTS: dict[str, tuple[Callable[[int], WrenchStamped], bytes, str]] = {
    "some not a number": (lambda n: torque(n, 3.0 if n % 20 else math.nan), DiagnosticStatus.WARN, "not finite"),
    "absurd": (lambda n: torque(n, -1e300), DiagnosticStatus.ERROR, "not finite"),
    "duplicates": (lambda n: torque(n - n % 2), DiagnosticStatus.WARN, "duplicate stamp"),
    "out of order": (lambda n: torque(n, late=2 * (n % 10 == 0)), DiagnosticStatus.WARN, "older stamp"),
    "clock set back": (lambda n: torque(n, late=round(3600 * RATE_HZ)), DiagnosticStatus.WARN, "went back"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["twin_node", *more("monitor_node")])
def test_torques_that_do_not_serve_are_reported(suite: Suite, name: str) -> None:
    suite.start(name)
    node = suite.node()
    heard: list[DiagnosticStatus] = []
    node.create_subscription(
        DiagnosticArray,
        "/diagnostics",
        lambda message: heard.extend(s for s in message.status if s.name == f"{name}: balancing_torque/measured"),
        RELIABLE,
    )
    feeder = Feeder(node.create_publisher(WrenchStamped, "balancing_torque/measured", RELIABLE), torque)
    try:
        for fault, (sample, level, words) in TORQUE_FAULTS.items():
            feeder.begin(feeder.number + int(7200 * RATE_HZ), torque)
            if name == "twin_node":  # otherwise the last fault is shown for as long as levels look back
                suite.call(node, Trigger, "twin_node/reset", Trigger.Request())
            heard.clear()
            suite.spin_until(lambda: heard and heard[-1].level == DiagnosticStatus.OK, f"health before '{fault}'")
            feeder.sample = sample
            suite.spin_until(
                lambda level=level, words=words: heard[-1].level == level and words in heard[-1].message,  # type: ignore[misc]
                f"diagnostics of '{fault}'",
            )
    finally:
        feeder.close()


@pytest.mark.campaign
@pytest.mark.slow
@pytest.mark.parametrize(
    ("hours", "words"), [(1, "3600.0 s ahead of the angle's"), *more((-1, "3600.0 s behind the angle's"))]
)
def test_clocks_that_differ_are_reported_where_residuals_stay_away(suite: Suite, hours: int, words: str) -> None:
    suite.start("twin_node")
    node = suite.node()
    heard: list[DiagnosticStatus] = []
    node.create_subscription(
        DiagnosticArray,
        "/diagnostics",
        lambda message: heard.extend(s for s in message.status if s.name == "twin_node: balancing_torque/residual"),
        RELIABLE,
    )
    torques = Feeder(node.create_publisher(WrenchStamped, "balancing_torque/measured", RELIABLE), torque)
    angles = Feeder(node.create_publisher(JointState, "main_shaft/angle", RELIABLE))
    torques.begin(int(7200 * RATE_HZ), torque)
    angles.begin(int(7200 * RATE_HZ), healthy)
    try:
        suite.spin_until(lambda: heard and "rms" in heard[-1].message, "residuals")
        torques.begin(torques.number + int(hours * 3600 * RATE_HZ), torque)
        suite.spin_until(lambda: words in heard[-1].message, "diagnostics of the clocks")
        assert heard[-1].level == DiagnosticStatus.WARN
    finally:
        angles.close()
        torques.close()
