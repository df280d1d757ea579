"""Polynomials on [0, 1] in powers of u: the first downward crossing, with none missed, and exact integrals."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from textile_twin_core.arrays import FloatArray

_SMALLEST_WIDTH = 2.0**-46


@lru_cache(maxsize=128)
def bernstein_matrix(degree: int) -> FloatArray:
    """Matrix (degree+1, degree+1) that takes power coefficients, as rows times it, to Bernstein coefficients on [0, 1].

    A polynomial lies between its smallest and its largest Bernstein coefficient: all positive means that it has
    no root on the interval, whatever its shape between samples.
    """
    matrix = np.zeros((degree + 1, degree + 1))
    for power in range(degree + 1):
        for index in range(power, degree + 1):
            matrix[power, index] = math.comb(index, power) / math.comb(degree, power)
    return matrix


@lru_cache(maxsize=128)
def _halves(degree: int) -> tuple[FloatArray, FloatArray]:
    """Matrices that take Bernstein coefficients (as a row) on an interval to those on its left and right half."""
    left = np.zeros((degree + 1, degree + 1))
    for index in range(degree + 1):
        for source in range(index + 1):
            left[source, index] = math.comb(index, source) / 2.0**index
    right = left[::-1, ::-1].copy()
    return left, right


@lru_cache(maxsize=128)
def gram_matrix(size: int) -> FloatArray:
    """Integrals over [0, 1] of u^(i+j), shape (size, size): a @ G @ b is the integral of the product of a and b."""
    index = np.arange(size)
    return np.asarray(1.0 / (index[:, None] + index[None, :] + 1.0), dtype=np.float64)


def value(coefficients: FloatArray, u: float) -> float:
    """Value at u of the polynomial with these power coefficients, lowest first (Horner)."""
    total = 0.0
    for coefficient in coefficients[::-1].tolist():
        total = total * u + coefficient
    return total


def rescale(coefficients: FloatArray, factor: float) -> FloatArray:
    """Coefficients in u/factor instead of u, along the last axis: what spans [0, factor] comes to span [0, 1]."""
    return coefficients * factor ** np.arange(coefficients.shape[-1])


def first_crossing(coefficients: FloatArray, noise: float) -> float | None:
    """Smallest u in [0, 1] from which on the polynomial is negative, or None.

    A start value, slope, curvature ... below `noise` counts as zero, so that a function that starts from zero upwards
    (a stop that has just opened) is not taken for a crossing, and one that starts downwards is found at u = 0.
    Roots are isolated by the sign changes of Bernstein coefficients (Descartes' rule), leftmost first; a pair
    of roots inside one step is therefore found, a touch without crossing (down to `noise`) is passed over.
    """
    significant = np.flatnonzero(np.abs(coefficients) > noise)
    if significant.size == 0:
        return None
    order = int(significant[0])
    if coefficients[order] < 0.0:
        return 0.0
    rest = coefficients[order:]
    degree = rest.size - 1
    bernstein = rest @ bernstein_matrix(degree)
    if bernstein.min() > 0.0:
        return None
    left_half, right_half = _halves(degree)
    pending = [(0.0, 1.0, bernstein)]
    while pending:
        low, high, local = pending.pop()
        if local.min() * high**order >= -noise:
            continue
        negative = local < 0.0
        changes = int(np.count_nonzero(negative[1:] != negative[:-1]))
        if changes == 0:
            if negative[0]:
                return low
            continue
        if changes == 1 and not negative[0]:
            root = _bisect(rest, low, high)
            if _dip(rest, root, order) >= noise:
                return root
            continue
        if high - low < _SMALLEST_WIDTH:
            return low
        middle = 0.5 * (low + high)
        pending.append((middle, high, local @ right_half))
        pending.append((low, middle, local @ left_half))
    return None


def _dip(coefficients: FloatArray, root: float, order: int) -> float:
    """How far below zero u^order times the polynomial goes after a downward root, by its slope and curvature there."""
    function = slope = bend = 0.0
    for coefficient in coefficients[::-1].tolist():
        bend = bend * root + slope
        slope = slope * root + function
        function = function * root + coefficient
    if bend <= 0.0:
        return math.inf
    lowest = min(root - 0.5 * slope / bend, 1.0)
    return 0.25 * slope * slope / bend * lowest**order


def _bisect(coefficients: FloatArray, low: float, high: float) -> float:
    """The one root in [low, high] where the polynomial turns negative: Newton, kept inside by bisection."""
    powers = coefficients[::-1].tolist()
    u = 0.5 * (low + high)
    for _ in range(100):
        function = 0.0
        slope = 0.0
        for coefficient in powers:
            slope = slope * u + function
            function = function * u + coefficient
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


def earliest_crossing(rows: FloatArray, noise: FloatArray) -> tuple[int, float] | None:
    """Row and place of the earliest downward crossing among polynomials (rows, order+1), or None.

    One matrix product rules out every row whose Bernstein coefficients are all positive.
    """
    if rows.shape[0] == 0:
        return None
    lowest = (rows @ bernstein_matrix(rows.shape[1] - 1)).min(axis=1)
    best: tuple[int, float] | None = None
    for row in np.flatnonzero((lowest <= 0.0) | (rows[:, 0] <= noise)):
        place = first_crossing(rows[row], float(noise[row]))
        if place is not None and (best is None or place < best[1]):
            best = (int(row), place)
    return best
