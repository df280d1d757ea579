"""Mode of contact: clusters of bodies joined by closed stops, and their equations of motion."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.compiling import by_reference, compiled
from textile_twin_core.contact.linear import chosen, solve
from textile_twin_core.contact.plant import Plant

DRIVEN, FIXED = -1, -2


@by_reference
class Mode(NamedTuple):
    """Bodies joined by closed stops as one cluster, each at a constant offset from the cluster's first body.

    A cluster has the equation q'' = -stiffness q - damping q' + by_position x_drive + by_velocity v_drive + constant
    - by_pad (forces of the pads). The arrays have capacity for as many clusters as bodies.
    """

    clusters: IntArray
    """(1,): number of clusters"""
    cluster: IntArray
    """(bodies,): number of the body's cluster, DRIVEN with the driven element or FIXED to the frame"""
    offset: FloatArray
    """(bodies,) [m]"""
    first: IntArray
    """(clusters,): first body of each"""
    mass: FloatArray
    """(clusters,) [kg]"""
    stiffness: FloatArray
    """(clusters, clusters) [1/s^2]"""
    damping: FloatArray
    """(clusters, clusters) [1/s]"""
    by_position: FloatArray
    by_velocity: FloatArray
    constant: FloatArray
    by_pad: FloatArray
    """(clusters, pads) [1/kg]"""


def room_for_mode(plant: Plant) -> Mode:
    """Allocate a mode."""
    bodies, pads = plant.masses.size, plant.pad_places.size
    numbers = [np.zeros(n, np.int64) for n in (1, bodies, bodies)]
    return Mode(
        numbers[0],
        numbers[1],
        np.zeros(bodies),
        numbers[2],
        np.zeros(bodies),
        np.zeros((bodies, bodies)),
        np.zeros((bodies, bodies)),
        np.zeros(bodies),
        np.zeros(bodies),
        np.zeros(bodies),
        np.zeros((bodies, pads)),
    )


@compiled
def set_mode(plant: Plant, closed: BoolArray, mode: Mode) -> bool:
    """Write the mode with these stops closed; return False if they connect the driven element to the frame."""
    bodies = plant.masses.size
    joined, offset = _join(plant, closed)
    cluster, count = mode.cluster, 0
    for body in range(bodies):
        leader = joined[body]
        if leader == joined[bodies]:
            cluster[body] = DRIVEN
            offset[body] -= offset[bodies]
        elif leader == joined[bodies + 1]:
            cluster[body] = FIXED
            offset[body] -= offset[bodies + 1]
        elif leader == body:
            cluster[body] = count
            mode.first[count] = body
            count += 1
        else:
            cluster[body] = cluster[leader]
        mode.offset[body] = offset[body]
    mode.clusters[0] = count
    _reduce(plant, mode)
    return bool(joined[bodies] != joined[bodies + 1])


@compiled
def _join(plant: Plant, closed: BoolArray) -> tuple[IntArray, FloatArray]:
    """Return the first end joined with each end (bodies, driven element, frame), and the distance from it."""
    movers = plant.masses.size + 1
    joined, offset = np.zeros(movers + 1, np.int64), np.zeros(movers + 1)
    for end in range(movers + 1):
        joined[end] = end
    for stop in range(closed.size):
        if not closed[stop]:
            continue
        lower = upper = movers
        for mover in range(movers):
            if plant.stops[stop, mover] > 0.0:
                lower = mover
            elif plant.stops[stop, mover] < 0.0:
                upper = mover
        keep, merge = min(joined[lower], joined[upper]), max(joined[lower], joined[upper])
        if keep == merge:
            continue
        shift = offset[lower] + plant.limits[stop] - offset[upper]
        if joined[upper] == keep:
            shift = -shift
        for end in range(movers + 1):
            if joined[end] == merge:
                joined[end] = keep
                offset[end] += shift
    return joined, offset


