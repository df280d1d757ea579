# Copyright 2026 textile-twin contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
#
# SPDX-License-Identifier: Apache-2.0

"""Publishing while the middleware is too busy: it waits a tenth of a second for its own threads, and then refuses."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Any, TypeAlias

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile

RCLError, UnknownROSArgsError = rclpy_implementation.RCLError, rclpy_implementation.UnknownROSArgsError
"""Errors of the middleware, for which rclpy has no public names."""

Publish: TypeAlias = Callable[[Any], None]
_TRIES = 50
_PAUSE_S = 0.05


def retry_publish(publish: Publish) -> Publish:
    """Return a function that publishes as `publish` does and repeats a refused message for up to five seconds.

    It blocks meanwhile: for threads beside the executor.
    """

    def publish_patiently(message: Any) -> None:
        for _ in range(_TRIES - 1):
            try:
                return publish(message)
            except RCLError:
                pass
        return publish(message)

    return publish_patiently


def create_publish(node: Node, msgtype: type, topic: str, qos: QoSProfile) -> Publish:
    """Create a publisher for a thread beside the executor, and return its function as of `retry_publish`."""
    return retry_publish(node.create_publisher(msgtype, topic, qos).publish)


class PublishQueue:
    """Publisher for callbacks: refused messages wait, in their order, for the next call of `send` or `retry`.

    Args:
        publish: publishes one message.
        depth: messages that wait at most; beyond it the oldest are dropped and counted in `dropped`.
    """

    def __init__(self, publish: Publish, depth: int) -> None:
        self._publish, self._depth = publish, depth
        self._waiting: deque[Any] = deque()
        self._refused_s = 0.0
        self.dropped = 0

    def send(self, message: Any) -> None:
        """Publish a message behind those that wait."""
        if not self._waiting:
            try:
                return self._publish(message)
            except RCLError:
                self._refused_s = time.monotonic()
        self._waiting.append(message)
        if len(self._waiting) > self._depth:
            self._waiting.popleft()
            self.dropped += 1
        return self.retry()

    def retry(self) -> None:
        """Publish the messages that wait, until one is refused; at most once in 50 ms."""
        if not self._waiting or time.monotonic() - self._refused_s < _PAUSE_S:
            return
        try:
            while self._waiting:
                self._publish(self._waiting[0])
                self._waiting.popleft()
        except RCLError:
            self._refused_s = time.monotonic()
