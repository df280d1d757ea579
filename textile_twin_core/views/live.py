"""Live view: what a running machine does, served to any number of rerun viewers that come and go."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.views.buffer import Block
from textile_twin_core.views.live_drawing import LiveDrawing
from textile_twin_core.views.live_recording import LiveRecording

if TYPE_CHECKING:
    from textile_twin_core.machine.machine import Machine

_MEMORY_S = 60.0
"""One wrong value is in the statistics and scales of a view for two minutes at most."""


class LiveView(LiveRecording):
    """A live recording of one machine.

    The `add_` methods take blocks of samples and return at once.

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
        self.tells_torque = machine.tells_torque
        super().__init__(("motion", "stations", "predicted", "measured", "residual"), flush_s, buffer_samples)
        turn_s = 2.0 * np.pi / machine.nominal_speed_rad_s
        title = f"{machine.name}, live"
        self._drawing = LiveDrawing(
            machine, self._stream, limit_Nm, frames_hz, title=title, turn_s=turn_s, memory_s=_MEMORY_S
        )
        self._begin(self._drawing.layout.blueprint(), host, port, path, memory_limit)
        self._drawing.prepare()
        self._worker.start()

    def add_motion(self, stamps_ns: IntArray, theta_rad: FloatArray) -> None:
        """Take shaft angles (n,) of a machine whose masses are not known: stamps [ns] and the angle."""
        self._put("motion", stamps_ns, theta_rad)

    def add_stations(self, stamps_ns: IntArray, stations_rad: FloatArray) -> None:
        """Take angles (n, stations) of the stations of an elastic shaft."""
        self._put("stations", stamps_ns, *stations_rad.T)

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

    def _draw(self, blocks: dict[str, Block]) -> None:
        if "motion" in blocks:
            self._drawing.motion(*blocks["motion"])
        if "stations" in blocks:
            time, *stations = blocks["stations"]
            self._drawing.stations(time, np.stack(stations, axis=1))
        if "predicted" in blocks:
            self._drawing.predicted(*blocks["predicted"])
        if "measured" in blocks:
            self._drawing.measured(*blocks["measured"])
        if "residual" in blocks:
            self._drawing.residual(*blocks["residual"], not_drawn=self.dropped)
