"""A simulated machine whose time is that of a simulation."""

from __future__ import annotations

from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from tests.ros.suite import RELIABLE, SECOND_NS, Suite
from tests.ros.test_live_topics import stamp_of


def test_it_waits_for_a_clock(suite: Suite) -> None:
    machine = suite.start("shaft_node", "use_sim_time:=true", "rate_hz:=200.0")
    node = suite.node()
    heard: list[JointState] = []
    node.create_subscription(JointState, "main_shaft/angle", heard.append, RELIABLE)
    clock = node.create_publisher(Clock, "/clock", RELIABLE)
    machine.wait_for_words("waits for a first /clock")
    suite.spin_until(clock.get_subscription_count, "the machine")
    suite.spin_for(1.0)
    assert not heard and machine.words().count("/clock") == 1
    message = Clock()
    message.clock.sec = 1_700_000_000
    clock.publish(message)
    suite.spin_until(lambda: len(heard) > 20, "angles")
    stamps = [stamp_of(angle) for angle in heard]
    assert stamps[0] >= 1_700_000_000 * SECOND_NS
    assert machine.end() == 0, machine.words()


def test_it_ends_while_it_waits(suite: Suite) -> None:
    machine = suite.start("shaft_node", "use_sim_time:=true")
    machine.wait_for_words("waits for a first /clock")
    assert machine.end() == 0, machine.words()
    assert "samples a second" not in machine.words()
