"""A refused message is published again, in order; callbacks never wait for it, and no refusal ends a node."""

from __future__ import annotations

import time
from collections import Counter
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rclpy")

from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message
from std_msgs.msg import Header

import textile_twin_core as ttc
from tests.ros.suite import RELIABLE, Suite
from textile_twin_core.comparison.residual import ResidualStream
from textile_twin_core.contact import ContactEvent
from textile_twin_core.twin.predictor import StampedEvent
from textile_twin_ros.messages import WrenchTemplate
from textile_twin_ros.outputs import PublishQueue, TwinStream
from textile_twin_ros.publishing import RCLError, retry_publish


class Busy:
    """A publisher that refuses the next messages, after the tenth of a second that the middleware waits."""

    def __init__(self, publish: Any, refusals: int) -> None:
        self._publish, self.refusals = publish, refusals

    def __call__(self, message: Any) -> None:
        if self.refusals:
            self.refusals -= 1
            raise RCLError("Failed to publish", "cannot publish data")
        self._publish(message)


def test_a_thread_publishes_again_what_the_middleware_refuses(suite: Suite) -> None:
    node, heard = suite.node(), []
    publisher: Publisher = node.create_publisher(Header, "edges", RELIABLE)
    node.create_subscription(Header, "edges", heard.append, RELIABLE)
    suite.spin_until(publisher.get_subscription_count, "the subscription")
    busy = Busy(publisher.publish, 3)
    retry_publish(busy)(serialize_message(Header(frame_id="tooth")))
    suite.spin_until(lambda: heard, "the message")
    suite.spin_for(0.2)
    assert [message.frame_id for message in heard] == ["tooth"] and not busy.refusals
    busy.refusals = 10_000
    with pytest.raises(RCLError):
        retry_publish(busy)(b"")


def test_a_callback_leaves_refused_messages_waiting_in_their_order() -> None:
    given: list[int] = []
    busy = Busy(given.append, 2)
    queue = PublishQueue(busy, depth=3)
    for number in range(3):
        queue.send(number)
    assert given == [] and busy.refusals == 1  # only the first was tried
    while len(given) < 3:
        time.sleep(0.01)
        queue.retry()
    queue.send(3)
    assert given == [0, 1, 2, 3] and queue.dropped == 0
    busy.refusals = 10_000
    for number in range(4, 9):
        queue.send(number)
    assert queue.dropped == 2
    busy.refusals = 0
    while len(given) < 7:
        time.sleep(0.01)
        queue.retry()
    assert given[4:] == [6, 7, 8]


def test_no_refusal_of_a_residual_or_a_contact_event_ends_the_node() -> None:
    given: list[Any] = []
    stream = TwinStream.__new__(TwinStream)
    names = ("balancing_torque/residual", "contact_events")
    stream.subscribers = Counter(dict.fromkeys(names, 1))
    busy = {name: Busy(given.append, 1) for name in names}
    stream._queues = {name: PublishQueue(busy[name], 10) for name in names}
    stream._machine, stream._residual_message = "loom", WrenchTemplate("main_shaft").message
    event = ContactEvent(0.0, "impact", "stop", ("a", "b"), 0.0)
    stream._session = SimpleNamespace(take_events=lambda: [StampedEvent(5, event)])
    residuals = ResidualStream(ttc.machines.tufting().sensors.torque)
    residuals.predicted([1, 2], [0.5, 0.5], [0.0, 0.1])
    stream._publish_residuals(residuals.measured(2, 1.0))
    stream._publish_events()
    assert given == []
    while len(given) < 2:
        time.sleep(0.01)
        assert stream.retry() == 0
    assert isinstance(given[0], bytes) and given[1].status[0].message == "impact"
