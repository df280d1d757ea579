"""What happens at an instant: impulses until nothing approaches, then which touching stops stay closed."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact.complementarity import JammedError, one_sided_forces
from textile_twin_core.contact.drive_force import pad_normals, stop_normals
from textile_twin_core.contact.forces import LinearForces
from textile_twin_core.contact.model import ContactError, ContactModel
from textile_twin_core.contact.result import ContactEvent, PadState
from textile_twin_core.contact.state import ContactState

LENGTH_NOISE = 64 * 2.220446049250313e-16
"""Rounding of a gap, relative to the lengths it is the difference of."""

_NEARLY_ELASTIC = 0.99
_LOW_BOUNCE = 1e-9
_ROUNDS = 500


class Transitions:
    """Impacts and contact changes of one model.

    Impacts follow Newton's restitution with Moreau's complementarity: an approaching stop opens with restitution times
    its speed, those that rest pass impulses on, none pulls. Approaching stops that share bodies in one instant use
    the smallest of their restitutions, so that an impact never makes energy.
    """

    def __init__(self, model: ContactModel, forces: LinearForces, length_noise_m: float) -> None:
        self.model = model
        self.forces = forces
        self.length_noise_m = length_noise_m
        self.normals = stop_normals(model).T
        self.limits = np.array([stop.limit_m for stop in model.stops])
        self.pad_normals = pad_normals(model)
        self.rate_s = self._rate()

    def _rate(self) -> float:
        """Bound [1/s] on how fast the forces of springs and dampers change."""
        bodies = len(self.model.bodies)
        k = float(np.abs(self.forces.stiffness[:bodies] / self.forces.masses[:, None]).sum(axis=1).max(initial=0.0))
        b = float(np.abs(self.forces.damping[:bodies] / self.forces.masses[:, None]).sum(axis=1).max(initial=0.0))
        return max(b, math.sqrt(k), 1.0)

    def gaps(self, state: ContactState) -> FloatArray:
        """Gap of every stop [m]."""
        return self.limits + np.append(state.positions, state.drive_position_m) @ self.normals

    def opening_speeds(self, state: ContactState) -> FloatArray:
        """Speed at which every stop opens [m/s]."""
        return np.asarray(np.append(state.velocities, state.drive_velocity_m_s) @ self.normals)

    def quiet_m_s(self, state: ContactState) -> float:
        """Speed that cannot be told from zero: by the speeds there were, or by the rounding of lengths in forces."""
        return max(1e-13 * state.speed_scale_m_s, 0.1 * self.length_noise_m * self.rate_s)

    def pad_compression(self, state: ContactState, number: int) -> tuple[float, float]:
        """Compression [m] of a pad and its rate [m/s]."""
        row = self.pad_normals[number]
        depth = float(row @ np.append(state.positions, state.drive_position_m)) - self.model.pads[number].position_m
        return depth, float(row @ np.append(state.velocities, state.drive_velocity_m_s))

    def pad_force(self, state: ContactState, number: int) -> float:
        """Force [N] with which a pad pushes."""
        if state.pads[number] is not PadState.PUSHING:
            return 0.0
        depth, rate = self.pad_compression(state, number)
        pad = self.model.pads[number]
        return pad.force(depth) + pad.damping_Ns_m * rate

    def _free_opening(self, state: ContactState, drive_acceleration: float) -> FloatArray:
        """Acceleration [m/s^2] with which every stop would open if no stop pushed."""
        positions = np.append(state.positions, state.drive_position_m)
        velocities = np.append(state.velocities, state.drive_velocity_m_s)
        force = self.forces.on_movers(positions, velocities)
        for number in range(len(self.model.pads)):
            force -= self.pad_normals[number] * self.pad_force(state, number)
        accelerations = np.append(force[:-1] / self.forces.masses, drive_acceleration)
        return np.asarray(accelerations @ self.normals)

    def _opening(
        self, state: ContactState, drive_acceleration: float, candidates: list[int]
    ) -> tuple[FloatArray, FloatArray]:
        """Forces [N] in the candidate stops, and the acceleration [m/s^2] with which every stop then opens."""
        free = self._free_opening(state, drive_acceleration)
        columns = self.normals[:-1][:, candidates]
        forces, kept = one_sided_forces(columns, self.forces.masses, free[candidates])
        opening = free + (columns @ forces / self.forces.masses) @ self.normals[:-1]
        opening[candidates] = kept
        return forces, opening

    def settle(
        self,
        state: ContactState,
        drive_acceleration: float,
        hit: int | None = None,
        released: Collection[int] = (),
    ) -> list[ContactEvent]:
        """Bring the state over an instant: impulses, then the set of stops that stay closed. Changes the state.

        `hit` is the stop whose gap has just closed, `released` those whose force has come down to zero at this instant.
        """
        if hit is not None:
            self._shut(state, hit)
        gaps = self.gaps(state)
        touching = set(np.flatnonzero(gaps <= 4.0 * self.length_noise_m).tolist()) | state.closed
        if hit is not None:
            touching.add(hit)
        try:
            return self._resolve(state, drive_acceleration, sorted(touching), hit, released)
        except JammedError:
            names = ", ".join(self.model.stops[k].name for k in sorted(touching))
            raise ContactError(
                f"at {state.time_s:.9g} s the stops {names} jam a body between the driven element and the frame; "
                "set their limits so that a spring or pad stands between"
            ) from None

    def _resolve(
        self,
        state: ContactState,
        drive_acceleration: float,
        touching: list[int],
        hit: int | None,
        released: Collection[int],
    ) -> list[ContactEvent]:
        quiet = self.quiet_m_s(state)
        gentle = hit if hit is not None and self.opening_speeds(state)[hit] >= -quiet else None
        events = self._impacts(state, drive_acceleration, touching)
        speeds = self.opening_speeds(state)
        candidates = [k for k in touching if (abs(speeds[k]) <= quiet or k == gentle) and k not in released]
        forces, opening = self._opening(state, drive_acceleration, candidates)
        faint = 1e-12 * max(float(np.abs(opening).max(initial=0.0)), abs(drive_acceleration))
        closed = [k for k, force in zip(candidates, forces, strict=True) if force > 0.0]
        for k in candidates:
            # one that neither pushes nor opens stays closed, unless the others already keep it shut; one that closes
            # without a speed that could be told from zero was about to
            if k not in closed and (opening[k] <= faint or k == gentle):
                together = self.normals[:-1][:, [*closed, k]]
                if np.linalg.matrix_rank(together) > len(closed):
                    closed.append(k)
        state.closed = frozenset(closed)
        return events

    def _shut(self, state: ContactState, stop: int) -> None:
        """Take the rounding out of the gap of a stop that has just been hit, so that bounces do not add it up."""
        normal = self.normals[:-1, stop]
        mobility = normal / self.forces.masses
        state.positions = state.positions - mobility * (self.gaps(state)[stop] / float(normal @ mobility))

    def _impacts(self, state: ContactState, drive_acceleration: float, touching: list[int]) -> list[ContactEvent]:
        """Impulses, in rounds, until no touching stop approaches.

        What already opens takes no part in a round; an impact may make it approach, and the next round is its.
        Rounds without end (a body between two others in the same instant) close all gaps at last without restitution.
        """
        events: list[ContactEvent] = []
        quiet = self.quiet_m_s(state)
        for rounds_left in range(_ROUNDS, -1, -1):
            before = self.opening_speeds(state)
            taking_part = [k for k in touching if before[k] <= quiet or not rounds_left]
            struck = [group for group in self._groups(taking_part) if before[group].min() < -quiet]
            for group in struck:
                approaching = [k for k in group if before[k] < -quiet]
                restitution = min(self.model.stops[k].restitution for k in approaching) if rounds_left else 0.0
                events += self._strike(state, drive_acceleration, group, approaching, restitution)
            if not struck:
                break
        return events

    def _strike(
        self,
        state: ContactState,
        drive_acceleration: float,
        group: list[int],
        approaching: list[int],
        restitution: float,
    ) -> list[ContactEvent]:
        """The impulses of one group of touching stops; one event for each stop that takes part."""
        before, start = self.opening_speeds(state), state.velocities
        impulses = self._impulses(state, group, approaching, restitution)
        waits = self._dying_out(state, drive_acceleration, approaching, restitution) if restitution > 0.0 else None
        if waits is not None:
            state.velocities = start
            impulses = self._impulses(state, group, approaching, 0.0)
        losses = _shared(-0.5 * impulses * (before + self.opening_speeds(state))[group])
        stops = [self.model.stops[k] for k in group]
        return [
            ContactEvent(
                time_s=state.time_s + (waits or 0.0),
                kind="rest" if waits else "impact",
                name=stop.name,
                bodies=(stop.lower, stop.upper),
                booked_s=state.time_s,
                approach_speed_m_s=max(-float(before[k]), 0.0),
                impulse_Ns=impulse,
                energy_lost_J=lost,
                drive_work_J=-float(self.normals[-1, k]) * impulse * state.drive_velocity_m_s,
            )
            for k, stop, impulse, lost in zip(group, stops, impulses.tolist(), losses.tolist(), strict=True)
            if impulse > 0.0
        ]

    def _impulses(
        self, state: ContactState, group: list[int], approaching: list[int], restitution: float
    ) -> FloatArray:
        """Apply the impulses of one group of touching stops to the velocities; returns them [N s]."""
        columns = self.normals[:-1][:, group]
        factor = np.array([1.0 + restitution if k in approaching else 1.0 for k in group])
        impulses, _ = one_sided_forces(columns, self.forces.masses, factor * self.opening_speeds(state)[group])
        state.velocities = state.velocities + columns @ impulses / self.forces.masses
        return impulses

    def _dying_out(
        self, state: ContactState, drive_acceleration: float, approaching: list[int], restitution: float
    ) -> float | None:
        """Time [s] that the bounces still to come take, if they are too small to follow; None if they are not.

        Bounces of restitution e under a closing acceleration a end after 2 v / (a (1 - e)). Once that is so short
        that the acceleration cannot change by more than 1e-6 of itself, the stop closes; the event carries the time
        at which the bounces end. Without such an end (e near 1) it closes when the next bounce is lower than 1e-9 of
        the model's length.
        """
        speeds = self.opening_speeds(state)
        others = sorted(state.closed.difference(approaching))
        others = [k for k in others if abs(speeds[k]) <= self.quiet_m_s(state)]
        _, opening = self._opening(state, drive_acceleration, others)
        longest = 0.0
        for k in approaching:
            closing, speed = -float(opening[k]), float(speeds[k])
            if speed <= 0.0:
                continue
            if closing <= 0.0:
                return None
            flight = 2.0 * speed / closing
            left = flight / (1.0 - restitution) if restitution < 1.0 else math.inf
            low = restitution > _NEARLY_ELASTIC and speed * flight / 4.0 <= _LOW_BOUNCE * self.length_scale_m
            if not (low or left * self.rate_s <= 1e-6):
                return None
            longest = max(longest, left if left * self.rate_s <= 1e-6 else flight)
        return longest

    @property
    def length_scale_m(self) -> float:
        """Length [m] that rounding and tolerance are measured by."""
        return self.length_noise_m / LENGTH_NOISE

    def _groups(self, touching: list[int]) -> list[list[int]]:
        """Touching stops that share bodies, directly or through others; driven element and frame pass nothing on."""
        bodies = len(self.model.bodies)
        groups: list[tuple[set[int], list[int]]] = []
        for k in touching:
            ends = set(np.flatnonzero(self.normals[:bodies, k]).tolist())
            members = [k]
            apart = []
            for group in groups:
                if group[0] & ends:
                    ends |= group[0]
                    members += group[1]
                else:
                    apart.append(group)
            groups = [*apart, (ends, sorted(members))]
        return [members for _, members in groups]


def _shared(losses: FloatArray) -> FloatArray:
    """Losses of a group of stops, none negative, with the same sum.

    Impulse times mean speed gives what a stop takes only when it acts alone: one that hands an impulse on while it
    opens comes out negative, at the cost of the others.
    """
    positive = np.maximum(losses, 0.0)
    whole = float(positive.sum())
    return positive * (max(float(losses.sum()), 0.0) / whole) if whole > 0.0 else positive
