"""Residuals sorted by shaft angle and by revolution: where in the turn, and when, measured and predicted differ."""

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
    """

    centre_rad: FloatArray
    count: IntArray
    mean_Nm: FloatArray
    std_Nm: FloatArray
    min_Nm: FloatArray
    max_Nm: FloatArray


@dataclass(frozen=True, slots=True)
class RevolutionErrors:
    """Residuals of each revolution that holds samples; every array is (revolutions,).

    Attributes:
        number: revolution, floor(theta / 2 pi).
        start_ns: stamp of its first sample.
        count: residuals in it.
        rms_Nm, mean_Nm: of the residual. worst_Nm: the residual of largest size, with its sign.
        worst_rad: its shaft angle, 0 to 2 pi. worst_ns: its stamp.
    """

    number: IntArray
    start_ns: IntArray
    count: IntArray
    rms_Nm: FloatArray
    mean_Nm: FloatArray
    worst_Nm: FloatArray
    worst_rad: FloatArray
    worst_ns: IntArray


class RunningAngleBins:
    """Running statistics of residuals by shaft angle; independent of the size of the blocks that come in.

    Means and squared departures of blocks are merged pairwise (Chan, Golub and LeVeque 1979), without
    cancellation in long runs.
    """

    def __init__(self, bins: int) -> None:
        self._bins = bins
        self._count = np.zeros(bins, dtype=np.int64)
        self._mean = np.zeros(bins)
        self._departure = np.zeros(bins)
        self._low, self._high = np.full(bins, np.inf), np.full(bins, -np.inf)

    def add(self, theta_rad: FloatArray, residual_Nm: FloatArray) -> None:
        """Take residuals (n,) at angles (n,), all finite."""
        phase = np.mod(theta_rad, TWO_PI)
        place = np.minimum((phase * (self._bins / TWO_PI)).astype(np.int64), self._bins - 1)
        count = np.bincount(place, minlength=self._bins)
        mean = np.bincount(place, weights=residual_Nm, minlength=self._bins) / np.maximum(count, 1)
        squares = np.bincount(place, weights=(residual_Nm - mean[place]) ** 2, minlength=self._bins)
        total = self._count + count
        share = count / np.maximum(total, 1)
        shift = np.where(count > 0, mean - self._mean, 0.0)
        self._departure += squares + shift**2 * self._count * share
        self._mean += shift * share
        self._count = total
        np.minimum.at(self._low, place, residual_Nm)
        np.maximum.at(self._high, place, residual_Nm)

    def bins(self) -> AngleBins:
        """Return the bins of all residuals so far."""
        full = self._count > 0
        spread = np.sqrt(self._departure / np.maximum(self._count, 1))
        return AngleBins(
            centre_rad=np.arange(0.5, self._bins, dtype=np.float64) * (TWO_PI / self._bins),
            count=self._count.copy(),
            mean_Nm=np.where(full, self._mean, np.nan),
            std_Nm=np.where(full, spread, np.nan),
            min_Nm=np.where(full, self._low, np.nan),
            max_Nm=np.where(full, self._high, np.nan),
        )


def bin_by_angle(theta_rad: FloatArray, residual_Nm: FloatArray, bins: int) -> AngleBins:
    """Sort residuals (n,) into `bins` equal bins of the angle."""
    running = RunningAngleBins(bins)
    running.add(theta_rad, residual_Nm)
    return running.bins()


def by_revolution(stamps_ns: IntArray, theta_rad: FloatArray, residual_Nm: FloatArray) -> RevolutionErrors:
    """Sort (n,) samples, in order of time, by the revolution of the shaft."""
    turn = np.floor(theta_rad / TWO_PI).astype(np.int64)
    number, first, place = np.unique(turn, return_index=True, return_inverse=True)
    del turn  # an hour's arrays are large
    count = np.bincount(place)
    # Within a revolution the largest residual comes last.
    worst = np.lexsort((np.abs(residual_Nm), place))[np.cumsum(count) - 1]
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
