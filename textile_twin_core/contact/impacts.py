"""Impacts: instantaneous impulses until no touching stop approaches.

The model is Newton's restitution with Moreau's complementarity. An approaching stop opens with restitution times its
speed, stops at standstill transmit impulses, and none pulls. Approaching stops that share bodies in one instant use the
smallest of their restitutions, so that an impact never creates energy.
"""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.compiling import compiled
from textile_twin_core.contact.balance import opening_accelerations
from textile_twin_core.contact.complementarity import one_sided_forces, response_of
from textile_twin_core.contact.linear import chosen
from textile_twin_core.contact.log import IMPACT, IMPACT_ROUNDS, REST, Log, add_event
from textile_twin_core.contact.plant import Plant
from textile_twin_core.contact.state import ContactState, opening_speed, quiet_speed

_NEARLY_ELASTIC = 0.99
_LOW_BOUNCE = 1e-9
_UNCHANGED = 1e-6


@compiled
def collide(plant: Plant, state: ContactState, drive_acceleration: float, touching: BoolArray, log: Log) -> bool:
    """Apply impulses in rounds until no touching stop approaches; return False where stops jam a body.

    A stop that opens takes no part in a round; if an impact makes it approach, it takes part in the next. If the rounds
    do not end (a body between two others in the same instant), all gaps finally close without restitution.
    """
    quiet = quiet_speed(plant, state)
    stops = touching.size
    speeds, taking_part, group = np.zeros(stops), np.zeros(stops, np.bool_), np.zeros(stops, np.bool_)
    for remaining_rounds in range(IMPACT_ROUNDS, -1, -1):
        for stop in range(stops):
            speeds[stop] = opening_speed(plant, state, stop)
            taking_part[stop] = touching[stop] and (speeds[stop] <= quiet or remaining_rounds == 0)
        groups = _groups(plant, taking_part)
        struck = False
        for leader in range(stops):
            approaching = False
            for stop in range(stops):
                group[stop] = groups[stop] == leader
                approaching = approaching or (group[stop] and speeds[stop] < -quiet)
            if approaching:
                struck = True
                members = chosen(group)
                if not _strike(plant, state, drive_acceleration, members, speeds, quiet, remaining_rounds == 0, log):
                    return False
        if not struck:
            break
    return True


@compiled
def _groups(plant: Plant, taking_part: BoolArray) -> IntArray:
    """Label each stop with the first of the stops that share bodies with it; -1 for inactive stops.

    Stops may share bodies directly or through others. Driven element and frame do not connect stops.
    """
    stops = taking_part.size
    groups = np.zeros(stops, np.int64)
    for stop in range(stops):
        groups[stop] = stop if taking_part[stop] else -1
        if not taking_part[stop]:
            continue
        for other in range(stop):
            if groups[other] < 0 or groups[other] == groups[stop]:
                continue
            for body in range(plant.masses.size):
                if plant.stops[stop, body] != 0.0 and plant.stops[other, body] != 0.0:
                    first, second = min(groups[stop], groups[other]), max(groups[stop], groups[other])
                    for member in range(stop + 1):
                        if groups[member] == second:
                            groups[member] = first
                    break
    return groups


@compiled
def _strike(
    plant: Plant,
    state: ContactState,
    drive_acceleration: float,
    group: IntArray,
    before: FloatArray,
    quiet: float,
    dead: bool,
    log: Log,
) -> bool:
    """Apply the impulses of one group of touching stops; write one event for each stop that takes part."""
    approaching = np.zeros(group.size, np.bool_)
    restitution = 0.0 if dead else 1.0
    for i in range(group.size):
        approaching[i] = before[group[i]] < -quiet
        if approaching[i]:
            restitution = min(restitution, plant.restitutions[group[i]])
    start = state.velocities.copy()
    possible, impulses = _apply_impulses(plant, state, group, before, approaching, restitution)
    waits = -1.0
    if possible and restitution > 0.0:
        possible, waits = _dying_out(plant, state, drive_acceleration, group, approaching, restitution)
    if possible and waits >= 0.0:
        for body in range(start.size):
            state.velocities[body] = start[body]
        possible, impulses = _apply_impulses(plant, state, group, before, approaching, 0.0)
    losses = _losses(plant, state, group, before, impulses)
    now, drive = state.clock[0], plant.masses.size
    for i in range(group.size):
        if impulses[i] > 0.0:
            stop = group[i]
            kind, end = (REST, now + waits) if waits > 0.0 else (IMPACT, now)
            work = -plant.stops[stop, drive] * impulses[i] * state.velocities[drive]
            add_event(log, end, kind, stop, now, max(-before[stop], 0.0), impulses[i], losses[i], work)
    return possible


