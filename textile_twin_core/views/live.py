"""Live view: what a running machine does, served to any number of rerun viewers that come and go."""

from __future__ import annotations

import os
import threading
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.errors import TwinError
from textile_twin_core.views.buffer import Buffer
from textile_twin_core.views.live_drawing import LiveDrawing
from textile_twin_core.views.port import Port

if TYPE_CHECKING:
    from textile_twin_core.machine.machine import Machine


class LiveView:
    """A live recording of one machine.

    The `add_` methods put blocks of samples into bounded buffers and return at once; a thread of its own
    draws them every `flush_s`. When drawing cannot keep up the oldest blocks are dropped and counted.

    Args:
        machine: the machine that is shown.
        host: address to serve on; loopback unless told otherwise.
        port: port to serve on, or the next one that is free; None serves nobody.
        path: also write the recording to this .rrd file.
        memory_limit: what the server keeps for viewers that come later, such as "64MB".
        limit_Nm: limit of the residual to draw, None for none.
        frames_hz: most pictures of the linkage in a second.
        flush_s: time between drawings.
        buffer_samples: samples that each buffer holds at most.

    Raises:
        TwinError: neither port nor path is given, no port is free, or the file cannot be written.
    """

    def __init__(
        self,
        machine: Machine,
        *,
        host: str = "127.0.0.1",
        port: int | None = 9876,
        path: str | os.PathLike[str] | None = None,
        memory_limit: str = "64MB",
        limit_Nm: float | None = None,
        frames_hz: float = 60.0,
        flush_s: float = 0.1,
        buffer_samples: int = 200_000,
    ) -> None:
        if port is None and path is None:
            raise TwinError("a live view needs a port to serve on or a file to write to")
        self._flush_s = flush_s
        self._buffers = {name: Buffer(buffer_samples) for name in ("predicted", "measured", "residual")}
        self._origin: int | None = None
        self._stream = rr.RecordingStream("textile-twin")
        self._drawing = LiveDrawing(machine, self._stream, limit_Nm, frames_hz)
        self._port: Port | None = None
        self.url = self._serve(host, port, path, memory_limit)
        self._drawing.prepare()
        self._stop = threading.Event()
        self._error: BaseException | None = None
        self._worker = threading.Thread(target=self._work, name="live view", daemon=True)
        self._worker.start()

    # --- from outside, in any thread ---------------------------------------------------------------------

    def add_predicted(
        self, stamps_ns: IntArray, theta_rad: FloatArray, torque_Nm: FloatArray, sigma_Nm: FloatArray | None = None
    ) -> None:
        """Take predictions (n,): stamps [ns], shaft angle, torque, and its sigma where known."""
        sigma = np.full(np.size(torque_Nm), np.nan) if sigma_Nm is None else sigma_Nm
        self._put("predicted", stamps_ns, theta_rad, torque_Nm, sigma)

    def add_measured(self, stamps_ns: IntArray, torque_Nm: FloatArray) -> None:
        """Take measured torque (n,)."""
        self._put("measured", stamps_ns, torque_Nm)

    def add_residual(self, stamps_ns: IntArray, residual_Nm: FloatArray) -> None:
        """Take residuals (n,), at the stamps of their measured samples."""
        self._put("residual", stamps_ns, residual_Nm)

    @property
    def dropped(self) -> int:
        """Samples dropped because drawing could not keep up."""
        return sum(buffer.dropped for buffer in self._buffers.values())

    @property
    def error(self) -> BaseException | None:
        """What ended the drawing thread, None while all is well."""
        return self._error

    def close(self) -> None:
        """Draw what is left, end the thread and close file and server."""
        if self._stop.is_set():
            return
        self._stop.set()
        self._worker.join(timeout=10.0)
        self._stream.disconnect()
        if self._port is not None:
            self._port.release()

    def __enter__(self) -> LiveView:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- in the drawing thread ---------------------------------------------------------------------------

    def _work(self) -> None:
        try:
            while not self._stop.wait(self._flush_s):
                self._draw()
            self._draw()
        except Exception as error:  # the thread's owner asks for it; a view must not end a node
            self._error = error

    def _draw(self) -> None:
        predicted, measured, residual = (self._buffers[name].take() for name in ("predicted", "measured", "residual"))
        if predicted:
            self._drawing.predicted(*predicted)
        if measured:
            self._drawing.measured(*measured)
        if residual:
            self._drawing.residual(*residual, not_drawn=self.dropped)

    # --- helpers -----------------------------------------------------------------------------------------

    def _put(self, name: str, stamps_ns: IntArray, *columns: FloatArray) -> None:
        stamps = np.atleast_1d(np.asarray(stamps_ns, dtype=np.int64))
        if stamps.size == 0:
            return
        if self._origin is None:
            self._origin = int(stamps[0])
        time = np.asarray((stamps - self._origin) * 1e-9, dtype=np.float64)
        self._buffers[name].put((time, *(np.atleast_1d(np.asarray(c, dtype=np.float64)) for c in columns)))

    def _serve(self, host: str, port: int | None, path: str | os.PathLike[str] | None, memory_limit: str) -> str | None:
        sinks: list[rr.GrpcServerSink | rr.FileSink] = []
        server = None
        if port is not None:
            self._port = Port(host, port)  # the server would only log that it could not listen
        try:
            if path is not None:
                sinks.append(rr.FileSink(path))
            if self._port is not None:
                server = rr.GrpcServerSink(host, self._port.number, server_memory_limit=memory_limit)
                sinks.append(server)
            self._stream.set_sinks(*sinks, default_blueprint=self._drawing.layout.blueprint())
        except Exception as error:
            raise TwinError(f"cannot serve a live view on {host}:{port} or write {path}: {error}") from error
        return None if server is None else str(server.uri)
