"""The smallest value of an expression over a range of the shaft angle."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.expression import Expr, interpret
from textile_twin_core.expression.loop import Numpy

_SAMPLES = 2049
_ROUNDS = 6


def values_over(value: Expr, theta: FloatArray) -> FloatArray:
    """The values (n,) of an expression of theta at (n,) angles [rad]; NaN where it has none."""
    with np.errstate(invalid="ignore", divide="ignore"):
        found = interpret([value], {"theta": theta}, Numpy)[0]
    return np.array(np.broadcast_to(np.asarray(found, dtype=np.float64), theta.shape))


def smallest_value(value: Expr, range_rad: tuple[float, float]) -> tuple[float, float]:
    """Where an expression of theta is smallest in a range [rad], and how small, to rounding.

    The grid closes in on its smallest value. Where the expression has no value, the angle and minus infinity.
    """
    low, high = range_rad
    best = (low, math.inf)
    for _ in range(_ROUNDS):
        theta = np.linspace(low, high, _SAMPLES)
        found = values_over(value, theta)
        if np.isnan(found).any():
            return float(theta[np.isnan(found)][0]), -math.inf
        i = int(np.argmin(found))
        if found[i] < best[1]:
            best = (float(theta[i]), float(found[i]))
        low, high = float(theta[max(i - 1, 0)]), float(theta[min(i + 1, theta.size - 1)])
        if not high - low > 1e-12:
            break
    return best
