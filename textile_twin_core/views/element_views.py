"""Views of a contact machine's elements: live, and of a recording."""

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
    """A live recording of a contact machine.

    Args:
        machine: the machine that is shown.
        host, port: where to serve; the next port that is free is taken, None serves nobody.
        path: also write the recording to this .rrd file.
        memory_limit: what the server keeps for viewers that come later, such as "64MB".
        frames_hz: most pictures in a second.
        flush_s: time between drawings.

    Raises:
        TwinError: neither port nor path is given, no port is free, or the file cannot be written.
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
        """Take stamps [ns] (n,), positions and velocities (n, elements)."""
        self._put("motion", stamps_ns, *positions_m.T, *velocities_m_s.T)

    def add_events(self, events: Sequence[StampedEvent]) -> None:
        """Take impacts and touches, stamped [ns] as the motion is."""
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
    """Write the elements' motion as a recording that the viewer opens: stamps (n,), the others (n, elements).

    Raises RecordingError when the file cannot be written there.
    """
    stream = rr.RecordingStream("textile-twin", recording_id=f"{machine.name}-{int(stamps_ns[0])}")
    drawing = ElementDrawing(machine, stream, _RECORDED_FRAMES_HZ)
    time = (stamps_ns - stamps_ns[0]) * 1e-9
    with written(stream, path, drawing.blueprint(min(_shown_s(machine), float(time[-1])))):
        stream.send_recording_name(title)
        drawing.prepare()
        drawing.happened(_timed(events, int(stamps_ns[0])))
        for first in range(0, time.size, _BLOCK):
            part = slice(first, first + _BLOCK)
            drawing.motion(time[part], positions_m[part], velocities_m_s[part])


def _shown_s(machine: ContactMachine) -> float:
    """Time that the plots show [s]."""
    return _SHOWN_TURNS * 2.0 * np.pi / machine.nominal_speed_rad_s


def _timed(events: Sequence[StampedEvent], origin_ns: int) -> list[tuple[float, ContactEvent]]:
    return [((stamp - origin_ns) * 1e-9, event) for stamp, event in events]
