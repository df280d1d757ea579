"""Residuals sorted by shaft angle and by revolution: where in the turn, and when, the machine departs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray

TWO_PI = 2.0 * np.pi


@dataclass(frozen=True, slots=True)
class AngleBins:
    """Residuals in equal bins of the shaft angle; every array is (bins,), nan in a bin without samples.

    Attributes:
        centre_rad: middle of each bin, from 0 to 2 pi.
        count: residuals in the bin.
        mean_Nm, std_Nm, min_Nm, max_Nm: of the residual.
        measured_Nm, expected_Nm: mean torques of the bin.
    """

    centre_rad: FloatArray
    count: IntArray
    mean_Nm: FloatArray
    std_Nm: FloatArray
    min_Nm: FloatArray
    max_Nm: FloatArray
    measured_Nm: FloatArray
    expected_Nm: FloatArray


@dataclass(frozen=True, slots=True)
class RevolutionErrors:
    """Residuals of each revolution that holds samples; every array is (revolutions,).

    Attributes:
        number: revolution, floor(theta / 2 pi).
        start_ns: stamp of its first sample.
        count: residuals in it.
        rms_Nm, mean_Nm: of the residual. worst_Nm: the residual of largest size, with its sign.
        worst_rad: the shaft angle, 0 to 2 pi, where the worst one stands. worst_ns: its stamp.
    """

    number: IntArray
    start_ns: IntArray
    count: IntArray
    rms_Nm: FloatArray
    mean_Nm: FloatArray
    worst_Nm: FloatArray
    worst_rad: FloatArray
    worst_ns: IntArray


def bin_by_angle(
    theta_rad: FloatArray, measured_Nm: FloatArray, expected_Nm: FloatArray, bins: int
) -> AngleBins:
    """Sort (n,) samples into `bins` equal bins of the angle."""
    residual = measured_Nm - expected_Nm
    phase = np.mod(theta_rad, TWO_PI)
    place = np.minimum((phase * (bins / TWO_PI)).astype(np.int64), bins - 1)
    count = np.bincount(place, minlength=bins)
    full = np.maximum(count, 1)

    def mean(values: FloatArray) -> FloatArray:
        return np.where(count > 0, np.bincount(place, weights=values, minlength=bins) / full, np.nan)

    centre = mean(residual)
    spread = np.sqrt(mean((residual - centre[place]) ** 2))
    low, high = np.full(bins, np.inf), np.full(bins, -np.inf)
    np.minimum.at(low, place, residual)
    np.maximum.at(high, place, residual)
    return AngleBins(
        centre_rad=np.arange(0.5, bins, dtype=np.float64) * (TWO_PI / bins),
        count=count.astype(np.int64),
        mean_Nm=centre,
        std_Nm=spread,
        min_Nm=np.where(count > 0, low, np.nan),
        max_Nm=np.where(count > 0, high, np.nan),
        measured_Nm=mean(measured_Nm),
        expected_Nm=mean(expected_Nm),
    )


def by_revolution(stamps_ns: IntArray, theta_rad: FloatArray, residual_Nm: FloatArray) -> RevolutionErrors:
    """Sort (n,) samples, in order of time, by the revolution of the shaft."""
    turn = np.floor(theta_rad / TWO_PI).astype(np.int64)
    number, place = np.unique(turn, return_inverse=True)
    count = np.bincount(place)
    # Within a revolution the largest residual comes last, the earliest sample comes first.
    by_size = np.lexsort((np.abs(residual_Nm), place))
    worst = by_size[np.cumsum(count) - 1]
    by_time = np.argsort(place, kind="stable")
    first = by_time[np.cumsum(count) - count]
    return RevolutionErrors(
        number=number,
        start_ns=stamps_ns[first],
        count=count.astype(np.int64),
        rms_Nm=np.sqrt(np.bincount(place, weights=residual_Nm**2) / count),
        mean_Nm=np.bincount(place, weights=residual_Nm) / count,
        worst_Nm=residual_Nm[worst],
        worst_rad=np.mod(theta_rad[worst], TWO_PI),
        worst_ns=stamps_ns[worst],
    )
