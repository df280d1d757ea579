"""Working arrays placed for speed: each on a cache line's boundary, no two at the same place in a page."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray

_LINE = 8
"""Doubles of one cache line."""
_APART = 5 * _LINE
"""Extra distance of neighbours, so that equal samples of two arrays do not compete for one cache set."""


def aligned_rows(count: int, length: int) -> list[FloatArray]:
    """`count` uninitialised arrays (length,) of float64."""
    pitch = -(-length // _LINE) * _LINE + _APART
    memory = np.empty(count * pitch + _LINE)
    start = (-memory.ctypes.data // memory.itemsize) % _LINE
    return [memory[start + k * pitch : start + k * pitch + length] for k in range(count)]
