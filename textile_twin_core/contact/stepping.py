"""Steps from event to event along one piece of the drive, without sampling."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from textile_twin_core.compiling import compiled
from textile_twin_core.contact.drive_series import DriveTerms, taylor
from textile_twin_core.contact.flow import arrive, step
from textile_twin_core.contact.linear import NONE
from textile_twin_core.contact.log import (
    LEAVE,
    PUSHES,
    RELEASE,
    SLACKENS,
    TOUCH,
    Log,
    add_event,
    add_stretch,
    is_full,
    take_back_release,
)
from textile_twin_core.contact.mode import Mode, set_mode, stop_forces
from textile_twin_core.contact.monitors import CLOSES, RELEASES, TURNS_OFF, TURNS_SLACK, first_event
from textile_twin_core.contact.plant import Plant
from textile_twin_core.contact.polynomials import largest, stretch
from textile_twin_core.contact.settling import settle
from textile_twin_core.contact.state import EPSILON, OFF, PUSHING, SLACK, ContactState, forget_releases, pad_compression

BEGINS, FOLLOWS, RESUMES = range(3)
"""Start of an advance: with a state to be settled, at the start of a piece, or inside a piece."""

ARRIVED, FULL, JUMPS, JAMMED, TIED, ENDLESS_STOP, ENDLESS_PAD, DIVERGES = range(8)
"""Outcomes of an advance."""

_ACCELERATION: Any = np.int64(2)
_JUMP = 1e-9
_SAME_SPEED = 1e-12


@compiled
def advance(
    plant: Plant,
    mode: Mode,
    state: ContactState,
    drive: DriveTerms,
    begin: int,
    log: Log,
    tolerance: float,
    events_largest: int,
) -> tuple[int, int]:
    """Advance the state to the end of one piece of the drive; return the outcome and the responsible stop or pad.

    Events and motion are appended to the log. If the log is FULL, the caller RESUMES with more capacity. `mode` is a
    work array.
    """
    unsettled = False
    x, v, a = drive_at(drive, state.clock[0])
    if begin != RESUMES:
        if abs(x - state.positions[-1]) > _JUMP * plant.length_m + 8.0 * EPSILON * abs(state.clock[0] * v):
            return JUMPS, NONE
        unsettled = _take_over(state, x, v) or begin == BEGINS
    hit, kind, which, stalled = NONE, CLOSES, NONE, 0
    possible = set_mode(plant, state.closed, mode)
    while True:
        if unsettled:
            if not settle(plant, state, a, hit, log):
                return JAMMED, NONE
            if stalled > 20 + 10 * state.closed.size or log.counts[0] > events_largest:
                return ENDLESS_STOP if kind <= RELEASES else ENDLESS_PAD, which
            possible = set_mode(plant, state.closed, mode)
        now = state.clock[0]
        longest = drive.end_s - now
        if longest <= 0.0:
            return ARRIVED, NONE
        if not possible:
            return TIED, NONE
        if is_full(plant, log):
            return FULL, NONE
        span, series = step(plant, mode, state, drive, longest, tolerance)
        forces = stop_forces(plant, state.closed, series, span)
        place, kind, which = first_event(plant, state, series, forces, span)
        unsettled = place < math.inf
        end = drive.end_s if span >= longest else now + span
        if unsettled and place > 0.0:
            span *= place
            stretch(series, place)
            stretch(forces, place)
            end = min(now + span, drive.end_s)
        if place > 0.0:
            add_stretch(log, state, span, series, forces)
            arrive(state, series, span, end)
            stalled = 0
            forget_releases(state)
            stands_still = end <= now and not unsettled
            if stands_still or not math.isfinite(largest(state.velocities)):
                return DIVERGES, NONE
        if unsettled:
            stalled += 1
            _, _, a = drive_at(drive, state.clock[0])
            hit = _happen(plant, state, kind, which, log)


@compiled
def drive_at(drive: DriveTerms, time_s: float) -> tuple[float, float, float]:
    """Evaluate position [m], velocity [m/s] and acceleration [m/s^2] of the driven element."""
    series = taylor(drive, time_s, 1.0, _ACCELERATION)
    return series[0], series[1], 2.0 * series[2]


@compiled
def _take_over(state: ContactState, position: float, velocity: float) -> bool:
    """Apply the drive's motion at the start of a piece; return True where its velocity steps."""
    change = abs(velocity - state.velocities[-1])
    state.positions[-1], state.velocities[-1] = position, velocity
    state.clock[1] = max(state.clock[1], abs(velocity))
    return bool(change > _SAME_SPEED * state.clock[1])


@compiled
def _happen(plant: Plant, state: ContactState, kind: int, which: int, log: Log) -> int:
    """Apply an event to the state and log it; return the stop that it meets, or NONE."""
    now, written, speed = state.clock[0], RELEASE, 0.0
    if kind == CLOSES:
        if state.released[which]:
            # the force vanished only within the tolerance: the stop has not opened yet
            state.released[which] = False
            take_back_release(log, which)
        return which
    if kind == RELEASES:
        state.closed[which] = False
        state.released[which] = True
    else:
        before = state.pads[which]
        forget_releases(state)
        if kind == TURNS_OFF:
            state.pads[which], written = OFF, LEAVE
        elif kind == TURNS_SLACK:
            state.pads[which], written = SLACK, SLACKENS
        else:
            state.pads[which], written = PUSHING, PUSHES
            if before == OFF:
                written = TOUCH
                _, speed = pad_compression(plant, state, which)
    add_event(log, now, written, which, now, speed, 0.0, 0.0, 0.0)
    return NONE
