"""A port to serve on: the one asked for, or the next that is free and not claimed by another view."""

from __future__ import annotations

import errno
import socket

from textile_twin_core.errors import TwinError

TRIED = 100
"""Ports after the first that are tried."""


class Port:
    """A claimed port; the claim holds until `release`, or the end of the process.

    A server that is about to listen cannot hold its port beforehand, and two that start at once would both find it
    free: an abstract socket (Linux) of the port's name, which only one process can have, decides between them.

    Args:
        host: address to serve on.
        wanted: the first port to try.

    Raises:
        TwinError: none of the ports from there on is free, or the address is not this computer's.
    """

    def __init__(self, host: str, wanted: int) -> None:
        for number in range(wanted, min(wanted + TRIED, 65535) + 1):
            self.number, self._claim = number, socket.socket(socket.AF_UNIX)
            try:
                self._claim.bind(f"\0textile-twin-view-{number}")
                _probe(host, number)
                return
            except OSError as error:
                self._claim.close()
                if error.errno != errno.EADDRINUSE:
                    raise TwinError(f"cannot serve a live view on {host}:{number}: {error.strerror}") from error
        raise TwinError(f"cannot serve a live view on {host}: all ports from {wanted} to {self.number} are taken")

    def release(self) -> None:
        """Give the port to others."""
        self._claim.close()


def _probe(host: str, port: int) -> None:
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((host, port))
