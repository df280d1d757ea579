"""Live recording: a thread draws blocks of samples and serves them to rerun viewers that come and go."""

from __future__ import annotations

import errno
import os
import socket
import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from typing import Self

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.errors import TwinError
from textile_twin_core.views.buffer import Block, Buffer
from textile_twin_core.views.recording_writer import say
from textile_twin_core.views.rrd_file import RrdFile

_MOST_LINES = 1000  # event lines that wait to be drawn
TRIED = 100
"""Number of ports to try after the first."""


class LiveRecording(ABC):
    """Base of the live views: buffers, drawing thread, server and file.

    Blocks of samples enter bounded buffers at once and are drawn every `flush_s`. When drawing falls behind, the oldest
    blocks are dropped and counted.

    Args:
        kinds: Names of the buffers.
        flush_s: Time between drawings [s].
        buffer_samples: Capacity of each buffer.
    """

    def __init__(self, kinds: Sequence[str], flush_s: float = 0.1, buffer_samples: int = 200_000) -> None:
        self._flush_s = flush_s
        self._buffers = {name: Buffer(buffer_samples) for name in kinds}
        self._origin: int | None = None
        self._latest_s = 0.0
        self._lines: deque[tuple[str, str]] = deque(maxlen=_MOST_LINES)
        self._stream = rr.RecordingStream("textile-twin")
        self._file: RrdFile | None = None
        self._port: Port | None = None
        self.url: str | None = None
        self._stop = threading.Event()
        self._error: Exception | None = None
        self._worker = threading.Thread(target=self._work, name="live view", daemon=True)

    @abstractmethod
    def _draw(self, blocks: dict[str, Block]) -> None:
        """Draw the new blocks by kind; runs in the drawing thread."""

    @property
    def dropped(self) -> int:
        """Samples dropped because drawing fell behind."""
        return sum(buffer.dropped for buffer in self._buffers.values())

    @property
    def error(self) -> Exception | None:
        """Error that ended the drawing thread or left the file incomplete; None otherwise."""
        return self._error

    def say(self, level: str, text: str) -> None:
        """Add a line to the list of events at the time of the latest sample; level: INFO, WARN or ERROR."""
        self._lines.append((level, text))

    def close(self) -> None:
        """Draw the remaining blocks, end the thread and close file and server; check `error` afterwards."""
        if self._stop.is_set():
            return
        self._stop.set()
        self._worker.join(timeout=10.0)
        self._stream.disconnect()
        if self._file is not None:
            try:
                self._file.finish()
            except TwinError as error:  # reported by `error`
                self._error = self._error or error
        if self._port is not None:
            self._port.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _begin(
        self, blueprint: rrb.Blueprint, host: str, port: int | None, path: str | os.PathLike[str] | None, memory: str
    ) -> None:
        """Open server and file.

        Raises:
            TwinError: Neither port nor path is given, no port is free, or the file cannot be written.
        """
        if port is None and path is None:
            raise TwinError("a live view needs a port to serve on or a file to write to")
        if port is not None:
            self._port = Port(host, port)  # the server itself only logs a port that is in use
        if path is not None:
            self._file = RrdFile(path)
        try:
            served = []
            if self._port is not None:
                server = rr.GrpcServerSink(host, self._port.number, server_memory_limit=memory)
                served.append(server)
                self.url = str(server.uri)
            if self._file is None:
                self._stream.set_sinks(*served, default_blueprint=blueprint)
            else:
                self._file.attach(
                    lambda name: self._stream.set_sinks(rr.FileSink(name), *served, default_blueprint=blueprint)
                )
        except Exception as error:
            what = f"write {path}" if port is None else f"serve a live view on {host}:{port}"
            raise TwinError(f"cannot {what}: {error}") from error

    def _work(self) -> None:
        try:
            while not self._stop.wait(self._flush_s):
                self._take_and_draw()
            self._take_and_draw()
        except Exception as error:  # reported by `error`; a view must not end a node
            self._error = error

    def _take_and_draw(self) -> None:
        self._draw({name: block for name, buffer in self._buffers.items() if (block := buffer.take())})
        while self._lines:
            say(self._stream, self._latest_s, *self._lines.popleft())
        if self._file is not None and self._file.error is not None:
            raise self._file.error

    def _put(self, name: str, stamps_ns: IntArray, *columns: FloatArray) -> None:
        stamps = np.atleast_1d(np.asarray(stamps_ns, dtype=np.int64))
        if stamps.size == 0:
            return
        if self._origin is None:
            self._origin = int(stamps[0])
        time = np.asarray((stamps - self._origin) * 1e-9, dtype=np.float64)
        self._latest_s = float(time[-1])
        self._buffers[name].put((time, *(np.atleast_1d(np.asarray(c, dtype=np.float64)) for c in columns)))


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
