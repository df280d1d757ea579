"""The smallest value of an expression over a range of the shaft angle."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.expression import Expr, interpret
from textile_twin_core.expression.loop import Numpy

_SAMPLES = 2049
_ROUNDS = 6
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
    return min((_closing_in(value, theta, found, i) for i in _lowest(found)), key=lambda best: best[1])


def _lowest(found: FloatArray) -> list[int]:
    """Select the samples that may lie beside the minimum.

    A sample qualifies if its value less its drop to a neighbour is below the lowest sample.
    """
    before, after = np.append(found[1], found[:-1]), np.append(found[1:], found[-2])  # mirror the grid at both ends
    reach = found - (np.maximum(before, after) - found)
    least = float(found.min()) - _ROUNDING * float(np.ptp(found))
    others = np.flatnonzero((found <= before) & (found <= after) & (reach < least))
    return sorted({int(np.argmin(found)), *others.tolist()})


def _closing_in(value: Expr, theta: FloatArray, found: FloatArray, i: int) -> tuple[float, float]:
    """Refine the smallest value beside sample i of the grid."""
    best = (float(theta[i]), float(found[i]))
    for _ in range(_ROUNDS - 1):
        low, high = float(theta[max(i - 1, 0)]), float(theta[min(i + 1, theta.size - 1)])
        if not high - low > 1e-12:
            break
        theta = np.linspace(low, high, _SAMPLES)
        found = values_over(value, theta)
        if np.isnan(found).any():
            return float(theta[np.isnan(found)][0]), -math.inf
        i = int(np.argmin(found))
        if found[i] < best[1]:
            best = (float(theta[i]), float(found[i]))
    return best
