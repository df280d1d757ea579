"""Event-driven integration: from event to event without sampling, exact where the equations are linear."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact.drive import DrivePiece
from textile_twin_core.contact.forces import LinearForces
from textile_twin_core.contact.linear_segment import LinearFlow
from textile_twin_core.contact.mode import Mode, derivative
from textile_twin_core.contact.model import ContactError, ContactModel
from textile_twin_core.contact.monitors import Crossing, Noise, first_event
from textile_twin_core.contact.pad_segment import PadFlow
from textile_twin_core.contact.result import ContactEvent, PadState, Segment
from textile_twin_core.contact.state import ContactState
from textile_twin_core.contact.transitions import LENGTH_NOISE, Transitions

_PAD_KIND = {
    (PadState.OFF, PadState.PUSHING): "touch",
    (PadState.PUSHING, PadState.OFF): "leave",
    (PadState.SLACK, PadState.OFF): "leave",
    (PadState.PUSHING, PadState.SLACK): "slack",
    (PadState.SLACK, PadState.PUSHING): "push",
}


@dataclass
class Progress:
    """What one advance has brought: the stretches of motion and the events between them."""

    segments: list[Segment] = field(default_factory=list)
    events: list[ContactEvent] = field(default_factory=list)


class ContactIntegrator:
    """Integrates one model, piece by piece of its driven element's motion.

    `tolerance` bounds the error of each step on a pad, relative to the way made in it; stretches without a pad do not
    depend on it. `events_largest` bounds the events of one `advance`: beyond it ContactError names the contact.
    """

    def __init__(self, model: ContactModel, tolerance: float = 1e-13, events_largest: int = 100_000) -> None:
        if not 1e-16 <= tolerance <= 1e-3:
            raise ContactError(f"tolerance is {tolerance!r}; give one between 1e-16 and 1e-3")
        self.model = model
        self.tolerance = tolerance
        self.events_largest = events_largest
        self.forces = LinearForces.of(model)
        lengths = [abs(stop.limit_m) for stop in model.stops]
        lengths += [abs(pad.position_m) for pad in model.pads]
        lengths += [abs(spring.free_length_m) for spring in model.springs]
        self._set_scale(max(lengths, default=0.0))
        stiffness = float(np.abs(self.forces.stiffness).sum(axis=1).max())
        self._still_force_N = stiffness * self._length_m + float(np.abs(self.forces.constant).max())
        self._damping_Ns_m = float(np.abs(self.forces.damping).sum(axis=1).max())
        self._modes: dict[frozenset[int], Mode] = {}
        self._linear: dict[frozenset[int], LinearFlow] = {}
        self._on_pads: dict[tuple[frozenset[int], tuple[int, ...]], PadFlow] = {}

    def _set_scale(self, length_m: float) -> None:
        self._length_m = length_m if length_m > 0.0 else 1.0
        self.transitions = Transitions(self.model, self.forces, LENGTH_NOISE * self._length_m)

    def start(
        self,
        positions_m: Sequence[float] | FloatArray,
        drive_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
        velocities_m_s: Sequence[float] | FloatArray | None = None,
        time_s: float = 0.0,
    ) -> ContactState:
        """State at the given positions (bodies,), the driven element at (position, velocity, acceleration).

        Bodies move along with the driven element unless velocities are given. Raises ContactError when a position
        lies beyond a stop.
        """
        positions = np.array(positions_m, dtype=float)
        count = len(self.model.bodies)
        if positions.shape != (count,):
            raise ContactError(f"the start has positions of shape {positions.shape}; give {count}, one for each body")
        velocities = np.full(count, drive_m[1]) if velocities_m_s is None else np.array(velocities_m_s, dtype=float)
        if velocities.shape != (count,):
            raise ContactError(f"the start has velocities of shape {velocities.shape}; give {count}, one for each body")
        if not (np.isfinite(positions).all() and np.isfinite(velocities).all() and np.isfinite(drive_m).all()):
            raise ContactError("the start has a value that is not finite")
        fastest = max(float(np.abs(velocities).max(initial=0.0)), abs(drive_m[1]))
        floor = 1e-6 * self._length_m * self.transitions.rate_s
        off = (PadState.OFF,) * len(self.model.pads)
        state = ContactState(
            time_s, positions, velocities, drive_m[0], drive_m[1], frozenset(), off, max(fastest, floor)
        )
        gaps = self.transitions.gaps(state)
        for stop, gap in zip(self.model.stops, gaps.tolist(), strict=True):
            if gap < -1e3 * LENGTH_NOISE * self._length_m:
                raise ContactError(
                    f"the start lies {-gap:.3e} m beyond stop {stop.name} between {stop.lower} and {stop.upper}; "
                    "move the bodies or the stop"
                )
        for number, pad in enumerate(self.model.pads):
            depth, _ = self.transitions.pad_compression(state, number)
            if depth > 0.0:
                self._switch_pad(state, number, PadState.PUSHING)
                if self.transitions.pad_force(state, number) < 0.0 and not pad.pulls:
                    self._switch_pad(state, number, PadState.SLACK)
        self.transitions.settle(state, drive_m[2])
        return state

    def advance(self, state: ContactState, piece: DrivePiece) -> Progress:
        """Carry the state, which it changes, to the end of one piece of the drive; pieces follow without a gap."""
        progress = Progress()
        self._meet(state, piece, progress)
        stalled = 0
        released: set[int] = set()
        while state.time_s < piece.end_s:
            longest = piece.end_s - state.time_s
            segment = self._step(state, piece, longest)
            crossing = first_event(
                self.model,
                segment,
                self.transitions.normals,
                self.transitions.limits,
                self.transitions.pad_normals,
                self._noise(state),
            )
            if crossing is None:
                end = piece.end_s if segment.span_s >= longest else segment.end_s
                self._arrive(state, segment, end)
                progress.segments.append(segment)
                stalled = 0
                released.clear()
                continue
            if crossing.u > 0.0:
                segment = segment.cut(crossing.u)
                self._arrive(state, segment, min(segment.end_s, piece.end_s))
                progress.segments.append(segment)
                stalled = 0
                released.clear()
            stalled += 1
            self._handle(state, crossing, piece, released, progress)
            if stalled > 20 + 10 * len(self.model.stops) or len(progress.events) > self.events_largest:
                part = self.model.pads if isinstance(crossing.kind, PadState) else self.model.stops
                raise ContactError(
                    f"{part[crossing.number].name}: {len(progress.events)} events up to {state.time_s:.9g} s, no end; "
                    "give it a restitution below 1 or some damping"
                )
        return progress

    def mode(self, closed: frozenset[int]) -> Mode:
        """Equations of motion with these stops closed, made once."""
        if closed not in self._modes:
            self._modes[closed] = Mode(self.model, self.forces, closed)
        return self._modes[closed]

    def beginning(self, state: ContactState, piece: DrivePiece) -> Segment:
        """The step that begins at the state while the drive goes on as the piece says; the state is left as it is."""
        return self._step(state, piece, piece.end_s - state.time_s)

    def _meet(self, state: ContactState, piece: DrivePiece, progress: Progress) -> None:
        """Take over the drive's state at the start of a piece; a step of its velocity strikes what it touches."""
        position, velocity, acceleration = piece.state(state.time_s)
        jump = position - state.drive_position_m
        if abs(jump) > 1e-9 * self._length_m + 4.0 * math.ulp(state.time_s) * abs(velocity):
            raise ContactError(
                f"the driven element jumps by {jump:.3e} m at {state.time_s:.9g} s; give a motion without jumps"
            )
        change = abs(velocity - state.drive_velocity_m_s)
        state.drive_position_m, state.drive_velocity_m_s = position, velocity
        state.speed_scale_m_s = max(state.speed_scale_m_s, abs(velocity))
        if change > 1e-12 * state.speed_scale_m_s:
            progress.events += self.transitions.settle(state, acceleration)

    def _step(self, state: ContactState, piece: DrivePiece, longest_s: float) -> Segment:
        mode = self.mode(state.closed)
        coordinates, speeds = mode.coordinates(state.positions, state.velocities)
        pushing = tuple(k for k, pad in enumerate(state.pads) if pad is PadState.PUSHING)
        if pushing:
            key = (state.closed, pushing)
            if key not in self._on_pads:
                self._on_pads[key] = PadFlow(mode, pushing, self.tolerance)
            span, positions, forces = self._on_pads[key].step(
                coordinates, speeds, piece, state.time_s, longest_s, state.speed_scale_m_s
            )
        else:
            if state.closed not in self._linear:
                self._linear[state.closed] = LinearFlow(mode)
            span, positions = self._linear[state.closed].step(coordinates, speeds, piece, state.time_s, longest_s)
            forces = np.zeros((0, positions.shape[1] - 1))
        order = positions.shape[1] - 1
        pad_forces = np.zeros((len(state.pads), order))
        pad_forces[list(pushing)] = forces
        stop_forces = np.zeros((0, order - 1))
        if mode.closed:
            on_bodies = -(self.transitions.pad_normals[:, :-1].T @ pad_forces[:, : order - 1])
            stop_forces = mode.stop_forces(positions, span, on_bodies)
        return Segment(state.time_s, span, positions, mode.closed, stop_forces, state.pads, pad_forces)

    def _noise(self, state: ContactState) -> Noise:
        late = 2.0 * math.ulp(state.time_s) * state.speed_scale_m_s  # the drive goes on from the time as rounded
        return Noise(
            LENGTH_NOISE * self._length_m + late,
            1e-13 * (self._still_force_N + self._damping_Ns_m * state.speed_scale_m_s),
        )

    @staticmethod
    def _arrive(state: ContactState, segment: Segment, time_s: float) -> None:
        """Put the state at the end of a segment."""
        positions = segment.positions.sum(axis=1)
        velocities = derivative(segment.positions).sum(axis=1) / segment.span_s
        state.time_s = time_s
        state.positions, state.drive_position_m = positions[:-1], float(positions[-1])
        state.velocities, state.drive_velocity_m_s = velocities[:-1], float(velocities[-1])
        state.speed_scale_m_s = max(state.speed_scale_m_s, float(np.abs(velocities).max()))

    def _handle(
        self, state: ContactState, crossing: Crossing, piece: DrivePiece, released: set[int], progress: Progress
    ) -> None:
        acceleration = piece.state(state.time_s)[2]
        number = crossing.number
        if isinstance(crossing.kind, PadState):
            pad = self.model.pads[number]
            kind = _PAD_KIND[state.pads[number], crossing.kind]
            _, rate = self.transitions.pad_compression(state, number)
            self._switch_pad(state, number, crossing.kind)
            released.clear()
            progress.events.append(
                ContactEvent(
                    state.time_s,
                    kind,
                    pad.name,
                    (pad.lower, pad.upper),
                    state.time_s,
                    approach_speed_m_s=rate if kind == "touch" else 0.0,
                )
            )
            progress.events += self.transitions.settle(state, acceleration)
        elif crossing.kind == "release":
            stop = self.model.stops[number]
            progress.events.append(
                ContactEvent(state.time_s, "release", stop.name, (stop.lower, stop.upper), state.time_s)
            )
            state.closed = state.closed - {number}
            released.add(number)
            progress.events += self.transitions.settle(state, acceleration, released=released)
        else:
            if number in released:
                # its force vanished within the tolerance only: it has not opened yet
                released.discard(number)
                _take_back(progress.events, self.model.stops[number].name)
            progress.events += self.transitions.settle(state, acceleration, number, released)

    @staticmethod
    def _switch_pad(state: ContactState, number: int, to: PadState) -> None:
        state.pads = (*state.pads[:number], to, *state.pads[number + 1 :])


def _take_back(events: list[ContactEvent], name: str) -> None:
    """Remove the last release of a stop."""
    for k in range(len(events) - 1, -1, -1):
        if events[k].kind == "release" and events[k].name == name:
            del events[k]
            return
