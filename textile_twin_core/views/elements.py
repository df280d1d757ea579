"""Sliding elements of a contact machine in a recording: blocks on their line, their motion over time, their hits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact import ContactEvent
from textile_twin_core.views import palette
from textile_twin_core.views.frames import Frames
from textile_twin_core.views.hits import HitDrawing
from textile_twin_core.views.layout import TIMELINE, over_time, page, time_axis
from textile_twin_core.views.scribe import at_times, scalars

if TYPE_CHECKING:
    from textile_twin_core.machine import ContactMachine

_LENGTH, _HEIGHT, _PITCH = 0.55, 0.12, 0.2
"""Of an element's block, and from one to the next across the line; in the longest stroke."""
_SUMMARY_S = 0.1
"""What happens within this time is summed up at once."""
_KEPT = 1000
"""Samples of which an event may still come."""


class ElementDrawing:
    """Draws a machine's elements; positions come as arrays (n, elements), in the order of `machine.elements`.

    Args:
        machine: the machine.
        stream: where to.
        frames_hz: most pictures of the blocks in a second.
    """

    def __init__(self, machine: ContactMachine, stream: rr.RecordingStream, frames_hz: float) -> None:
        self._machine, self._stream = machine, stream
        self._frames = Frames(frames_hz)
        angles = np.linspace(0.0, 2.0 * math.pi, 721)
        travel = np.array([machine.law.evaluate(angle) for angle in angles.tolist()])
        self._low, self._stroke = float(travel.min()), max(float(np.ptp(travel)), 1e-3)
        self._time, self._places = np.empty(0), np.empty((0, len(machine.elements)))
        self._waiting: list[tuple[float, ContactEvent]] = []
        reach = 0.5 * _PITCH * self._stroke
        self._hits = HitDrawing(machine, stream, self._place, self._row, reach)

    def blueprint(self, window_s: float) -> rrb.Blueprint:
        """The layout: the blocks above, positions and velocities over the last seconds below."""
        axis = time_axis(window_s, 0.05 * window_s)
        stroke, rows = self._stroke, len(self._machine.elements)
        farthest = max(self._low, *self._machine.start, *(pad.position_m for pad in self._machine.pads))
        bounds = rrb.VisualBounds2D(
            x_range=(self._low - 0.35 * stroke, farthest + (1.35 + _LENGTH) * stroke),
            y_range=(-0.3 * stroke, rows * _PITCH * stroke + 0.15 * stroke),
        )
        blocks = rrb.Spatial2DView(
            name=f"Machine: {self._machine.name}",
            origin="elements",
            background=palette.BACKGROUND,
            visual_bounds=bounds,
        )
        summary = rrb.TextDocumentView(name="Impacts", origin="summary")
        lines: list[tuple[rrb.View | rrb.Container, float]] = [
            (rrb.Horizontal(blocks, summary, column_shares=[2.4, 1.0]), 1.3),
            *(
                (over_time(name, origin, axis, legend=True), share)
                for name, origin, share in (
                    ("Position, and where it strikes [mm]", "position", 1.5),
                    ("Velocity [m/s]", "velocity", 1.0),
                    ("Speed with which stops and pads are struck [m/s]", "hits", 0.9),
                )
            ),
        ]
        if self._machine.pads:
            lines.append((rrb.StateTimelineView(name="Pads", origin="pads", time_view=axis), 0.6))
        views, shares = zip(*lines, strict=True)
        return page(rrb.Vertical(*views, row_shares=list(shares)))

    def prepare(self) -> None:
        """Draw what does not move."""
        stroke = self._stroke
        size = [[_LENGTH * stroke, _HEIGHT * stroke]]
        for number, element in enumerate(self._machine.elements):
            colour = palette.LINKS[number]
            for plot in ("position", "velocity"):
                self._stream.log(
                    f"{plot}/{element}", rr.SeriesLines(colors=[colour], names=[element], widths=[1.8]), static=True
                )
            centre = [[0.5 * _LENGTH * stroke, 0.0]]
            block = rr.Boxes2D(sizes=size, centers=centre, colors=[colour])
            self._stream.log(f"elements/{element}", block, static=True)
        end = len(self._machine.elements) * _PITCH * stroke
        for pad in self._machine.pads:
            line = [[pad.position_m, -0.1 * stroke], [pad.position_m, end]]
            drawn = rr.LineStrips2D([line], radii=[-1.2], colors=[palette.LIMIT])
            self._stream.log(f"elements/pads/{pad.name}", drawn, static=True)
            label = rr.Points2D([line[0]], radii=[0.0], labels=[f"face of {pad.name}"], colors=[palette.TEXT])
            self._stream.log(f"elements/pads/{pad.name}/name", label, static=True)
        self._hits.prepare()
        self._sum_up(0.0)

    def happened(self, events: Sequence[tuple[float, ContactEvent]]) -> None:
        """Take impacts and touches with their times [s], in order of time; motion may not have come so far yet."""
        self._waiting += events

    def motion(self, time_s: FloatArray, positions_m: FloatArray, velocities_m_s: FloatArray) -> None:
        """Draw the elements at times (n,): positions and velocities (n, elements); and what happened until then."""
        self._time = np.concatenate([self._time[-_KEPT:], time_s])
        self._places = np.concatenate([self._places[-_KEPT:], positions_m])
        self._draw_hits(float(time_s[-1]))
        frames = self._frames.of(time_s)
        for number, element in enumerate(self._machine.elements):
            place = positions_m[:, number]
            scalars(self._stream, f"position/{element}", time_s, place * 1e3)
            scalars(self._stream, f"velocity/{element}", time_s, velocities_m_s[:, number])
            if frames.size:
                across = np.full(frames.size, self._row(element))
                moved = np.column_stack([place[frames], across, np.zeros(frames.size)]).astype(np.float32)
                columns = rr.Transform3D.columns(translation=moved)
                self._stream.send_columns(f"elements/{element}", at_times(time_s[frames]), columns)

    def _draw_hits(self, now_s: float) -> None:
        ready = [each for each in self._waiting if each[0] <= now_s]
        self._waiting = self._waiting[len(ready) :]
        while ready:
            together = [each for each in ready if each[0] <= ready[0][0] + _SUMMARY_S]
            ready = ready[len(together) :]
            self._hits.draw(together)
            self._sum_up(together[-1][0])

    def _sum_up(self, now_s: float) -> None:
        text = "\n".join([f"### {self._machine.name}", "", *self._hits.summary()])
        self._stream.set_time(TIMELINE, duration=now_s)
        self._stream.log("summary", rr.TextDocument(text, media_type="text/markdown"))

    def _place(self, element: str, time_s: FloatArray) -> FloatArray:
        """Position [m] at times (n,) of late."""
        return np.interp(time_s, self._time, self._places[:, self._machine.elements.index(element)])

    def _row(self, element: str) -> float:
        """Where an element's block stands across the line [m]."""
        return self._machine.elements.index(element) * _PITCH * self._stroke
