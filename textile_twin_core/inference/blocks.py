"""Means over blocks of time, weighed by triangles, in which an estimated acceleration is exact.

An acceleration is estimated with errors that grow with the square of the frequency and are largest where it leaps with
the load. A mean weighed by a triangle holds it as a second difference of the angle at the triangle's ends, with none of
them (modulating functions, Shinbrot 1957).
"""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray

_SAMPLES = 10.0
"""Of a block, which tell as much as more of them."""
_WHOLE = 0.7
"""Of the usual weight of a block's samples, below which some are missing and the block does not count."""
_WILD = 3.0
"""Root mean squares that count as a block's scale: only what lies beyond some of these is wild."""
_RUN = 240
"""Samples that follow each other, of a record of which not all are taken."""


def means(place: FloatArray, values: FloatArray, good: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Means (b, k) of values (n, k) over triangles that begin and end one block beside their middle.

    Args:
        place: (n,) time in blocks, increasing. values: at these. good: (n,) which of them count.

    Returns the means and where enough samples are in them, (b,).
    """
    before = np.floor(place)
    nodes, inverse = np.unique(np.concatenate([before, before + 1.0]), return_inverse=True)
    share = np.concatenate([1.0 - (place - before), place - before]) * np.tile(good, 2)
    weight = np.bincount(inverse, share, nodes.size)
    columns = np.tile(np.where(good[:, None], values, 0.0), (2, 1)) * share[:, None]
    sums = np.stack([np.bincount(inverse, column, nodes.size) for column in columns.T], axis=1)
    whole = weight > _WHOLE * float(np.median(weight))
    return sums / np.maximum(weight, 1e-300)[:, None], whole


def fewer(count: int, in_a_block: float, most: int) -> IntArray:
    """Which of `count` samples are taken, so many of them in a block, for at most `most`: runs that fill blocks."""
    taken = np.arange(0, count, max(int(in_a_block / _SAMPLES), 1))
    if taken.size <= most:
        return taken
    runs = np.unique(np.linspace(0, taken.size // _RUN - 1, max(most // _RUN, 1)).astype(np.int64))
    return np.asarray(taken[(_RUN * runs[:, None] + np.arange(_RUN)).ravel()])


def scale(residual: FloatArray) -> float:
    """Scale of Huber's loss for what is left in blocks (b,): those with a jump scatter more and tell as much."""
    return _WILD * float(np.sqrt(np.mean(residual**2))) + 1e-300
