"""Views of the elements of a contact machine: live, and of a recording."""

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
from textile_twin_core.views.live_recording import LiveRecording
from textile_twin_core.views.rrd_file import written

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
