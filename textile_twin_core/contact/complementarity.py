"""Complementarity of one-sided forces: each pushes or is zero, each gap opens or stays closed, never both."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.compiling import compiled
from textile_twin_core.contact.linear import NONE, chosen, solve
from textile_twin_core.contact.plant import Plant
from textile_twin_core.contact.polynomials import largest

_CLOSING = 1e-13
_STILL_CLOSING = 1e-9
_DEPENDENT = 1e-9
_ROUNDS = 20


@compiled
def response_of(plant: Plant, stops: IntArray) -> FloatArray:
    """Compute N^T M^-1 N (n, n) of these stops: the opening of each stop per unit force of each."""
    n = stops.size
    response = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            for body in range(plant.masses.size):
                response[i, j] += plant.stops[stops[i], body] * plant.stops[stops[j], body] / plant.masses[body]
    return response


@compiled
def depends(response: FloatArray, others: IntArray, stop: int) -> bool:
    """Return whether a stop's effect is a combination of those of the others."""
    return _own_part(response, others, stop)[0] <= _DEPENDENT * response[stop, stop]


@compiled
def _own_part(response: FloatArray, others: IntArray, stop: int) -> tuple[float, FloatArray]:
    """Compute the residual of a stop's response after the others compensate as much as they can, and their forces."""
    n = others.size
    matrix, right = np.zeros((n, n)), np.zeros(n)
    for i in range(n):
        right[i] = response[others[i], stop]
        for j in range(n):
            matrix[i, j] = response[others[i], others[j]]
    forces = solve(matrix, right)
    own = response[stop, stop]
    for i in range(n):
        own -= right[i] * forces[i]
    return own, forces


@compiled
def one_sided_forces(response: FloatArray, opening: FloatArray) -> tuple[bool, FloatArray, FloatArray]:
    """Solve for forces f >= 0 (n,) with w = response f + opening >= 0 and f w = 0.

    `opening` (n,) is the motion of the gaps without forces: their acceleration (f in N) or (1 + restitution) times
    their closing speed (f in N s). The forces are those of Gauss' principle of least constraint.

    Returns:
        Whether a solution exists, f, and w. There is none where a body is jammed between driven element and frame.

    References:
        Lawson and Hanson, Solving Least Squares Problems, 1974, chapter 23: the active sets.
    """
    n = opening.size
    forces, result = np.zeros(n), opening.copy()
    pushing = np.zeros(n, np.bool_)
    size = largest(opening)
    for _ in range(_ROUNDS * (n + 1)):
        worst = NONE
        for k in range(n):
            if not pushing[k] and result[k] < -_CLOSING * size and (worst < 0 or result[k] < result[worst]):
                worst = k
        if worst < 0:
            return True, forces, result
        if not _take_in(response, opening, pushing, forces, worst):
            return False, forces, result
        for k in range(n):
            result[k] = opening[k]
            for j in range(n):
                result[k] += response[k, j] * forces[j]
            if pushing[k]:
                result[k] = 0.0
    rounding = True  # whether only rounding made the active set alternate
    for k in range(n):
        rounding = rounding and result[k] >= -_STILL_CLOSING * size
    return rounding, forces, result


@compiled
def _take_in(response: FloatArray, opening: FloatArray, pushing: BoolArray, forces: FloatArray, stop: int) -> bool:
    """Activate one more stop so that all active stops keep their gaps closed; deactivate those that would pull."""
    others = chosen(pushing)
    own, relief = _own_part(response, others, stop)
    pushing[stop] = True
    if own <= _DEPENDENT * response[stop, stop]:
        # the stop takes load from the others without any motion, until one of them is free
        load, leaving = math.inf, -1
        for i in range(others.size):
            if relief[i] > _DEPENDENT and forces[others[i]] / relief[i] < load:
                load, leaving = forces[others[i]] / relief[i], others[i]
        if leaving < 0:
            return False
        for i in range(others.size):
            forces[others[i]] -= load * relief[i]
        forces[stop] = load
        forces[leaving] = 0.0
        pushing[leaving] = False
    while True:
        active = chosen(pushing)
        n = active.size
        matrix, right = np.zeros((n, n)), np.zeros(n)
        for i in range(n):
            right[i] = -opening[active[i]]
            for j in range(n):
                matrix[i, j] = response[active[i], active[j]]
        target = solve(matrix, right)
        share, leaving = 1.0, -1
        for i in range(n):
            now = forces[active[i]]
            if target[i] <= 0.0 and now / (now - target[i] + 1e-300) <= share:
                share, leaving = now / (now - target[i] + 1e-300), active[i]
        for i in range(n):
            forces[active[i]] += share * (target[i] - forces[active[i]])
        if leaving < 0:
            return True
        forces[leaving] = 0.0
        pushing[leaving] = False