@compiled
def _apply_impulses(
    plant: Plant, state: ContactState, group: IntArray, before: FloatArray, approaching: BoolArray, restitution: float
) -> tuple[bool, FloatArray]:
    """Solve the impulses [N s] of one group of touching stops and update the velocities; return False if impossible."""
    target = np.zeros(group.size)
    for i in range(group.size):
        target[i] = before[group[i]] * (1.0 + restitution if approaching[i] else 1.0)
    possible, impulses, _ = one_sided_forces(response_of(plant, group), target)
    for i in range(group.size):
        for body in range(plant.masses.size):
            state.velocities[body] += plant.stops[group[i], body] * impulses[i] / plant.masses[body]
    return possible, impulses


@compiled
def _losses(plant: Plant, state: ContactState, group: IntArray, before: FloatArray, impulses: FloatArray) -> FloatArray:
    """Compute the energy [J] that each stop of a group dissipates, none negative.

    Impulse times mean speed is the loss of a stop that acts alone. A stop that transmits an impulse while it opens has
    a negative value, which the other stops share.
    """
    losses = np.zeros(group.size)
    whole = positive = 0.0
    for i in range(group.size):
        losses[i] = -0.5 * impulses[i] * (before[group[i]] + opening_speed(plant, state, group[i]))
        whole += losses[i]
        losses[i] = max(losses[i], 0.0)
        positive += losses[i]
    for i in range(group.size):
        losses[i] *= max(whole, 0.0) / positive if positive > 0.0 else 0.0
    return losses


@compiled
def _dying_out(
    plant: Plant,
    state: ContactState,
    drive_acceleration: float,
    group: IntArray,
    approaching: BoolArray,
    restitution: float,
) -> tuple[bool, float]:
    """Compute the remaining time [s] of bounces too small to follow; -1 for larger bounces.

    Bounces of restitution e under a closing acceleration a end after 2 v / (a (1 - e)). The stop closes once that time
    is so short that the acceleration cannot change by more than 1e-6 of itself; the event carries the end of the
    bounces. For e near 1 the stop closes when the next bounce is lower than 1e-9 of the model's length. The first
    result is False where closed stops jam a body.
    """
    quiet = quiet_speed(plant, state)
    resting = np.zeros(state.closed.size, np.bool_)
    for stop in range(resting.size):
        resting[stop] = state.closed[stop] and abs(opening_speed(plant, state, stop)) <= quiet
    for i in range(group.size):
        if approaching[i]:
            resting[group[i]] = False
    possible, _, opening = opening_accelerations(plant, state, drive_acceleration, chosen(resting))
    longest = 0.0
    for i in range(group.size):
        closing, speed = -opening[group[i]], opening_speed(plant, state, group[i])
        if not approaching[i] or speed <= 0.0:
            continue
        if closing <= 0.0:
            return possible, -1.0
        flight = 2.0 * speed / closing
        remaining = flight / (1.0 - restitution) if restitution < 1.0 else math.inf
        low = restitution > _NEARLY_ELASTIC and speed * flight / 4.0 <= _LOW_BOUNCE * plant.length_m
        if not (low or remaining * plant.rate_s <= _UNCHANGED):
            return possible, -1.0
        longest = max(longest, remaining if remaining * plant.rate_s <= _UNCHANGED else flight)
    return possible, longest
