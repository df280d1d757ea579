"""Order analysis of a rotating machine's signal: order spectrum and order-speed map by angle-synchronous resampling."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.signal import detrend, firwin, resample_poly
from scipy.signal.windows import flattop

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import RecordingError

TURN = 2.0 * np.pi
TURNS = 16
"""Turns of a window; the order resolution is 0.24 then."""
MAX_ORDER = 24.0
"""Highest order shown unless another is asked for."""
FEWEST_TURNS = 6
"""With fewer turns the main lobe of the window, five bins wide, reaches from one whole order to the next."""
PER_WINDOW = 4
"""Windows begin a quarter of their length apart, or further in a recording of many turns."""
_MOST_WINDOWS = 1000
_NOISE_BANDWIDTH = 3.77
"""Equivalent noise bandwidth of the flat-top window in bins."""
_SLOWEST = 0.05
"""Samples slower than this share of the fast speed belong to a standstill."""
_GAP = 10.0
"""Longer intervals, in usual ones, are gaps; in shorter ones the missing samples are interpolated."""
_UPSAMPLING, _HALF_LENGTH = 4, 32
"""A cubic spline through four times the samples is exact to 0.02 % at 0.8 of the Nyquist frequency."""
_LOWPASS = firwin(2 * _HALF_LENGTH * _UPSAMPLING + 1, 1.0 / _UPSAMPLING, window=("kaiser", 8.0))
_MOST_PEAKS, _LEAST_PEAK = 8, 1e-3


@dataclass(frozen=True, slots=True)
class OrderPeak:
    """A peak of an order spectrum.

    Attributes:
        order: multiple of the shaft's speed.
        amplitude: root mean square of the order's amplitude over all windows, in the unit of the signal.
        largest: largest amplitude in a window. speed_rad_s: mean speed of that window.
    """

    order: float
    amplitude: float
    largest: float
    speed_rad_s: float


@dataclass(frozen=True)
class OrderMap:
    """Amplitudes by order and window, w windows in order of time and k orders.

    A signal `a cos(o theta - phase)` has the amplitude `a` at order `o`; its RMS is `a / sqrt(2)`. The amplitude of
    order 0 is the mean.

    Attributes:
        order: (k,) multiples of the shaft's speed.
        time_s: (w,) middle of each window. speed_rad_s: (w,) its mean speed, without sign.
        amplitude: (k, w), nan where the sampling rate does not reach an order at that speed.
        turns: turns of the shaft in a window.
    """

    order: FloatArray
    time_s: FloatArray
    speed_rad_s: FloatArray
    amplitude: FloatArray
    turns: int

    @property
    def resolution(self) -> float:
        """Order resolution: equivalent noise bandwidth of the window in orders."""
        return _NOISE_BANDWIDTH / self.turns

    @cached_property
    def spectrum(self) -> FloatArray:
        """Order spectrum (k,): root mean square of each order's amplitude over the windows."""
        known = np.isfinite(self.amplitude)
        squares = np.where(known, self.amplitude, 0.0) ** 2
        return np.asarray(np.sqrt(squares.sum(axis=1) / known.sum(axis=1)))

    def over_speed(self, bins: int = 40) -> tuple[FloatArray, FloatArray]:
        """Average the map in equal bins of the speed, each 1 % of the fastest wide or more, at most one per window.

        Returns:
            Edges (b + 1,) of the bins [rad/s] and amplitudes (k, b), nan in a bin without a window.
        """
        low, high = float(self.speed_rad_s.min()), float(self.speed_rad_s.max())
        bins = int(np.clip((high - low) / (0.01 * high), 1, min(bins, self.speed_rad_s.size)))
        slack = max(0.0, 0.005 * high - 0.5 * (high - low))
        edges = np.linspace(low - slack, high + slack, bins + 1)
        place = np.clip(np.searchsorted(edges, self.speed_rad_s, side="right") - 1, 0, bins - 1)
        columns = np.full((self.order.size, bins), np.nan)
        for k in np.unique(place):
            columns[:, k] = np.sqrt(np.mean(self.amplitude[:, place == k] ** 2, axis=1))
        return edges, columns

    def peaks(self) -> list[OrderPeak]:
        """Find the largest peaks of the spectrum, largest first: at most eight, each above 0.1 % of the largest."""
        inner, reach = self.spectrum[1:], self.turns // 4
        around = np.lib.stride_tricks.sliding_window_view(np.pad(inner, reach), 2 * reach + 1)
        is_peak = (
            (inner >= around.max(axis=1)) & (inner > _LEAST_PEAK * inner.max()) & (self.order[1:] > 2.0 / self.turns)
        )
        found = []
        for k in np.flatnonzero(is_peak) + 1:
            at = int(np.nanargmax(self.amplitude[k]))
            found.append(
                OrderPeak(
                    float(self.order[k]),
                    float(self.spectrum[k]),
                    float(self.amplitude[k, at]),
                    float(self.speed_rad_s[at]),
                )
            )
        return sorted(found, key=lambda peak: -peak.amplitude)[:_MOST_PEAKS]


