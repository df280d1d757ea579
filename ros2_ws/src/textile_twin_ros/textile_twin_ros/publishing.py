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

from collections.abc import Callable
from typing import Any, TypeAlias

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile

RCLError, UnknownROSArgsError = rclpy_implementation.RCLError, rclpy_implementation.UnknownROSArgsError
"""Errors of the middleware, for which rclpy has no public names."""

Publish: TypeAlias = Callable[[Any], None]
_TRIES = 50


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
