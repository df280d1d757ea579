"""A subscription that is made anew while nobody is heard: nothing is lost by it and nothing comes twice."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy")

from std_msgs.msg import Header

from tests.ros.suite import RELIABLE, Suite
from textile_twin_ros.listening import Listening, Take

TOPIC = "main_shaft/index"


def listening_of(node: object, heard: list[bytes]) -> tuple[Listening, list[Take]]:
    """A subscription of this node, and the callbacks of all that were made for it."""
    made: list[Take] = []

    def subscribe(hear: Take) -> object:
        made.append(hear)
        return node.create_subscription(Header, TOPIC, hear, RELIABLE, raw=True)

    return Listening(node, subscribe, heard.append), made


def test_who_begins_to_speak_late_is_heard_once(suite: Suite) -> None:
    node, heard = suite.node(), []
    publisher = node.create_publisher(Header, TOPIC, RELIABLE)
    listening, made = listening_of(node, heard)
    node.create_timer(0.05, listening.look)
    suite.spin_until(lambda: len(made) >= 3, "a second and a third subscription")
    for number in range(500):
        publisher.publish(Header(frame_id=str(number)))
        if number % 50 == 0:
            suite.spin_for(0.02)
    suite.spin_until(lambda: len(heard) >= 500, "all messages")
    suite.spin_for(0.5)
    assert len(heard) == len(set(heard)) == 500
    suite.spin_until(lambda: publisher.get_subscription_count() == 1, "the end of the others")
    assert len(made) == 3  # none after the first message
    # What the executor still holds for a subscription that has gone is left out.
    listening.destroy()
    for hear in made:
        hear(b"late")
    assert len(heard) == 500
