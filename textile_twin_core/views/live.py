"""Live view of a running machine, served to any number of rerun viewers that come and go."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.views.buffer import Block
from textile_twin_core.views.drawable import drawable
from textile_twin_core.views.live_drawing import LiveDrawing
from textile_twin_core.views.live_recording import LiveRecording

if TYPE_CHECKING:
    from textile_twin_core.machine.machine import Machine

_MEMORY_S = 60.0
"""Span of the statistics and scales [s]; an outlier affects them for at most twice this time."""


class LiveView(LiveRecording):
    """Live recording of one machine.

    The `add_` methods accept blocks of samples and return at once.

    Args:
        machine: Machine to show.
        host: Address to serve on; loopback by default.
        port: First port to try; the next free one is taken. None: do not serve.
        path: Also write the recording to this .rrd file.
        memory_limit: Memory of the server for viewers that connect later, such as "64MB".
        limit_Nm: Limit of the residual to draw [N m]; None draws no limit.
        frames_hz: Largest rate of pictures of the linkage [Hz].
        flush_s: Time between drawings [s].
        buffer_samples: Capacity of each buffer.

    Raises:
        TwinError: Neither port nor path is given, no port is free, or the file cannot be written.
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
        self.has_complete_torque = machine.has_complete_torque
        super().__init__(("motion", "stations", "predicted", "measured", "residual"), flush_s, buffer_samples)
        turn_s = 2.0 * np.pi / machine.nominal_speed_rad_s
        title = f"{drawable(machine.name)}, live"
        self._drawing = LiveDrawing(
            machine, self._stream, limit_Nm, frames_hz, title=title, turn_s=turn_s, memory_s=_MEMORY_S
        )
        self._begin(self._drawing.layout.blueprint(), host, port, path, memory_limit)
        self._drawing.prepare()
        self._worker.start()

    def add_motion(self, stamps_ns: IntArray, theta_rad: FloatArray) -> None:
        """Add shaft angles (n,) [rad] with stamps [ns], for a machine whose masses are unknown."""
        self._put("motion", stamps_ns, theta_rad)

    def add_stations(self, stamps_ns: IntArray, stations_rad: FloatArray) -> None:
        """Add angles (n, stations) [rad] of the stations of an elastic shaft, with stamps [ns]."""
        self._put("stations", stamps_ns, *stations_rad.T)

    def add_predicted(
        self, stamps_ns: IntArray, theta_rad: FloatArray, torque_Nm: FloatArray, sigma_Nm: FloatArray | None = None
    ) -> None:
        """Add predictions (n,): stamps [ns], shaft angle [rad], torque and, where known, its sigma [N m]."""
        sigma = np.full(np.size(torque_Nm), np.nan) if sigma_Nm is None else sigma_Nm
        self._put("predicted", stamps_ns, theta_rad, torque_Nm, sigma)

    def add_measured(self, stamps_ns: IntArray, torque_Nm: FloatArray) -> None:
        """Add measured torques (n,) [N m] with stamps [ns]."""
        self._put("measured", stamps_ns, torque_Nm)

    def add_residual(self, stamps_ns: IntArray, residual_Nm: FloatArray) -> None:
        """Add residuals (n,) [N m], with the stamps [ns] of their measured samples."""
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
