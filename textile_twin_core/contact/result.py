"""Results of contact integration: segments with their power series, and events with their impulses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact.log import RELEASE, Log
from textile_twin_core.contact.model import ContactModel
from textile_twin_core.contact.state import PadState

_KINDS = ("impact", "rest", "release", "touch", "leave", "slack", "push")
"""Names of kinds in the order of the log's numbers."""


@dataclass(frozen=True)
class ContactEvent:
    """An event at one instant.

    Its kind is "impact" (on a stop), "rest" (the bounces on a stop have died out), "release" (a closed stop opens),
    "touch" / "leave" (a pad), "slack" / "push" (a touched pad loses or regains contact force).
    """

    time_s: float
    """time of the event; for "rest" the end of the bounces, slightly after the instant of their record"""
    kind: str
    name: str
    """the stop or pad"""
    bodies: tuple[str, str]
    """its lower and upper end"""
    booked_s: float
    approach_speed_m_s: float = 0.0
    impulse_Ns: float = 0.0
    energy_lost_J: float = 0.0
    drive_work_J: float = 0.0
    """work that the driven element does through this impulse"""


@dataclass(frozen=True)
class Segment:
    """A stretch of motion without event, each quantity a power series in u = (t - start) / span over 0 <= u <= 1."""

    start_s: float
    span_s: float
    pads: tuple[PadState, ...]
    positions: FloatArray
    """(movers, order+1) [m]: the bodies, then the driven element"""
    pad_forces: FloatArray
    """(all pads, order) [N]"""
    stop_forces: FloatArray
    """(all stops, order-1) [N]"""

    @property
    def end_s(self) -> float:
        """End time [s]."""
        return self.start_s + self.span_s

    @property
    def velocities(self) -> FloatArray:
        """(movers, order) [m/s]."""
        return np.asarray(self.positions[:, 1:] * np.arange(1.0, self.positions.shape[1]) / self.span_s)

    def motion(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Evaluate positions, velocities and accelerations (movers, times) at times inside the segment."""
        u = (times_s - self.start_s) / self.span_s
        index = np.arange(float(self.positions.shape[1]))
        powers = u ** index[:, None]
        slopes = self.positions[:, 1:] * index[1:]
        bends = slopes[:, 1:] * index[1:-1]
        return (
            self.positions @ powers,
            slopes @ powers[:-1] / self.span_s,
            bends @ powers[:-2] / self.span_s**2,
        )


def events_of(model: ContactModel, log: Log, origin_s: float = 0.0) -> list[ContactEvent]:
    """Return the events in a log whose time counts from an origin."""
    events: list[ContactEvent] = []
    if not log.counts[0]:
        return events
    for time_s, kind, number, booked_s, *amounts in log.events[: log.counts[0]].tolist():
        part = (model.stops if kind <= RELEASE else model.pads)[int(number)]
        ends = (part.lower, part.upper)
        times = (time_s + origin_s, booked_s + origin_s)
        events.append(ContactEvent(times[0], _KINDS[int(kind)], part.name, ends, times[1], *amounts))
    return events


def segments_of(model: ContactModel, log: Log) -> list[Segment]:
    """Return the stretches of motion in a log."""
    movers = len(model.bodies) + 1
    stops = movers + len(model.pads)
    segments = []
    for (start_s, span_s, order, *pads), table in zip(log.heads[: log.counts[1]].tolist(), log.series, strict=False):
        n = int(order)
        states = tuple(PadState(int(pad)) for pad in pads)
        series = (table[:movers, : n + 1], table[movers:stops, :n], table[stops:, : n - 1])
        segments.append(Segment(start_s, span_s, states, *series))
    return segments
