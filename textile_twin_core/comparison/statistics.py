"""Statistics of residuals: overall, by shaft angle, revolution, order of the shaft and speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray

TWO_PI = 2.0 * np.pi
ORDERS = 24
SPEED_BINS = 8
_CHUNK = 4096  # its powers stay in the cache: thirty times as fast as 65,536


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


@dataclass(frozen=True, slots=True)
class OrderSpectrum:
    """The residual as a Fourier series of the shaft angle; arrays are (orders + 1,), order 0 is the mean.

    amplitude_Nm, phase_rad: residual = sum amplitude cos(order theta - phase).
    """

    order: IntArray
    amplitude_Nm: FloatArray
    phase_rad: FloatArray


@dataclass(frozen=True, slots=True)
class SpeedBins:
    """Residuals by the shaft's speed, signed; arrays are (bins,), nan where a bin has no sample."""

    low_rad_s: FloatArray
    high_rad_s: FloatArray
    count: IntArray
    rms_Nm: FloatArray
    mean_Nm: FloatArray


def by_order(theta_rad: FloatArray, residual_Nm: FloatArray) -> OrderSpectrum:
    """Fit a Fourier series to residuals (n,) at angles (n,), which may be uneven or miss parts of a turn.

    Least squares over orders 0 .. 24, fewer with few samples.
    """
    most = min(ORDERS, max(0, (theta_rad.size - 1) // 4))
    orders = np.arange(most + 1)
    # sums of exp(i k theta), alone and with the residual, give the normal equations of any number of samples
    alone, weighted = np.zeros(2 * most + 1, dtype=complex), np.zeros(most + 1, dtype=complex)
    for start in range(0, theta_rad.size, _CHUNK):
        turned = np.exp(1j * theta_rad[start : start + _CHUNK])
        power, residual = np.ones_like(turned), residual_Nm[start : start + _CHUNK]
        for k in range(2 * most + 1):
            alone[k] += power.sum()
            if k <= most:
                weighted[k] += power @ residual
            power *= turned
    plus, minus = orders[:, None] + orders, orders[:, None] - orders
    even = alone[np.abs(minus)].real, alone[plus].real
    odd = np.sign(minus) * alone[np.abs(minus)].imag, alone[plus].imag
    cosines, sines, mixed = (even[0] + even[1]) / 2, (even[0] - even[1]) / 2, (odd[1] - odd[0]) / 2
    normal = np.block([[cosines, mixed[:, 1:]], [mixed[:, 1:].T, sines[1:, 1:]]])
    sides = np.concatenate([weighted.real, weighted.imag[1:]])
    found = np.linalg.lstsq(normal, sides, rcond=1e-9)[0]
    cosine, sine = found[: most + 1], np.concatenate([[0.0], found[most + 1 :]])
    return OrderSpectrum(orders, np.hypot(cosine, sine), np.arctan2(sine, cosine))


def by_speed(omega_rad_s: FloatArray, residual_Nm: FloatArray) -> SpeedBins:
    """Sort residuals (n,) into equal bins of the speed (n,), n >= 1."""
    low, high = float(omega_rad_s.min()), float(omega_rad_s.max())
    edges = np.linspace(low, high, SPEED_BINS + 1) if high > low else np.array([low, high])
    bins = edges.size - 1
    place = np.clip(np.searchsorted(edges, omega_rad_s, side="right") - 1, 0, bins - 1)
    count = np.bincount(place, minlength=bins)
    some = np.where(count > 0, count, np.nan)
    return SpeedBins(
        low_rad_s=edges[:-1],
        high_rad_s=edges[1:],
        count=count.astype(np.int64),
        rms_Nm=np.sqrt(np.bincount(place, weights=residual_Nm**2, minlength=bins) / some),
        mean_Nm=np.bincount(place, weights=residual_Nm, minlength=bins) / some,
    )
