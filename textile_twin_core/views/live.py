"""Live views of a running machine, served to any number of rerun viewers that come and go."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.twin.predictor import StampedEvent
from textile_twin_core.views.buffer import Block
from textile_twin_core.views.drawable import drawable
from textile_twin_core.views.elements import ElementDrawing
from textile_twin_core.views.live_drawing import LiveDrawing
from textile_twin_core.views.live_recording import LiveRecording
from textile_twin_core.views.rrd_file import written

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


if TYPE_CHECKING:
    from textile_twin_core.contact import ContactEvent
    from textile_twin_core.machine import ContactMachine

_RECORDED_FRAMES_HZ = 500.0  # a stroke of needle transfer lasts some hundredths of a second
_SHOWN_TURNS = 4.0
_BLOCK = 512
_MOST_EVENTS = 100_000


class LiveElements(LiveRecording):
    """Live recording of a contact machine.

    Args:
        machine: Machine to show.
        host: Address to serve on.
        port: First port to try; the next free one is taken. None: do not serve.
        path: Also write the recording to this .rrd file.
        memory_limit: Memory of the server for viewers that connect later, such as "64MB".
        frames_hz: Largest rate of pictures [Hz].
        flush_s: Time between drawings [s].

    Raises:
        TwinError: Neither port nor path is given, no port is free, or the file cannot be written.
    """

    def __init__(
        self,
        machine: ContactMachine,
        *,
        host: str = "127.0.0.1",
        port: int | None = 9876,
        path: str | os.PathLike[str] | None = None,
        memory_limit: str = "64MB",
        frames_hz: float = 60.0,
        flush_s: float = 0.1,
    ) -> None:
        super().__init__(("motion",), flush_s)
        self._count = len(machine.elements)
        self._drawing = ElementDrawing(machine, self._stream, frames_hz)
        self._events: deque[StampedEvent] = deque(maxlen=_MOST_EVENTS)
        self._begin(self._drawing.blueprint(_shown_s(machine)), host, port, path, memory_limit)
        self._drawing.prepare()
        self._worker.start()

    def add_motion(self, stamps_ns: IntArray, positions_m: FloatArray, velocities_m_s: FloatArray) -> None:
        """Add stamps [ns] (n,), positions [m] and velocities [m/s] (n, elements)."""
        self._put("motion", stamps_ns, *positions_m.T, *velocities_m_s.T)

    def add_events(self, events: Sequence[StampedEvent]) -> None:
        """Add impacts and touches with their stamps [ns], on the clock of the motion."""
        self._events.extend(events)

    def _draw(self, blocks: dict[str, Block]) -> None:
        if "motion" in blocks:
            assert self._origin is not None
            taken = [self._events.popleft() for _ in range(len(self._events))]
            self._drawing.happened(_timed(taken, self._origin))
            time, *columns = blocks["motion"]
            self._drawing.motion(time, np.stack(columns[: self._count], 1), np.stack(columns[self._count :], 1))


def write_element_recording(
    path: str | os.PathLike[str],
    machine: ContactMachine,
    stamps_ns: IntArray,
    positions_m: FloatArray,
    velocities_m_s: FloatArray,
    events: Sequence[StampedEvent] = (),
    *,
    title: str,
) -> None:
    """Write the motion of the elements as a recording for the viewer.

    Args:
        path: The .rrd file to write.
        machine: Machine to show.
        stamps_ns: Stamps (n,) [ns].
        positions_m: Positions (n, elements) [m].
        velocities_m_s: Velocities (n, elements) [m/s].
        events: Impacts and touches with their stamps [ns].
        title: Name of the recording.

    Raises:
        RecordingError: The file cannot be written there.
    """
    stream = rr.RecordingStream("textile-twin", recording_id=f"{drawable(machine.name)}-{int(stamps_ns[0])}")
    drawing = ElementDrawing(machine, stream, _RECORDED_FRAMES_HZ)
    time = (stamps_ns - stamps_ns[0]) * 1e-9
    with written(stream, path, drawing.blueprint(min(_shown_s(machine), float(time[-1])))):
        stream.send_recording_name(drawable(title))
        drawing.prepare()
        drawing.happened(_timed(events, int(stamps_ns[0])))
        for first in range(0, time.size, _BLOCK):
            part = slice(first, first + _BLOCK)
            drawing.motion(time[part], positions_m[part], velocities_m_s[part])


def _shown_s(machine: ContactMachine) -> float:
    """Return the time span of the plots [s]."""
    return _SHOWN_TURNS * 2.0 * np.pi / machine.nominal_speed_rad_s


def _timed(events: Sequence[StampedEvent], origin_ns: int) -> list[tuple[float, ContactEvent]]:
    return [((stamp - origin_ns) * 1e-9, event) for stamp, event in events]
