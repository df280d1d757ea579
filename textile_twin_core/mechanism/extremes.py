"""The smallest value of an expression over a range of the shaft angle."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.expression import Expr, interpret
from textile_twin_core.expression.loop import Numpy

_SAMPLES, _FINE = 2049, 129
"""Points of the first grid, and of the grid beside each of its minima."""
_ROUNDS = 6
"""Refinements; each narrows an interval by the factor 64."""
_ROUNDING = 1e-13


def values_over(value: Expr, theta: FloatArray) -> FloatArray:
    """Evaluate an expression of theta at (n,) angles [rad]; NaN where it is undefined."""
    with np.errstate(invalid="ignore", divide="ignore"):
        found = interpret([value], {"theta": theta}, Numpy)[0]
    return np.array(np.broadcast_to(np.asarray(found, dtype=np.float64), theta.shape))


def smallest_value(value: Expr, range_rad: tuple[float, float]) -> tuple[float, float]:
    """Find the angle [rad] of an expression's smallest value in a range, and that value, to rounding.

    A grid is refined around each of its minima that may hold the smallest value. Where the expression is undefined, the
    result is that angle and minus infinity.
    """
    theta = np.linspace(*range_rad, _SAMPLES)
    found = values_over(value, theta)
    if np.isnan(found).any():
        return float(theta[np.isnan(found)][0]), -math.inf
    return _refined(value, theta, found, _lowest(found))


def _lowest(found: FloatArray) -> IntArray:
    """Select the samples that may lie beside the minimum.

    A sample qualifies if its value less its drop to a neighbour is below the lowest sample.
    """
    before, after = np.append(found[1], found[:-1]), np.append(found[1:], found[-2])  # mirror the grid at both ends
    reach = found - (np.maximum(before, after) - found)
    least = float(found.min()) - _ROUNDING * float(np.ptp(found))
    others = np.flatnonzero((found <= before) & (found <= after) & (reach < least))
    return np.union1d(others, np.argmin(found))


def _refined(value: Expr, theta: FloatArray, found: FloatArray, at: IntArray) -> tuple[float, float]:
    """Refine the smallest value beside the samples `at` (k,) of a grid, all of them in one evaluation per round."""
    angle, least = theta[at], found[at]
    low, high = theta[np.maximum(at - 1, 0)], theta[np.minimum(at + 1, theta.size - 1)]
    row, parts = np.arange(at.size), np.linspace(0.0, 1.0, _FINE)
    for _ in range(_ROUNDS):
        if not (high - low > 1e-12).any():
            break
        grid = low[:, None] + (high - low)[:, None] * parts
        values = values_over(value, grid.ravel()).reshape(grid.shape)
        if np.isnan(values).any():
            return float(grid[np.isnan(values)][0]), -math.inf
        i = np.argmin(values, axis=1)
        lower = values[row, i] < least
        angle, least = np.where(lower, grid[row, i], angle), np.where(lower, values[row, i], least)
        low, high = grid[row, np.maximum(i - 1, 0)], grid[row, np.minimum(i + 1, _FINE - 1)]
    best = int(np.argmin(least))
    return float(angle[best]), float(least[best])
