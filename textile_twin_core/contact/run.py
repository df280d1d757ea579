"""A whole run of a contact model: its motion at any time, its events and its energy."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact.drive import DrivePiece
from textile_twin_core.contact.energy import EnergyBook, book_energy
from textile_twin_core.contact.integrator import ContactIntegrator
from textile_twin_core.contact.model import ContactModel
from textile_twin_core.contact.result import ContactEvent, Segment
from textile_twin_core.errors import ContactError


@dataclass(frozen=True)
class ContactRun:
    """Motion of every mover at the requested times, and all events."""

    model: ContactModel
    times: FloatArray
    """(times,) [s]"""
    positions: FloatArray
    """(movers, times) [m]: the bodies in the model's order, then the driven element; see `model.movers`"""
    velocities: FloatArray
    """(movers, times) [m/s]"""
    accelerations: FloatArray
    """(movers, times) [m/s^2]; at an event, those after it"""
    events: tuple[ContactEvent, ...]
    segments: tuple[Segment, ...]

    @cached_property
    def energies(self) -> EnergyBook:
        """Energy account at the ends of the segments."""
        return book_energy(self.model, list(self.segments), list(self.events))

    def happened(self, kind: str, name: str) -> tuple[ContactEvent, ...]:
        """Return the events of one kind at one stop or pad, in order of time."""
        return tuple(event for event in self.events if event.kind == kind and event.name == name)


def run_contact(
    integrator: ContactIntegrator,
    positions_m: Sequence[float] | FloatArray,
    pieces: Iterable[DrivePiece],
    times: FloatArray | None = None,
    velocities_m_s: Sequence[float] | FloatArray | None = None,
) -> ContactRun:
    """Integrate over the pieces of a drive, from positions (bodies,) at the first piece's start.

    `times` are the requested times, ascending; by default the ends of all segments. Raises ContactError without pieces
    and for a time outside them.
    """
    state = None
    segments: list[Segment] = []
    events: list[ContactEvent] = []
    for piece in pieces:
        if state is None:
            state = integrator.start(positions_m, piece.state(piece.start_s), velocities_m_s, piece.start_s)
        progress = integrator.advance(state, piece)
        segments += progress.segments
        events += progress.events
    if not segments:
        raise ContactError("the motion has no duration; give an end later than its start")
    if times is None:
        times = np.array([segments[0].start_s, *(segment.end_s for segment in segments)])
    positions, velocities, accelerations = sample(segments, np.asarray(times, dtype=float))
    return ContactRun(integrator.model, times, positions, velocities, accelerations, tuple(events), tuple(segments))


def sample(segments: Sequence[Segment], times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Evaluate positions, velocities, accelerations (movers, times) at ascending times inside consecutive segments."""
    if times.size and (times[0] < segments[0].start_s or times[-1] > segments[-1].end_s + 1e-12):
        raise ContactError(
            f"times run from {times[0]:.9g} to {times[-1]:.9g} s, the motion from {segments[0].start_s:.9g} to "
            f"{segments[-1].end_s:.9g} s; ask inside it"
        )
    starts = np.array([segment.start_s for segment in segments])
    place = np.maximum(np.searchsorted(starts, times, side="right") - 1, 0)
    shape = (segments[0].positions.shape[0], times.size)
    positions, velocities, accelerations = np.empty(shape), np.empty(shape), np.empty(shape)
    bounds = np.flatnonzero(np.diff(place)) + 1
    for first, last in zip([0, *bounds.tolist()], [*bounds.tolist(), times.size], strict=True):
        if first < last:
            part = segments[place[first]].motion(times[first:last])
            positions[:, first:last], velocities[:, first:last], accelerations[:, first:last] = part
    return positions, velocities, accelerations
