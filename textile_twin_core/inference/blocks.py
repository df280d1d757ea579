"""Block averages with triangular weights, in which an estimated acceleration is exact.

Errors of an estimated acceleration grow with the square of the frequency and are largest at discontinuities of the
load. Its average with triangular weights is a second difference of the angle at the triangle's ends, without these
errors (modulating functions, Shinbrot 1957).
"""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray

_SAMPLES = 10.0
"""Samples in a block beyond which more add no information."""
_WHOLE = 0.7
"""Share of the usual weight of a block's samples below which the block is discarded."""
OVERLAP = 0.5
"""Twice the correlation of neighbouring averages of white noise."""
_RUN = 240
"""Consecutive samples in each part of a thinned record."""


def means(place: FloatArray, values: FloatArray, good: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Average values (n, k) with triangular weights that reach one block to either side: (b, k).

    Args:
        place: (n,) time in blocks, increasing. values: at these times. good: (n,) mask of the usable values.

    Returns the averages and a mask (b,) of those with enough samples.
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
    """Choose at most `most` of `count` samples, of which a block has `in_a_block`, in runs that fill blocks."""
    taken = np.arange(0, count, max(int(in_a_block / _SAMPLES), 1))
    if taken.size <= most:
        return taken
    runs = np.unique(np.linspace(0, taken.size // _RUN - 1, max(most // _RUN, 1)).astype(np.int64))
    return np.asarray(taken[(_RUN * runs[:, None] + np.arange(_RUN)).ravel()])
