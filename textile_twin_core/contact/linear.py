"""Small systems of linear equations."""

from __future__ import annotations

from typing import Any

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.compiling import compiled

NONE: Any = np.int64(-1)
"""Stands for no stop or pad; a numpy number, since numba compiles a plain constant separately for each value."""
_DEPENDENT = 1e-11


@compiled
def solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve matrix x = right for x (n,), with a Gram matrix (n, n) of vectors of which none is zero.

    Gaussian elimination with pivots from the diagonal. Unknowns of linearly dependent vectors come out as zero.
    """
    n = right.size
    a, b, x = matrix.copy(), right.copy(), np.zeros(right.size)
    order = np.zeros(n, np.int64)
    for k in range(n):
        order[k] = k
    rank = 0
    while rank < n:
        best = rank
        for k in range(rank + 1, n):
            row, leader = order[k], order[best]
            if a[row, row] * matrix[leader, leader] > a[leader, leader] * matrix[row, row]:
                best = k
        order[rank], order[best] = order[best], order[rank]
        pivot = order[rank]
        if a[pivot, pivot] <= _DEPENDENT * matrix[pivot, pivot]:
            break
        rank += 1
        for k in range(rank, n):
            row = order[k]
            factor = a[row, pivot] / a[pivot, pivot]
            b[row] -= factor * b[pivot]
            for i in range(rank, n):
                a[row, order[i]] -= factor * a[pivot, order[i]]
    for k in range(rank - 1, -1, -1):
        row = order[k]
        total = b[row]
        for i in range(k + 1, rank):
            total -= a[row, order[i]] * x[order[i]]
        x[row] = total / a[row, row]
    return x


@compiled
def chosen(flags: BoolArray) -> IntArray:
    """Return the indices whose flag is set, in order."""
    numbers = np.zeros(flags.size, np.int64)
    count = 0
    for k in range(flags.size):
        if flags[k]:
            numbers[count] = k
            count += 1
    return numbers[:count].copy()
