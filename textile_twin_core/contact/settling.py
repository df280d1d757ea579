"""Instants: impulses until no stop approaches, then the set of touching stops that stay closed."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import BoolArray
from textile_twin_core.compiling import compiled
from textile_twin_core.contact.balance import opening_accelerations
from textile_twin_core.contact.complementarity import depends, response_of
from textile_twin_core.contact.impacts import collide
from textile_twin_core.contact.linear import NONE, chosen
from textile_twin_core.contact.log import Log
from textile_twin_core.contact.plant import Plant
from textile_twin_core.contact.polynomials import largest
from textile_twin_core.contact.state import LENGTH_NOISE, ContactState, gap, opening_speed, quiet_speed

_TOUCHING = 4.0
_FAINT = 1e-12


@compiled
def settle(plant: Plant, state: ContactState, drive_acceleration: float, hit: int, log: Log) -> bool:
    """Update the state over an instant: impulses, then the set of stops that stay closed.

    `hit` is the stop whose gap has just closed, or NONE. The result is False if the touching stops, which then are all
    closed in the state, jam a body between driven element and frame.
    """
    if hit != NONE:
        _shut(plant, state, hit)
    touching = state.closed.copy()
    for stop in range(touching.size):
        if stop == hit or gap(plant, state, stop) <= _TOUCHING * LENGTH_NOISE * plant.length_m:
            touching[stop] = True
    quiet = quiet_speed(plant, state)
    gentle = hit if hit != NONE and opening_speed(plant, state, hit) >= -quiet else NONE
    possible = collide(plant, state, drive_acceleration, touching, log)
    possible = possible and _choose_closed(plant, state, drive_acceleration, touching, gentle)
    for stop in range(touching.size):
        state.closed[stop] = state.closed[stop] if possible else touching[stop]
    return possible


@compiled
def _shut(plant: Plant, state: ContactState, stop: int) -> None:
    """Remove the rounding from the gap of a stop that has just been hit, so that bounces do not accumulate it."""
    mobility = 0.0
    for body in range(plant.masses.size):
        mobility += plant.stops[stop, body] ** 2 / plant.masses[body]
    excess = gap(plant, state, stop) / mobility
    for body in range(plant.masses.size):
        state.positions[body] -= plant.stops[stop, body] / plant.masses[body] * excess


@compiled
def _choose_closed(
    plant: Plant, state: ContactState, drive_acceleration: float, touching: BoolArray, gentle: int
) -> bool:
    """Close the stops that push, and those that neither push nor open; return False where they jam a body."""
    quiet = quiet_speed(plant, state)
    resting = touching.copy()
    for stop in range(touching.size):
        still = abs(opening_speed(plant, state, stop)) <= quiet or stop == gentle
        resting[stop] = touching[stop] and still and not state.released[stop]
    candidates = chosen(resting)
    possible, forces, opening = opening_accelerations(plant, state, drive_acceleration, candidates)
    faint = _FAINT * max(largest(opening), abs(drive_acceleration))
    response = response_of(plant, candidates)
    shut = np.zeros(candidates.size, np.bool_)
    for c in range(candidates.size):
        shut[c] = forces[c] > 0.0
    for c in range(candidates.size):
        # A stop that neither pushes nor opens stays closed, unless the others already keep it closed. A stop whose
        # closing speed cannot be distinguished from zero also closes.
        keeps = opening[candidates[c]] <= faint or candidates[c] == gentle
        if not shut[c] and keeps and not depends(response, chosen(shut), c):
            shut[c] = True
    for stop in range(touching.size):
        state.closed[stop] = False
    for c in range(candidates.size):
        state.closed[candidates[c]] = shut[c]
    return possible
