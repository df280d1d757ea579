"""Huber's loss, for residuals with outliers."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray

HUBER = 1.345
"""Bound in standard deviations beyond which residuals count linearly (Huber 1964)."""


def robust_scale(residual: FloatArray) -> float:
    """1.4826 times the median of |residual|, never quite zero."""
    size = np.abs(residual)
    return 1.4826 * float(np.median(size)) + 1e-12 * float(np.max(size, initial=0.0)) + 1e-300


def huber_weights(residual: FloatArray, scale: float) -> FloatArray:
    """Weights of a least-squares step that minimises Huber's loss."""
    return np.minimum(1.0, HUBER * scale / np.maximum(np.abs(residual), 1e-300))


def huber_loss(residual: FloatArray, scale: float) -> FloatArray:
    """Twice Huber's loss of each residual over the scale, so that small residuals count by their square."""
    size = np.abs(residual) / scale
    return np.where(size <= HUBER, size**2, 2.0 * HUBER * size - HUBER**2)
