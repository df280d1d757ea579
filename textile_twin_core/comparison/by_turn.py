"""Sums over the samples of each turn of the shaft, for least squares whose residuals correlate within a turn."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray


def turn_normals(columns: FloatArray, place: IntArray) -> FloatArray:
    """Normal matrices (t, k, k) of columns (n, k); place: (n,) number of each sample's turn, from 0."""
    turns, count = int(place.max(initial=-1)) + 1, columns.shape[1]
    normals = np.empty((turns, count, count))
    for row in range(count):
        for column in range(row, count):
            normals[:, row, column] = np.bincount(place, weights=columns[:, row] * columns[:, column])
            normals[:, column, row] = normals[:, row, column]
    return normals


def turn_scores(columns: FloatArray, residual: FloatArray, place: IntArray) -> FloatArray:
    """Right sides (t, k) of the same turns, for residuals (n,)."""
    scores = np.empty((int(place.max(initial=-1)) + 1, columns.shape[1]))
    for k, column in enumerate(columns.T):
        scores[:, k] = np.bincount(place, weights=column * residual)
    return scores
