"""Sends a message again where the middleware of a busy computer has not come to it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from rclpy.impl.implementation_singleton import rclpy_implementation

Send: TypeAlias = Callable[[bytes], None]
_TRIES = 50
"""The middleware waits a tenth of a second for its own threads, and then says that it cannot publish."""


def patient(send: Send) -> Send:
    """The same as `send`, for as long as queues hold what comes meanwhile: five seconds."""

    def sending(message: bytes) -> None:
        for _ in range(_TRIES - 1):
            try:
                return send(message)
            except rclpy_implementation.RCLError:
                pass
        return send(message)

    return sending
