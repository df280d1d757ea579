"""Polynomials on [0, 1] in powers of u: guaranteed first downward crossing, series and exact integrals."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled

_SMALLEST_WIDTH = 2.0**-46
_DEEPEST = 96
"""Largest number of waiting intervals: two for each halving down to the smallest width."""


@lru_cache(maxsize=128)
def gram_matrix(size: int) -> FloatArray:
    """Return integrals over [0, 1] of u^(i+j), shape (size, size): a @ G @ b integrates the product of a and b."""
    index = np.arange(size)
    return np.asarray(1.0 / (index[:, None] + index[None, :] + 1.0), dtype=np.float64)


@compiled
def value(coefficients: FloatArray, u: float) -> float:
    """Evaluate the polynomial with these power coefficients, lowest first, at u (Horner)."""
    total = 0.0
    for k in range(coefficients.size - 1, -1, -1):
        total = total * u + coefficients[k]
    return total


@compiled
def derivative(coefficients: FloatArray) -> FloatArray:
    """Differentiate a power series by u, one order shorter."""
    result = np.zeros(coefficients.size - 1)
    for k in range(result.size):
        result[k] = (k + 1) * coefficients[k + 1]
    return result


@compiled
def largest(values: FloatArray) -> float:
    """Return the largest absolute value, 0 for an empty array; NaN propagates."""
    result = 0.0
    for k in range(values.size):
        if not abs(values[k]) <= result:
            result = abs(values[k])
    return result


@compiled
def stretch(rows: FloatArray, factor: float) -> None:
    """Rescale series in place, one per row, from u to u/factor: the interval [0, factor] becomes [0, 1]."""
    power = 1.0
    for k in range(rows.shape[1]):
        for row in range(rows.shape[0]):
            rows[row, k] *= power
        power *= factor


@compiled
def move(polynomial: FloatArray, offset: float) -> None:
    """Expand p(offset + t) in powers of t in place, by repeated synthetic division."""
    for start in range(polynomial.size - 1):
        for power in range(polynomial.size - 2, start - 1, -1):
            polynomial[power] += offset * polynomial[power + 1]


@compiled
def moved(polynomial: FloatArray, offset: float) -> FloatArray:
    """Expand p(offset + t) in powers of t."""
    result = polynomial.copy()
    move(result, offset)
    return result


@compiled
def write_bernstein(coefficients: FloatArray, result: FloatArray) -> None:
    """Write the Bernstein coefficients on [0, 1] of the polynomial with these power coefficients.

    A polynomial lies between its smallest and its largest Bernstein coefficient: if all are positive, it has no root on
    the interval.
    """
    degree = coefficients.size - 1
    choices = 1.0
    for k in range(degree + 1):
        result[k] = coefficients[k] / choices
        choices = choices * (degree - k) / (k + 1)
    for done in range(degree):
        for k in range(degree, done, -1):
            result[k] += result[k - 1]


@compiled
def first_crossing(coefficients: FloatArray, noise: float) -> float:
    """Find the smallest u in [0, 1] from which the polynomial is negative; infinity if there is none.

    A start value, slope, curvature ... below `noise` counts as zero. A function that rises from zero (a stop that has
    just opened) is therefore no crossing, and one that falls from zero crosses at u = 0. Roots are isolated by the sign
    changes of Bernstein coefficients (Descartes' rule), leftmost first. A pair of roots inside one step is found; a
    touch without crossing (down to `noise`) is passed over.
    """
    order = 0
    while order < coefficients.size and not abs(coefficients[order]) > noise:
        order += 1
    if order == coefficients.size:
        return math.inf
    if coefficients[order] < 0.0:
        return 0.0
    swing = 0.0
    for k in range(order + 1, coefficients.size):
        swing += abs(coefficients[k])
    if swing < coefficients[order]:
        return math.inf
    reduced = coefficients[order:].copy()
    degree = reduced.size - 1
    lows, highs, waiting = np.zeros(_DEEPEST), np.zeros(_DEEPEST), np.zeros((_DEEPEST, degree + 1))
    lows[0], highs[0] = 0.0, 1.0
    write_bernstein(reduced, waiting[0])
    count = 1
    while count > 0:
        count -= 1
        low, high = lows[count], highs[count]
        local = waiting[count]
        if _smallest(local) * high**order >= -noise:
            continue
        changes = 0
        for k in range(degree):
            if (local[k] < 0.0) != (local[k + 1] < 0.0):
                changes += 1
        if changes == 0:
            if local[0] < 0.0:
                return low
            continue
        if changes == 1 and local[0] >= 0.0:
            root = _root(reduced, low, high)
            if _dip(reduced, root, order) >= noise:
                return root
            continue
        if high - low < _SMALLEST_WIDTH:
            return low
        middle = 0.5 * (low + high)
        # de Casteljau: the right half stays in its row, the left_half half goes on top of the stack and is next
        left_half = waiting[count + 1]
        for done in range(degree + 1):
            left_half[done] = local[0]
            for k in range(degree - done):
                local[k] = 0.5 * (local[k] + local[k + 1])
        lows[count], highs[count] = middle, high
        lows[count + 1], highs[count + 1] = low, middle
        count += 2
    return math.inf


@compiled
def _smallest(values: FloatArray) -> float:
    result = values[0]
    for k in range(1, values.size):
        result = min(result, values[k])
    return result


@compiled
def _dip(coefficients: FloatArray, root: float, order: int) -> float:
    """Estimate the depth below zero of u^order times the polynomial after a downward root, by slope and curvature."""
    function = slope = bend = 0.0
    for k in range(coefficients.size - 1, -1, -1):
        bend = bend * root + slope
        slope = slope * root + function
        function = function * root + coefficients[k]
    if bend <= 0.0:
        return math.inf
    lowest = min(root - 0.5 * slope / bend, 1.0)
    return 0.25 * slope * slope / bend * lowest**order


@compiled
def _root(coefficients: FloatArray, low: float, high: float) -> float:
    """Find the single downward root in [low, high] by Newton's method with bisection."""
    u = 0.5 * (low + high)
    for _ in range(100):
        function = slope = 0.0
        for k in range(coefficients.size - 1, -1, -1):
            slope = slope * u + function
            function = function * u + coefficients[k]
        if function > 0.0:
            low = u
        elif function < 0.0:
            high = u
        else:
            return u
        following = u - function / slope if slope != 0.0 else low
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - u) <= 1e-17 + 2e-16 * abs(u) or high - low <= 1e-17:
            return following
        u = following
    return u
