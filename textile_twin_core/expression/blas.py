"""Sums over arrays in one pass by BLAS, in pieces short enough for this thread alone."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.linalg.blas import daxpy

from textile_twin_core.arrays import FloatArray

SERIAL: Final = 9728
"""Elements at most, a multiple of 512: beyond 10 000 OpenBLAS wakes other threads, which cost more than they help."""

add_multiple: Final = daxpy
"""add_multiple(x, y, n, c): y += c x for (n,) contiguous arrays of float64, apart from each other, n <= SERIAL."""


def add_multiples(x: FloatArray, y: FloatArray, *factors: float) -> None:
    """y += c x for one c after the other, of arrays of any length."""
    for start in range(0, x.size, SERIAL):
        part, onto = x[start : start + SERIAL], y[start : start + SERIAL]
        for factor in factors:
            add_multiple(part, onto, part.size, factor)


def power(x: FloatArray) -> float:
    """The sum of the squares of (n,) numbers."""
    return float(sum(np.dot(part, part) for part in (x[k : k + SERIAL] for k in range(0, x.size, SERIAL))))
