"""Port to serve on: the requested one, or the next that is free and not claimed by another view."""

from __future__ import annotations

import errno
import socket

from textile_twin_core.errors import TwinError

TRIED = 100
"""Number of ports to try after the first."""


class Port:
    """Claimed port; the claim holds until `release` or the end of the process.

    A port cannot be reserved before its server listens, so two servers that start together would both find it free. An
    abstract socket (Linux) named after the port, which only one process can own, decides between them.

    Args:
        host: Address to serve on.
        wanted: First port to try.

    Raises:
        TwinError: No port from `wanted` on is free, or the address is not of this computer.
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
        """Release the claim."""
        self._claim.close()


def _probe(host: str, port: int) -> None:
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((host, port))