def order_map(
    time_s: FloatArray,
    theta_rad: FloatArray,
    values: FloatArray,
    *,
    max_order: float | None = None,
    turns: int | None = None,
) -> OrderMap:
    """Compute the order-speed map of a signal.

    Each window of whole turns is resampled at equal steps of the shaft angle and transformed under a flat-top window;
    neighbouring windows overlap by three quarters, less in a recording of many turns. Samples count as equally spaced
    in time, so that jitter of the stamps moves the angle of a sample and not its place; up to nine missing samples are
    interpolated. The map leaves out stretches with a longer gap, a reversal or a standstill.

    Args:
        time_s: (n,) times of the samples [s], increasing.
        theta_rad: (n,) unwrapped shaft angle at these times [rad].
        values: (n,) the signal, in any unit; nan where a sample is missing.
        max_order: highest order of the map; by default the highest that the sampling rate reaches at the fastest speed.
        turns: turns of a window; by default 16, or as many as there are, at least 6.

    Returns:
        The map, with amplitudes in the unit of the signal.

    Raises:
        RecordingError: the shaft does not make enough turns in one direction without a gap, or reverses before.

    Examples:
        >>> time = np.arange(20_000) / 1000.0
        >>> theta = 2.0 * np.pi * (5.0 * time + 0.2 * time**2)
        >>> found = order_map(time, theta, 3.0 * np.cos(4.0 * theta), max_order=10.0)
        >>> [(peak.order, round(peak.amplitude, 3)) for peak in found.peaks()]
        [(4.0, 3.0)]

    References:
        Fyfe, K. R., Munck, E. D. S. (1997). Analysis of computed order tracking. Mechanical Systems and Signal
        Processing 11(2), 187-205.
    """
    time_s, theta_rad, values = _filled(time_s, theta_rad, values)
    runs = _runs(time_s, theta_rad)
    longest = max((abs(float(theta_rad[b - 1] - theta_rad[a])) / TURN for a, b in runs), default=0.0)
    window = min(TURNS, int(longest)) if turns is None else turns
    if window < FEWEST_TURNS or window > longest:
        needed = FEWEST_TURNS if turns is None else max(turns, FEWEST_TURNS)
        senses = {theta_rad[b - 1] > theta_rad[a] for a, b in runs}
        if len(senses) > 1 and longest < FEWEST_TURNS:
            raise RecordingError(
                f"the shaft reverses after at most {longest:.1f} turns: orders are multiples of whole turns, and need"
                f" {needed} turns one way; compare shows such a recording over the shaft angle"
            )
        raise RecordingError(
            f"the longest stretch one way without a gap is {longest:.1f} turns of the shaft, and order analysis needs"
            f" {needed}; record longer" + ("" if turns is None else ", or ask for shorter windows")
        )
    columns: list[FloatArray] = []
    times: list[float] = []
    speeds: list[float] = []
    limits: list[float] = []
    total = sum(abs(float(theta_rad[end - 1] - theta_rad[first])) for first, end in runs)
    apart = max(window * TURN / PER_WINDOW, total / _MOST_WINDOWS)
    for first, end in runs:
        part = _decimated(time_s[first:end], theta_rad[first:end], values[first:end], max_order)
        for column, at, speed, limit in _windows(*part, window, apart):
            columns.append(column)
            times.append(at)
            speeds.append(speed)
            limits.append(limit)
    reach = min(limits) if max_order is None else min(max_order, max(limits))
    most = int(reach * window + 1e-9) + 1
    order = np.arange(most) / window
    amplitude = np.full((most, len(columns)), np.nan)
    for k, (column, limit) in enumerate(zip(columns, limits, strict=True)):
        count = min(most, column.size, int(limit * window + 1e-9) + 1)
        amplitude[:count, k] = column[:count]
    return OrderMap(order, np.array(times), np.array(speeds), amplitude, window)


