"""Balance of forces at an instant: opening accelerations of the stops, and the forces that keep them closed."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.compiling import compiled
from textile_twin_core.contact.complementarity import one_sided_forces, response_of
from textile_twin_core.contact.plant import Plant, linear_force
from textile_twin_core.contact.state import ContactState, pad_force


@compiled
def opening_accelerations(
    plant: Plant, state: ContactState, drive_acceleration: float, candidates: IntArray
) -> tuple[bool, FloatArray, FloatArray]:
    """Solve the forces [N] in the candidate stops, and the acceleration [m/s^2] with which every stop then opens.

    The first result is False if the candidates jam a body.
    """
    opening = _free_openings(plant, state, drive_acceleration)
    free = np.zeros(candidates.size)
    for c in range(candidates.size):
        free[c] = opening[candidates[c]]
    possible, forces, kept = one_sided_forces(response_of(plant, candidates), free)
    for k in range(opening.size):
        for c in range(candidates.size):
            for body in range(plant.masses.size):
                response = plant.stops[k, body] * plant.stops[candidates[c], body] / plant.masses[body]
                opening[k] += response * forces[c]
    for c in range(candidates.size):
        opening[candidates[c]] = kept[c]
    return possible, forces, opening


@compiled
def _free_openings(plant: Plant, state: ContactState, drive_acceleration: float) -> FloatArray:
    """Compute the acceleration [m/s^2] with which every stop would open without stop forces."""
    bodies = plant.masses.size
    accelerations = np.zeros(bodies + 1)
    for body in range(bodies):
        force = linear_force(plant, body, state.positions, state.velocities)
        for pad in range(state.pads.size):
            force -= plant.pads[pad, body] * pad_force(plant, state, pad)
        accelerations[body] = force / plant.masses[body]
    accelerations[bodies] = drive_acceleration
    openings = np.zeros(plant.limits.size)
    for stop in range(openings.size):
        for mover in range(bodies + 1):
            openings[stop] += plant.stops[stop, mover] * accelerations[mover]
    return openings
