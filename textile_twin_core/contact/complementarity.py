"""One-sided forces: each pushes or is zero, each gap opens or stays, never both."""

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
    """N^T M^-1 N (n, n) of these stops: how much each of their forces opens each of them."""
    n = stops.size
    response = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            for body in range(plant.masses.size):
                response[i, j] += plant.stops[stops[i], body] * plant.stops[stops[j], body] / plant.masses[body]
    return response


@compiled
def depends(response: FloatArray, others: IntArray, stop: int) -> bool:
    """Whether what a stop does the others can do together, too."""
    return _own_part(response, others, stop)[0] <= _DEPENDENT * response[stop, stop]


@compiled
def _own_part(response: FloatArray, others: IntArray, stop: int) -> tuple[float, FloatArray]:
    """What is left of a stop's response when the others take up as much as they can, and with which forces."""
    n = others.size
    matrix, right = np.zeros((n, n)), np.zeros(n)
    for i in range(n):
        right[i] = response[others[i], stop]
        for j in range(n):
            matrix[i, j] = response[others[i], others[j]]
    forces = solve(matrix, right)
    left = response[stop, stop]
    for i in range(n):
        left -= right[i] * forces[i]
    return left, forces


@compiled
def one_sided_forces(response: FloatArray, opening: FloatArray) -> tuple[bool, FloatArray, FloatArray]:
    """Forces f >= 0 (n,) with w = response f + opening >= 0 and f w = 0, and w itself; False where there are none.

    `opening` (n,) is what the gaps would do with no force: their acceleration (f in N) or (1 + restitution) times
    their closing speed (f in N s). The forces are those of Gauss' principle of least constraint, found by the active
    sets of Lawson and Hanson (Solving Least Squares Problems, 1974, chapter 23). There are none where a body is
    jammed between driven element and frame.
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
    rounding = True  # that turned it to and fro, or else something else
    for k in range(n):
        rounding = rounding and result[k] >= -_STILL_CLOSING * size
    return rounding, forces, result


@compiled
def _take_in(response: FloatArray, opening: FloatArray, pushing: BoolArray, forces: FloatArray, stop: int) -> bool:
    """Let one more stop push, so that all that push keep their gaps shut; those that would pull let go."""
    others = chosen(pushing)
    left, relief = _own_part(response, others, stop)
    pushing[stop] = True
    if left <= _DEPENDENT * response[stop, stop]:
        # it relieves the others without moving anything, until one of them is free
        most, freed = math.inf, -1
        for i in range(others.size):
            if relief[i] > _DEPENDENT and forces[others[i]] / relief[i] < most:
                most, freed = forces[others[i]] / relief[i], others[i]
        if freed < 0:
            return False
        for i in range(others.size):
            forces[others[i]] -= most * relief[i]
        forces[stop] = most
        forces[freed] = 0.0
        pushing[freed] = False
    while True:
        active = chosen(pushing)
        n = active.size
        matrix, right = np.zeros((n, n)), np.zeros(n)
        for i in range(n):
            right[i] = -opening[active[i]]
            for j in range(n):
                matrix[i, j] = response[active[i], active[j]]
        wanted = solve(matrix, right)
        way, freed = 1.0, -1
        for i in range(n):
            now = forces[active[i]]
            if wanted[i] <= 0.0 and now / (now - wanted[i] + 1e-300) <= way:
                way, freed = now / (now - wanted[i] + 1e-300), active[i]
        for i in range(n):
            forces[active[i]] += way * (wanted[i] - forces[active[i]])
        if freed < 0:
            return True
        forces[freed] = 0.0
        pushing[freed] = False
