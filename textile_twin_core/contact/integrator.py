"""Event-driven integration without sampling, exact where the equations are linear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact import stepping
from textile_twin_core.contact.drive import IDENTITY, DrivePiece
from textile_twin_core.contact.log import Log, empty_log, with_room, written
from textile_twin_core.contact.mode import room_for_mode
from textile_twin_core.contact.model import ContactModel
from textile_twin_core.contact.plant import plant_of
from textile_twin_core.contact.result import ContactEvent, Segment, events_of, segments_of
from textile_twin_core.contact.state import LENGTH_NOISE, ContactState, PadState
from textile_twin_core.errors import ContactError

_BEYOND = 1e3
_SLOW = 1e-6


@dataclass(frozen=True)
class Advance:
    """Result of one advance: stretches of motion and the events between them."""

    model: ContactModel
    log: Log

    @cached_property
    def segments(self) -> list[Segment]:
        """Return the contiguous stretches of motion."""
        return segments_of(self.model, self.log)

    @cached_property
    def events(self) -> list[ContactEvent]:
        """Return the events in order."""
        return events_of(self.model, self.log)


class ContactIntegrator:
    """Integrator of one model, over pieces of its driven element's motion.

    `tolerance` bounds the error of each step on a pad, relative to the distance moved in it; stretches without a pad do
    not depend on it. `events_largest` bounds the events of one `advance`, above which ContactError names the contact.
    The integrator reuses its work arrays, so each thread needs its own.
    """

    def __init__(self, model: ContactModel, tolerance: float = 1e-13, events_largest: int = 100_000) -> None:
        if not 1e-16 <= tolerance <= 1e-3:
            raise ContactError(f"tolerance is {tolerance!r}; give one between 1e-16 and 1e-3")
        self.model = model
        self.plant = plant_of(model)
        self.tolerance = float(tolerance)
        self.events_largest = events_largest
        self._mode, self._log = room_for_mode(self.plant), empty_log(self.plant)

    def check(self, positions_m: Sequence[float]) -> None:
        """Raise ContactError if bodies cannot start at these positions (bodies,), with the driven element at 0."""
        self._check_stops(np.append(positions_m, 0.0))

    def start(
        self,
        positions_m: Sequence[float] | FloatArray,
        drive_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
        velocities_m_s: Sequence[float] | FloatArray | None = None,
        time_s: float = 0.0,
    ) -> ContactState:
        """Return the state at the given positions (bodies,) and drive (position, velocity, acceleration).

        Bodies move with the driven element unless velocities are given. Raises ContactError for a position beyond a
        stop.
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
        plant = self.plant
        places, speeds = np.append(positions, drive_m[0]), np.append(velocities, drive_m[1])
        self._check_stops(places)
        state = ContactState(
            clock=np.array([time_s, max(float(np.abs(speeds).max()), _SLOW * plant.length_m * plant.rate_s)]),
            positions=places,
            velocities=speeds,
            closed=np.zeros(len(self.model.stops), dtype=bool),
            released=np.zeros(len(self.model.stops), dtype=bool),
            pads=np.array(self._pad_states(places, speeds), dtype=np.int64),
        )
        here = DrivePiece(time_s, time_s, IDENTITY, (drive_m[0], drive_m[1], 0.5 * drive_m[2]))
        self._advance(state, here, stepping.BEGINS)
        return state

    def _check_stops(self, positions: FloatArray) -> None:
        """Raise ContactError if positions (movers,) lie beyond a stop."""
        gaps = self.plant.stops @ positions + self.plant.limits
        for stop, gap in zip(self.model.stops, gaps.tolist(), strict=True):
            if gap < -_BEYOND * LENGTH_NOISE * self.plant.length_m:
                raise ContactError(
                    f"the start lies {-gap:.3e} m beyond stop {stop.name} between {stop.lower} and {stop.upper}; "
                    "move the bodies or the stop"
                )

    def _pad_states(self, positions: FloatArray, velocities: FloatArray) -> list[PadState]:
        """Determine the states of the pads at the start."""
        depths = (self.plant.pads @ positions - self.plant.pad_places).tolist()
        rates = (self.plant.pads @ velocities).tolist()
        states = []
        for pad, depth, rate in zip(self.model.pads, depths, rates, strict=True):
            pushes = pad.pulls or pad.force(depth) + pad.damping_Ns_m * rate >= 0.0
            states.append(PadState.OFF if depth <= 0.0 else PadState.PUSHING if pushes else PadState.SLACK)
        return states

    def advance(self, state: ContactState, piece: DrivePiece) -> Advance:
        """Advance the state in place to the end of one piece of the drive; pieces must be contiguous."""
        return self._advance(state, piece, stepping.FOLLOWS)

    def _advance(self, state: ContactState, piece: DrivePiece, begin: int) -> Advance:
        state.released[:] = False
        self._log.counts[:] = 0
        end, number = stepping.FULL, 0
        while end == stepping.FULL:
            end, number = stepping.advance(
                self.plant, self._mode, state, piece.motion, begin, self._log, self.tolerance, self.events_largest
            )
            if end == stepping.FULL:
                self._log, begin = with_room(self._log), stepping.RESUMES
        if end != stepping.ARRIVED:
            raise self._failure(end, number, state, piece, self._log)
        return Advance(self.model, written(self._log))

    def _failure(self, end: int, number: int, state: ContactState, piece: DrivePiece, log: Log) -> ContactError:
        """Word an error with its place and a remedy."""
        time_s = state.time_s
        if end == stepping.JUMPS:
            jump = piece.state(time_s)[0] - float(state.positions[-1])
            return ContactError(f"the driven element steps by {jump:.3e} m at {time_s:.9g} s; give a continuous motion")
        if end == stepping.JAMMED:
            return self._jam(state)
        if end == stepping.TIED:
            return ContactError(
                f"closed stops ({self._closed(state)}) tie the driven element to the frame: nothing can give way; "
                "set the limits so that a spring or pad stands between them"
            )
        if end == stepping.DIVERGES:
            return ContactError(f"the computation fails at {time_s:.9g} s; look for a wrong unit")
        part = (self.model.stops if end == stepping.ENDLESS_STOP else self.model.pads)[number]
        return ContactError(
            f"{part.name}: {log.counts[0]} events up to {time_s:.9g} s, no end; "
            "give it a restitution below 1 or some damping"
        )

    def _jam(self, state: ContactState) -> ContactError:
        return ContactError(
            f"at {state.time_s:.9g} s the stops {self._closed(state)} jam a body between the driven element and the"
            " frame; set their limits so that a spring or pad stands between"
        )

    def _closed(self, state: ContactState) -> str:
        return ", ".join(stop.name for stop, shut in zip(self.model.stops, state.closed, strict=True) if shut)
