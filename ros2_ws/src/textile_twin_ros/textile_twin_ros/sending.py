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

"""Sends a message again where the middleware of a busy computer has not come to it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from rclpy.impl.implementation_singleton import rclpy_implementation

Send: TypeAlias = Callable[[bytes], None]
_TRIES = 50
"""The middleware waits a tenth of a second for its own threads, and then says that it cannot publish."""


def patient(send: Send) -> Send:
    """Send as `send` does, for the five seconds that queues can buffer."""

    def sending(message: bytes) -> None:
        for _ in range(_TRIES - 1):
            try:
                return send(message)
            except rclpy_implementation.RCLError:
                pass
        return send(message)

    return sending
