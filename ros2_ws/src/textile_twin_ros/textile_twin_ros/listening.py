"""A subscription to bytes that hears: a second one is made while publishers are there and none of them is heard.

A process that was killed stays known to the others for twenty seconds, and reliable publishers keep for it what they
have sent. A reader that comes in this time is told that those samples are not for it; where this message is lost,
because the publisher has found the reader first, it is told again 256 samples at a time, every three seconds, and
hears nothing until then. A reader that is made when both have found each other hears at once.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeAlias

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from textile_twin_ros.spinning import call_every

Take: TypeAlias = Callable[[bytes], None]
_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.5, 60.0
"""How long nothing may come from publishers that are there; twice as long each time, for those that have no news."""
_LOOK_S = 0.1


class Listening:
    """Of two subscriptions the one that hears first stays, so that nothing is lost and nothing comes twice.

    Args:
        node: the node that listens.
        subscribe: makes a subscription with this callback.
        take: called with each message.
    """

    def __init__(self, node: Node, subscribe: Callable[[Take], Subscription], take: Take) -> None:
        self._node, self._subscribe, self._take = node, subscribe, take
        self._others: list[Subscription] = []
        self._heard = self._ended = False
        self._wait_s = _FIRST_WAIT_S
        self._due_s: float | None = None
        self.subscription = self._open()

    def look(self) -> None:
        """Make a second subscription when it is time, or remove what has served; not from within its callbacks."""
        if self._heard:
            self._drop_others()
        elif not self.subscription.get_publisher_count():
            self._due_s = None
        elif self._due_s is None:
            self._due_s = time.monotonic() + self._wait_s
        elif time.monotonic() > self._due_s:
            self._drop_others()
            self._others.append(self._open())
            self._wait_s = min(2.0 * self._wait_s, _LONGEST_WAIT_S)
            self._due_s = time.monotonic() + self._wait_s

    def destroy(self) -> None:
        """End it; messages that the executor still holds for it are left out."""
        self._ended = True
        self._drop_others()
        self._node.destroy_subscription(self.subscription)

    def _open(self) -> Subscription:
        def hear(raw: bytes) -> None:
            if self._ended or not (opened is self.subscription or self._becomes_it(opened)):
                return
            self._heard = True
            self._take(raw)

        opened = self._subscribe(hear)
        return opened

    def _becomes_it(self, subscription: Subscription) -> bool:
        """Whether this one hears first of all; what it goes before is removed later."""
        if self._heard or subscription not in self._others:
            return False
        self._others.remove(subscription)
        self._others.append(self.subscription)
        self.subscription = subscription
        return True

    def _drop_others(self) -> None:
        for subscription in self._others:
            self._node.destroy_subscription(subscription)
        self._others.clear()


def listen(node: Node, message_type: type, topic: str, take: Take, qos: QoSProfile) -> None:
    """Hear the bytes of a topic for as long as the node lives."""
    listening = Listening(node, lambda hear: node.create_subscription(message_type, topic, hear, qos, raw=True), take)
    call_every(node, _LOOK_S, listening.look)
