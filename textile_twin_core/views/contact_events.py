"""Contact events of a contact machine in a recording: time, place and speed of impacts, and the state of each pad."""

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
from textile_twin_core.views.recording_writer import at_times, scalars

_CONTACTS = ("impact", "touch")
_PRESSED = {"touch": "pressed", "push": "pressed", "leave": "free", "slack": "free"}
_SHOWN_S = 0.05
"""Time that the mark of a contact stays in the picture of the blocks."""
_BOUNCE_S = 0.005
"""A contact that follows the previous one within this time counts as a bounce."""
_SOFT_M_S = 0.02
"""Least approach speed of a contact that is counted and marked; slower ones appear over time only."""
COLOURS = ((255, 110, 160), (255, 166, 48), (64, 190, 255), (214, 150, 230))


@dataclass
class _Tally:
    """Contacts of one stop or pad, for the summary."""

    contacts: int = 0
    bounces: int = 0
    last_s: float = -np.inf
    speed_m_s: float = 0.0
    impulse_Ns: float = 0.0


class ContactDrawing:
    """Drawing of the contact events at stops and pads of a machine.

    Args:
        machine: Machine to draw.
        stream: Stream to draw into.
        place: Function that returns an element's position [m] at times (n,), up to the latest sample.
        row: Function that returns the position of an element's block across the line [m].
        reach: Half the length of a mark across the line [m].
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
        self._tallies = {part.name: _Tally() for part in parts}

    def prepare(self) -> None:
        """Set colours and names."""
        for name, colour in self._colours.items():
            stem = rr.SeriesLines(
                colors=[palette.dim(colour, 0.7)],
                names=[name],
                widths=[1.4],
                aggregation_policy=rr.components.AggregationPolicy.MinMax,
            )
            self._stream.log(f"contacts/{name}", stem, static=True)
            for plot, size in ((f"contacts/{name}/top", 3.5), (f"position/at_{name}", 4.5)):
                dots = rr.SeriesPoints(colors=[colour], names=[f"at {name}"], markers=["circle"], marker_sizes=[size])
                self._stream.log(plot, dots, static=True)
        states = {"free": palette.FREE, "pressed": palette.IN_BACKING}
        for pad in self._pads:
            style = rr.StateConfiguration(values=list(states), colors=list(states.values()))
            self._stream.log(f"pads/{pad}", style, static=True)

    def draw(self, happened: Sequence[tuple[float, ContactEvent]]) -> None:
        """Draw events with their times [s], in order of time."""
        for name, (_, upper) in self._ends.items():
            mine = [(time, event) for time, event in happened if event.name == name]
            contacts = [(time, event) for time, event in mine if event.kind in _CONTACTS]
            if contacts:
                times = np.array([time for time, _ in contacts])
                speeds = np.array([event.approach_speed_m_s for _, event in contacts])
                self._stems(name, times, speeds)
                scalars(self._stream, f"position/at_{name}", times, 1e3 * self._place(upper, times))
                self._flash(name, contacts)
            if name in self._pads:
                changes = [(time, _PRESSED[event.kind]) for time, event in mine if event.kind in _PRESSED]
                if changes:
                    at, states = zip(*changes, strict=True)
                    columns = rr.StateChange.columns(state=list(states))
                    self._stream.send_columns(f"pads/{name}", at_times(np.array(at)), columns)

    def summary(self) -> list[str]:
        """Return the rows of a Markdown table: pair in contact, last speed, last impulse, number of contacts."""
        rows = ["| between | at | impulse | contacts |", "|---|---|---|---|"]
        for name, tally in self._tallies.items():
            lower, upper = (end.replace("_", " ") for end in self._ends[name])
            speed = f"{tally.speed_m_s:.2f} m/s" if tally.contacts else ""
            impulse = f"{tally.impulse_Ns * 1e3:.2f} mN s" if tally.contacts and name not in self._pads else ""
            bounces = f", {tally.bounces} bounces" if tally.bounces else ""
            rows.append(
                f"| {name.replace('_', ' ')}: {upper} on {lower} | {speed} | {impulse} | {tally.contacts}{bounces} |"
            )
        return rows

    def _stems(self, name: str, times: FloatArray, speeds: FloatArray) -> None:
        """Draw a line from zero to each speed, with a dot at its end."""
        zero, gap = np.zeros_like(speeds), np.full_like(speeds, np.nan)
        scalars(self._stream, f"contacts/{name}", np.repeat(times, 3), np.column_stack([zero, speeds, gap]).ravel())
        scalars(self._stream, f"contacts/{name}/top", times, speeds)

    def _flash(self, name: str, contacts: Sequence[tuple[float, ContactEvent]]) -> None:
        """Mark the place of each contact for a moment; bounces are counted without a mark."""
        tally, (_, upper) = self._tallies[name], self._ends[name]
        entity, row = f"elements/contacts/{name}", self._row(upper)
        for time, event in contacts:
            if event.approach_speed_m_s < _SOFT_M_S:
                continue
            if time < tally.last_s + _BOUNCE_S:
                tally.bounces += event.kind == "impact"
                tally.last_s = time
                continue
            tally.contacts += 1
            tally.last_s, tally.speed_m_s, tally.impulse_Ns = time, event.approach_speed_m_s, event.impulse_Ns
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
