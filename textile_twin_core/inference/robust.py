"""Huber's loss, for residuals with outliers."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray

HUBER = 1.345
"""Bound in standard deviations beyond which residuals count linearly (Huber 1964)."""


_NO_BIAS = 1e-3
"""Harmonic of the rounding error, over the step, that has no effect."""


def robust_scale(residual: FloatArray) -> float:
    """1.4826 times the median of |residual|, never quite zero; of none, as of no error."""
    size = np.abs(residual)
    return 1.4826 * (float(np.median(size)) if size.size else 0.0) + 1e-12 * float(np.max(size, initial=0.0)) + 1e-300


def rms(values: FloatArray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def rounding_bias(expected: FloatArray, one: float, step: float, scale: float) -> FloatArray:
    """Mean error (m,) of readings that are rounded to a step, given the torque without noise.

    Where the noise is smaller than the step, this error follows the torque and so repeats in every turn of the shaft
    (Widrow and Kollar 2008, Quantization Noise, ch. 9).

    Args:
        expected: (m,) torque without noise. one: a reading. step: of the readings, 0 for none.
        scale: standard deviation of reading less expected torque, rounding included.
    """
    if not step:
        return np.zeros_like(expected)
    noise = math.sqrt(max(scale**2 / step**2 - 1.0 / 12.0, 0.0))
    phase = 2.0 * math.pi * (expected - one) / step
    sizes = ((k, (-1) ** k * step / (math.pi * k) * math.exp(-2.0 * (math.pi * k * noise) ** 2)) for k in (1, 2, 3))
    waves = [size * np.sin(k * phase) for k, size in sizes if abs(size) > _NO_BIAS * step]
    return np.asarray(sum(waves, np.zeros_like(expected)))


def huber_weights(residual: FloatArray, scale: float) -> FloatArray:
    """Weights of a least-squares step that minimises Huber's loss."""
    return np.minimum(1.0, HUBER * scale / np.maximum(np.abs(residual), 1e-300))


def huber_loss(residual: FloatArray, scale: float) -> FloatArray:
    """Twice Huber's loss of each residual over the scale, so that small residuals count by their square."""
    size = np.abs(residual) / scale
    return np.where(size <= HUBER, size**2, 2.0 * HUBER * size - HUBER**2)
