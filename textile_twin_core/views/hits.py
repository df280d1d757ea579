"""Impacts and touches of a contact machine in a recording: when, where, how fast; and whether a pad is pressed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact import ContactEvent, Pad, Stop
from textile_twin_core.machine import ContactMachine
from textile_twin_core.views import palette
from textile_twin_core.views.layout import TIMELINE
from textile_twin_core.views.scribe import at_times, scalars

_HITS = ("impact", "touch")
_PRESSED = {"touch": "pressed", "push": "pressed", "leave": "free", "slack": "free"}
_SHOWN_S = 0.05
"""A hit stays in the picture of the blocks so long."""
_BOUNCE_S = 0.005
"""What strikes again within this time bounces."""
_SOFT_M_S = 0.02
"""What strikes more softly is drawn over time, and neither counted nor marked."""
COLOURS = ((255, 110, 160), (255, 166, 48), (64, 190, 255), (214, 150, 230))


@dataclass
class _Told:
    """What the summary tells of one stop or pad."""

    hits: int = 0
    bounces: int = 0
    last_s: float = -np.inf
    speed_m_s: float = 0.0
    impulse_Ns: float = 0.0


class HitDrawing:
    """Draws what happens at a machine's stops and pads.

    Args:
        machine, stream: what is drawn, and where to.
        place: an element's position [m] at times (n,), known up to the latest sample.
        row: where an element's block stands across the line [m].
        reach: half the length of the mark across the line [m].
    """

    def __init__(
        self,
        machine: ContactMachine,
        stream: rr.RecordingStream,
        place: Callable[[str, FloatArray], FloatArray],
        row: Callable[[str], float],
        reach: float,
    ) -> None:
        self._stream, self._place, self._row, self._reach = stream, place, row, reach
        self._pads = tuple(pad.name for pad in machine.pads)
        parts: tuple[Stop | Pad, ...] = (*machine.stops, *machine.pads)
        self._ends = {part.name: (part.lower, part.upper) for part in parts}
        self._colours = {part.name: COLOURS[k % len(COLOURS)] for k, part in enumerate(parts)}
        self._told = {part.name: _Told() for part in parts}

    def prepare(self) -> None:
        """Colours and names."""
        for name, colour in self._colours.items():
            stem = rr.SeriesLines(
                colors=[palette.dim(colour, 0.7)],
                names=[name],
                widths=[1.4],
                aggregation_policy=rr.components.AggregationPolicy.MinMax,
            )
            self._stream.log(f"hits/{name}", stem, static=True)
            for plot, size in ((f"hits/{name}/top", 3.5), (f"position/at_{name}", 4.5)):
                dots = rr.SeriesPoints(colors=[colour], names=[f"at {name}"], markers=["circle"], marker_sizes=[size])
                self._stream.log(plot, dots, static=True)
        states = {"free": palette.FREE, "pressed": palette.IN_BACKING}
        for pad in self._pads:
            style = rr.StateConfiguration(values=list(states), colors=list(states.values()))
            self._stream.log(f"pads/{pad}", style, static=True)

    def draw(self, happened: Sequence[tuple[float, ContactEvent]]) -> None:
        """Draw what has happened, each with its time [s], in order of time."""
        for name, (_, upper) in self._ends.items():
            mine = [(time, event) for time, event in happened if event.name == name]
            hits = [(time, event) for time, event in mine if event.kind in _HITS]
            if hits:
                times = np.array([time for time, _ in hits])
                speeds = np.array([event.approach_speed_m_s for _, event in hits])
                self._stems(name, times, speeds)
                scalars(self._stream, f"position/at_{name}", times, 1e3 * self._place(upper, times))
                self._flash(name, hits)
            if name in self._pads:
                changes = [(time, _PRESSED[event.kind]) for time, event in mine if event.kind in _PRESSED]
                if changes:
                    at, states = zip(*changes, strict=True)
                    columns = rr.StateChange.columns(state=list(states))
                    self._stream.send_columns(f"pads/{name}", at_times(np.array(at)), columns)

    def summary(self) -> list[str]:
        """Rows of a Markdown table: what struck, how fast the last time, with what impulse, how often so far."""
        rows = ["| between | at | impulse | hits |", "|---|---|---|---|"]
        for name, told in self._told.items():
            lower, upper = (end.replace("_", " ") for end in self._ends[name])
            speed = f"{told.speed_m_s:.2f} m/s" if told.hits else ""
            impulse = f"{told.impulse_Ns * 1e3:.2f} mN s" if told.hits and name not in self._pads else ""
            bounces = f", {told.bounces} bounces" if told.bounces else ""
            rows.append(
                f"| {name.replace('_', ' ')}: {upper} on {lower} | {speed} | {impulse} | {told.hits}{bounces} |"
            )
        return rows

    def _stems(self, name: str, times: FloatArray, speeds: FloatArray) -> None:
        """A line from zero to each speed, and a dot on it."""
        zero, gap = np.zeros_like(speeds), np.full_like(speeds, np.nan)
        scalars(self._stream, f"hits/{name}", np.repeat(times, 3), np.column_stack([zero, speeds, gap]).ravel())
        scalars(self._stream, f"hits/{name}/top", times, speeds)

    def _flash(self, name: str, hits: Sequence[tuple[float, ContactEvent]]) -> None:
        """A mark where the ends meet, for a moment; bounces are counted and not marked again."""
        told, (_, upper) = self._told[name], self._ends[name]
        entity, row = f"elements/hits/{name}", self._row(upper)
        for time, event in hits:
            if event.approach_speed_m_s < _SOFT_M_S:
                continue
            if time < told.last_s + _BOUNCE_S:
                told.bounces += event.kind == "impact"
                told.last_s = time
                continue
            told.hits += 1
            told.last_s, told.speed_m_s, told.impulse_Ns = time, event.approach_speed_m_s, event.impulse_Ns
            x = float(self._place(upper, np.array([time]))[0])
            mark = rr.LineStrips2D(
                [[(x, row - self._reach), (x, row + self._reach)]],
                radii=[-3.0],
                colors=[self._colours[name]],
                labels=[f"{name} {event.approach_speed_m_s:.2f} m/s"],
                draw_order=60.0,
            )
            for at, drawn in ((time, mark), (time + _SHOWN_S, rr.Clear(recursive=False))):
                self._stream.set_time(TIMELINE, duration=at)
                self._stream.log(entity, drawn)
