"""Error measures of one set of residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class ErrorStatistics:
    """Measures of `residual = measured - expected`, all in N m but the ratios.

    `rms_over_peak` and `max_over_peak` are over `peak_Nm`, the largest |measured|. `correlation` is
    Pearson's, nan where one side does not vary.
    """

    rms_error_Nm: float
    rms_over_peak: float
    max_error_Nm: float
    max_over_peak: float
    bias_Nm: float
    scatter_Nm: float
    median_error_Nm: float
    correlation: float
    peak_Nm: float
    count: int


def error_statistics(measured_Nm: FloatArray, expected_Nm: FloatArray) -> ErrorStatistics:
    """Measures of n >= 1 pairs, both (n,) in N m and finite."""
    error = measured_Nm - expected_Nm
    peak = float(np.max(np.abs(measured_Nm)))
    rms = float(np.sqrt(np.mean(error**2)))
    largest = float(np.max(np.abs(error)))
    scale = peak if peak > 0.0 else float("nan")
    a, b = measured_Nm - measured_Nm.mean(), expected_Nm - expected_Nm.mean()
    size = float(np.sqrt(a @ a) * np.sqrt(b @ b))
    return ErrorStatistics(
        rms_error_Nm=rms,
        rms_over_peak=rms / scale,
        max_error_Nm=largest,
        max_over_peak=largest / scale,
        bias_Nm=float(error.mean()),
        scatter_Nm=float(error.std()),
        median_error_Nm=float(np.median(np.abs(error))),
        correlation=float(a @ b) / size if size > 0.0 else float("nan"),
        peak_Nm=peak,
        count=int(error.size),
    )


def line(expected_Nm: FloatArray, measured_Nm: FloatArray) -> tuple[float, float]:
    """Least-squares factor and offset of measured over expected torque; factor 1 for a constant one."""
    centred = expected_Nm - expected_Nm.mean()
    power = float(centred @ centred)
    constant = power <= 1e-24 * float(np.max(np.abs(expected_Nm), initial=0.0)) ** 2 * expected_Nm.size
    factor = 1.0 if constant else float(centred @ measured_Nm) / power
    return factor, float(measured_Nm.mean() - factor * expected_Nm.mean())
