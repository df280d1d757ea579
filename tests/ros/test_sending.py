"""A message is sent again while the middleware is too busy, and not for ever."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy")

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message
from std_msgs.msg import Header

from tests.ros.suite import RELIABLE, Suite
from textile_twin_ros.sending import patient


def test_what_the_middleware_refuses_is_sent_again(suite: Suite) -> None:
    node, heard = suite.node(), []
    publisher: Publisher = node.create_publisher(Header, "edges", RELIABLE)
    node.create_subscription(Header, "edges", heard.append, RELIABLE)
    suite.spin_until(publisher.get_subscription_count, "the subscription")
    refusals = [3]

    def busy(message: bytes) -> None:
        if refusals[0]:
            refusals[0] -= 1
            raise rclpy_implementation.RCLError("Failed to publish", "cannot publish data")
        publisher.publish(message)

    patient(busy)(serialize_message(Header(frame_id="tooth")))
    suite.spin_until(lambda: heard, "the message")
    suite.spin_for(0.2)
    assert [message.frame_id for message in heard] == ["tooth"] and not refusals[0]
    refusals[0] = 10_000
    with pytest.raises(rclpy_implementation.RCLError):
        patient(busy)(b"")