def _filled(time_s: FloatArray, theta_rad: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Resample the finite samples at equal steps of time; interpolate short gaps, leave long ones."""
    finite = np.isfinite(theta_rad) & np.isfinite(values)
    time, theta, signal = time_s[finite], theta_rad[finite], values[finite]
    if time.size < 2:
        return time, theta, signal
    step = np.diff(time)
    missed = np.maximum(np.rint(step / np.median(step)), 1.0)
    missed[missed > _GAP] = 1.0
    place = np.concatenate([[0.0], np.cumsum(missed)])
    every = np.arange(place[-1] + 1.0)
    if every.size == place.size:
        return time, theta, signal
    return (
        np.interp(every, place, time),
        PchipInterpolator(place, theta)(every),
        PchipInterpolator(place, signal)(every),
    )


def _runs(time_s: FloatArray, theta_rad: FloatArray) -> list[tuple[int, int]]:
    """Stretches [first, end) without a gap, a reversal or a standstill."""
    if time_s.size < 2:
        return []
    step = np.diff(time_s)
    speed = np.diff(theta_rad) / step
    fast = float(np.quantile(np.abs(speed), 0.95))
    good = (step < (_GAP + 0.5) * np.median(step)) & (np.abs(speed) > _SLOWEST * fast)
    kind = np.where(good, np.sign(speed), 0.0)
    bounds = np.concatenate([[0], np.flatnonzero(np.diff(kind)) + 1, [kind.size]])
    return [(int(a), int(b) + 1) for a, b in pairwise(bounds) if kind[a] != 0.0]


def _highest_order(theta_rad: FloatArray) -> float:
    """The order of half the sampling rate at the fastest speed."""
    return 0.5 * TURN / float(np.quantile(np.abs(np.diff(theta_rad)), 0.98))


def _decimated(
    time_s: FloatArray, theta_rad: FloatArray, values: FloatArray, max_order: float | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Decimate a run to the fewest samples that resolve twice the highest order."""
    factor = 1 if max_order is None else int(_highest_order(theta_rad) / (2.0 * max_order))
    if factor < 2:
        return time_s, theta_rad, values
    lowpass = firwin(2 * _HALF_LENGTH * factor + 1, 1.0 / factor, window=("kaiser", 8.0))
    return (
        time_s[::factor],
        theta_rad[::factor],
        resample_poly(values, 1, factor, window=lowpass, padtype="line"),
    )


def _windows(
    time_s: FloatArray, theta_rad: FloatArray, values: FloatArray, turns: int, apart: float
) -> list[tuple[FloatArray, float, float, float]]:
    """Amplitudes by order, middle time, mean speed, and highest order of each window of a run."""
    theta = theta_rad if theta_rad[-1] > theta_rad[0] else -theta_rad
    span = turns * TURN
    found = []
    for start in np.arange(theta[0], theta[-1] - span * (1.0 - 1e-12), apart):
        first, last = np.searchsorted(theta, [start, start + span])
        part = slice(max(int(first) - _HALF_LENGTH, 0), int(last) + _HALF_LENGTH)
        angle, time = theta[part], time_s[part]
        index = PchipInterpolator(angle, np.arange(angle.size, dtype=np.float64))
        least = float(np.quantile(np.diff(angle), 0.02))  # the slowest samples, without the tail of a jitter
        count = max(int(np.ceil(2.0 * span / least)), 8 * turns)
        points = start + span * np.arange(count) / count
        fine = resample_poly(values[part], _UPSAMPLING, 1, window=_LOWPASS, padtype="line")
        signal = CubicSpline(np.arange(fine.size) / _UPSAMPLING, fine)(index(points))
        shape = flattop(points.size, sym=False)
        amplitude = np.abs(np.fft.rfft(detrend(signal) * shape)) * (2.0 / shape.sum())
        amplitude[0] = abs(float(np.mean(signal)))
        ends = np.interp([start, start + span], angle, time)
        seconds = float(ends[1] - ends[0])
        highest = _highest_order(angle)
        found.append((amplitude, float(ends.mean()), span / seconds, highest))
    return found
