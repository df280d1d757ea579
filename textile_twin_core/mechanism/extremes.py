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
    """The values (n,) of an expression of theta at (n,) angles [rad]; NaN where it has none."""
    with np.errstate(invalid="ignore", divide="ignore"):
        found = interpret([value], {"theta": theta}, Numpy)[0]
    return np.array(np.broadcast_to(np.asarray(found, dtype=np.float64), theta.shape))


def smallest_value(value: Expr, range_rad: tuple[float, float]) -> tuple[float, float]:
    """Where an expression of theta is smallest in a range [rad], and how small, to rounding.

    A grid closes in on each of its minima that may be the smallest one between its samples. Where the expression has no
    value, the angle and minus infinity.
    """
    theta = np.linspace(*range_rad, _SAMPLES)
    found = values_over(value, theta)
    if np.isnan(found).any():
        return float(theta[np.isnan(found)][0]), -math.inf
    return min((_closing_in(value, theta, found, i) for i in _lowest(found)), key=lambda best: best[1])


def _lowest(found: FloatArray) -> list[int]:
    """Samples beside which the smallest value may lie: below them by less than they lie below their neighbours."""
    before, after = np.append(found[1], found[:-1]), np.append(found[1:], found[-2])  # mirrored at both ends
    reach = found - (np.maximum(before, after) - found)
    least = float(found.min()) - _ROUNDING * float(np.ptp(found))
    others = np.flatnonzero((found <= before) & (found <= after) & (reach < least))
    return sorted({int(np.argmin(found)), *others.tolist()})


def _closing_in(value: Expr, theta: FloatArray, found: FloatArray, i: int) -> tuple[float, float]:
    """The smallest value beside sample i of the grid."""
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