@compiled
def _reduce(plant: Plant, mode: Mode) -> None:
    """Write the clusters' masses and equations as sums over their bodies."""
    bodies, pads = plant.masses.size, plant.pad_places.size
    for own in range(mode.clusters[0]):
        mode.mass[own] = mode.constant[own] = mode.by_position[own] = mode.by_velocity[own] = 0.0
        for other in range(mode.clusters[0]):
            mode.stiffness[own, other] = mode.damping[own, other] = 0.0
        for pad in range(pads):
            mode.by_pad[own, pad] = 0.0
    for body in range(bodies):
        if mode.cluster[body] >= 0:
            mode.mass[mode.cluster[body]] += plant.masses[body]
    for body in range(bodies):
        own = mode.cluster[body]
        if own < 0:
            continue
        mass = mode.mass[own]
        mode.constant[own] += plant.constant[body] / mass
        mode.by_position[own] -= plant.stiffness[body, bodies] / mass
        mode.by_velocity[own] -= plant.damping[body, bodies] / mass
        for other in range(bodies):
            k, b = plant.stiffness[body, other] / mass, plant.damping[body, other] / mass
            mode.constant[own] -= k * mode.offset[other]
            if mode.cluster[other] >= 0:
                mode.stiffness[own, mode.cluster[other]] += k
                mode.damping[own, mode.cluster[other]] += b
            elif mode.cluster[other] == DRIVEN:
                mode.by_position[own] -= k
                mode.by_velocity[own] -= b
        for pad in range(pads):
            mode.by_pad[own, pad] += plant.pads[pad, body] / mass


@compiled
def fastest_rate(plant: Plant, mode: Mode, pads: IntArray) -> float:
    """Bound the rates [1/s] of the mode's motion with the active pads, whose stiffness is that at first touch."""
    stiffness = damping = 0.0
    for own in range(mode.clusters[0]):
        k = b = 0.0
        for other in range(mode.clusters[0]):
            k += abs(mode.stiffness[own, other])
            b += abs(mode.damping[own, other])
        stiffness, damping = max(stiffness, k), max(damping, b)
    for pad in range(pads.size):
        strongest = 0.0
        for own in range(mode.clusters[0]):
            strongest = max(strongest, abs(mode.by_pad[own, pad]))
        if pads[pad] == 1:
            stiffness += plant.pad_stiffness[pad, 0] * strongest
            damping += plant.pad_damping[pad] * strongest
    return 0.5 * (damping + math.sqrt(damping * damping + 4.0 * stiffness))


@compiled
def stop_forces(plant: Plant, closed: BoolArray, series: FloatArray, h: float) -> FloatArray:
    """Compute the power series (stops, order-1) of the force in every closed stop; zero in the others.

    `series` (movers + pads, order+1) holds the movers' positions and the pads' forces. The stop forces are the part of
    the bodies' accelerations that these do not explain.
    """
    bodies, stops, order = plant.masses.size, closed.size, series.shape[1] - 1
    forces = np.zeros((stops, order - 1))
    numbers = chosen(closed)
    if numbers.size == 0:
        return forces
    response = _inverse_gram(plant, numbers)
    residual = np.zeros(bodies)
    for k in range(order - 1):
        for body in range(bodies):
            unexplained = plant.masses[body] * (k + 1) * (k + 2) / (h * h) * series[body, k + 2]
            if k == 0:
                unexplained -= plant.constant[body]
            for other in range(bodies + 1):
                unexplained += plant.stiffness[body, other] * series[other, k]
                unexplained += plant.damping[body, other] * (k + 1) / h * series[other, k + 1]
            for pad in range(plant.pad_places.size):
                unexplained += plant.pads[pad, body] * series[bodies + 1 + pad, k]
            residual[body] = unexplained
        for j in range(numbers.size):
            along = 0.0
            for body in range(bodies):
                along += plant.stops[numbers[j], body] * residual[body]
            for i in range(numbers.size):
                forces[numbers[i], k] += response[i, j] * along
    return forces


@compiled
def _inverse_gram(plant: Plant, stops: IntArray) -> FloatArray:
    """Invert the Gram matrix of the linearly independent stops' normals on the bodies."""
    n = stops.size
    gram, unit, inverse = np.zeros((n, n)), np.zeros(n), np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            for body in range(plant.masses.size):
                gram[i, j] += plant.stops[stops[i], body] * plant.stops[stops[j], body]
    for i in range(n):
        unit[i] = 1.0
        column = solve(gram, unit)
        unit[i] = 0.0
        for j in range(n):
            inverse[i, j] = column[j]
    return inverse
