"""Sliding elements of a contact machine in a recording: blocks on their line, motion over time, contact events."""

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
from textile_twin_core.views.contact_events import ContactDrawing
from textile_twin_core.views.drawable import drawable
from textile_twin_core.views.layout import TIMELINE, over_time, page, time_axis
from textile_twin_core.views.recording_writer import Frames, at_times, scalars

if TYPE_CHECKING:
    from textile_twin_core.machine import ContactMachine

_LENGTH, _HEIGHT, _PITCH = 0.55, 0.12, 0.2
"""Length and height of an element's block and distance between two blocks, over the longest stroke."""
_SUMMARY_S = 0.1
"""Events within this time share one update of the summary."""
_STORED = 1000
"""Samples stored for events that arrive after their motion."""


class ElementDrawing:
    """Drawing of the elements of a machine. Positions are arrays (n, elements) in the order of `machine.elements`.

    Args:
        machine: Machine to draw.
        stream: Stream to draw into.
        frames_hz: Largest rate of pictures of the blocks [Hz].
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
        self._contacts = ContactDrawing(machine, stream, self._place, self._row, reach)

    def blueprint(self, window_s: float) -> rrb.Blueprint:
        """Return the layout: the blocks above, positions and velocities over the last `window_s` seconds below."""
        axis = time_axis(window_s, 0.05 * window_s)
        stroke, rows = self._stroke, len(self._machine.elements)
        farthest = max(self._low, *self._machine.start, *(pad.position_m for pad in self._machine.pads))
        bounds = rrb.VisualBounds2D(
            x_range=(self._low - 0.35 * stroke, farthest + (1.35 + _LENGTH) * stroke),
            y_range=(-0.3 * stroke, rows * _PITCH * stroke + 0.15 * stroke),
        )
        blocks = rrb.Spatial2DView(
            name=f"Machine: {drawable(self._machine.name)}",
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
                    ("Position, and place of each contact [mm]", "position", 1.5),
                    ("Velocity [m/s]", "velocity", 1.0),
                    ("Approach speed at stops and pads [m/s]", "contacts", 0.9),
                )
            ),
        ]
        if self._machine.pads:
            lines.append((rrb.StateTimelineView(name="Pads", origin="pads", time_view=axis), 0.6))
        views, shares = zip(*lines, strict=True)
        return page(rrb.Vertical(*views, row_shares=list(shares)))

    def prepare(self) -> None:
        """Draw the static parts."""
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
        self._contacts.prepare()
        self._sum_up(0.0)

    def happened(self, events: Sequence[tuple[float, ContactEvent]]) -> None:
        """Add impacts and touches with their times [s], in order of time. Events may arrive before their motion."""
        self._waiting += events

    def motion(self, time_s: FloatArray, positions_m: FloatArray, velocities_m_s: FloatArray) -> None:
        """Draw positions [m] and velocities [m/s] (n, elements) at times (n,) [s], and the events up to then."""
        self._time = np.concatenate([self._time[-_STORED:], time_s])
        self._places = np.concatenate([self._places[-_STORED:], positions_m])
        self._draw_contacts(float(time_s[-1]))
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

    def _draw_contacts(self, now_s: float) -> None:
        ready = [each for each in self._waiting if each[0] <= now_s]
        self._waiting = self._waiting[len(ready) :]
        while ready:
            together = [each for each in ready if each[0] <= ready[0][0] + _SUMMARY_S]
            ready = ready[len(together) :]
            self._contacts.draw(together)
            self._sum_up(together[-1][0])

    def _sum_up(self, now_s: float) -> None:
        text = "\n".join([f"### {drawable(self._machine.name)}", "", *self._contacts.summary()])
        self._stream.set_time(TIMELINE, duration=now_s)
        self._stream.log("summary", rr.TextDocument(text, media_type="text/markdown"))

    def _place(self, element: str, time_s: FloatArray) -> FloatArray:
        """Interpolate the recent position of an element [m] at times (n,)."""
        return np.interp(time_s, self._time, self._places[:, self._machine.elements.index(element)])

    def _row(self, element: str) -> float:
        """Return the position of an element's block across the line [m]."""
        return self._machine.elements.index(element) * _PITCH * self._stroke
