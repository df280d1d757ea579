"""Offset and drift between the clocks of two loggers, from a quantity that both logged.

Both signals are resampled, band-limited by the same zero-phase filter, and correlated over all lags with enough overlap
[1]; the best few lags are refined together with a drift by least squares of `other = gain reference + constant`. The
interval is that of a sandwich covariance over blocks of time, so that what the two signals do not share, correlated in
time, counts once a block.

References:
    [1] D. Padfield, "Masked object registration in the Fourier domain", IEEE Trans. Image Process. 21(5), 2012.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import scipy

from textile_twin_core.arrays import FloatArray

_COARSE_S = 0.01
"""Sampling interval of the search over all lags."""
_BAND_HZ = 40.0
"""Frequencies above are noise of most encoders and drives."""
_OVERLAP, _OVERLAP_S = 0.25, 2.0
"""Least common part of the two records, of the shorter one and in seconds."""
_CANDIDATES, _BESIDE, _LIKELY = 8, 4, 0.3
"""Lags that are refined: the best correlated, and the peaks on each side of the best refined one, a
turn or two away, whose log-likelihood is at least this part of the best."""
_DRIFT = 1.5e-4
"""Standard deviation of the drift of two quartz clocks."""
_DRIFTS = np.linspace(-4e-4, 4e-4, 17)
"""Drifts from which the refinement starts."""
_SHIFT_S = 0.02
"""Largest shift at the ends of the common part between two starting drifts."""
_BLOCKS = 24
_HALF_WIDTHS = 2.5
"""Half width of the interval over the standard deviation: Student's t of few blocks, over the whole record."""
_CERTAIN, _CHANCE = 10.0, 3.0
"""Least difference of the log-likelihoods of the best offset and the next: a constant, and standard deviations of what
the noise of the reference, which is another one at each offset, makes by chance."""
_RELATED = 0.5
"""Least correlation of the two signals at the best offset."""
_PRECISE_S = 2e-3
"""Largest half width of the offset's interval."""
_STEPS, _CONVERGED_S = 12, 1e-7
_LARGEST = 400_000
"""Samples of the last fit."""


class Undetermined(StrEnum):
    """Reason for which the offset of two clocks is not determined."""

    TOO_SHORT = "too short"
    UNRELATED = "unrelated"
    AMBIGUOUS = "ambiguous"
    IMPRECISE = "imprecise"


@dataclass(frozen=True)
class ClockOffset:
    """Time of the reference = time + offset_s + drift * (time - origin_s).

    Attributes:
        offset_s, drift: Of the clocks.
        origin_s: Time of the other clock to which the offset belongs, its first sample.
        half_width_s, drift_half_width: Half widths of the 95 % intervals; the offset's is the largest over the record.
        correlation: Of the two signals in the common part.
        other_offset_s: Next best offset; NaN without one.
        undetermined: Reason for which the numbers must not be used; None if they may.
    """

    offset_s: float
    drift: float
    origin_s: float
    half_width_s: float
    drift_half_width: float
    correlation: float
    other_offset_s: float = float("nan")
    undetermined: Undetermined | None = None


def find_clock_offset(
    reference_s: FloatArray, reference: FloatArray, other_s: FloatArray, other: FloatArray
) -> ClockOffset:
    """Estimate offset and drift of a clock by a signal logged on both.

    Args:
        reference_s, reference: (n,) times and values of the reference, rising.
        other_s, other: (m,) of the other logger; a linear function of the same quantity, noise aside.

    Examples:
        >>> t = np.arange(0.0, 40.0, 0.002)
        >>> speed = lambda t: np.minimum(t, 8.0) + 0.3 * np.sin(1.7 * np.minimum(t, 8.0) ** 2)
        >>> found = find_clock_offset(t, speed(t), t[:9000], speed(t[:9000] + 3.25))
        >>> round(found.offset_s, 4), found.undetermined
        (3.25, None)
    """
    origin, start = float(other_s[0]), float(reference_s[0])
    a_s, b_s = reference_s - start, other_s - origin
    step = max(_usual_step(a_s), _usual_step(b_s), max(a_s[-1], b_s[-1]) / _LARGEST)
    coarse = max(step, _COARSE_S)
    least = max(_OVERLAP_S, _OVERLAP * min(a_s[-1], b_s[-1]))
    nothing = ClockOffset(0.0, 0.0, origin, np.inf, np.inf, 0.0, undetermined=Undetermined.TOO_SHORT)
    if min(a_s[-1], b_s[-1]) < _OVERLAP_S:
        return nothing
    rough = _Pair(_even(a_s, reference, coarse), _even(b_s, other, coarse), coarse)
    fits = rough.fits(least)
    if not fits:
        return nothing
    best = fits[0]
    others = [fit for fit in fits if abs(fit.at(0.0) - best.at(0.0)) > 2.0 * coarse]
    second = others[0] if others else None
    pair = rough if coarse == step else _Pair(_even(a_s, reference, step), _even(b_s, other, step), step)
    last = pair.fit(best.offset_s, best.drift) or best
    ends = np.sqrt(np.maximum([last.variance_at(t) for t in (0.0, float(b_s[-1]))], 0.0))
    half, drift_half = _HALF_WIDTHS * float(ends.max()), _HALF_WIDTHS * float(np.sqrt(last.covariance[1, 1]))
    reason = None
    if abs(last.correlation) < _RELATED:
        reason = Undetermined.UNRELATED
    elif second is not None and not best.is_better(second):
        reason = Undetermined.AMBIGUOUS
    elif half > _PRECISE_S:
        reason = Undetermined.IMPRECISE
    shift = start - origin
    next_best = float("nan") if second is None else second.offset_s + shift
    offset = float(last.offset_s + shift)
    return ClockOffset(
        offset, float(last.drift), origin, half, drift_half, float(last.correlation), float(next_best), reason
    )


def _usual_step(time_s: FloatArray) -> float:
    return float(time_s[-1] / max(time_s.size - 1, 1))


def _even(time_s: FloatArray, values: FloatArray, step: float) -> FloatArray:
    """Resample to even times from 0 on, band-limited; means over each interval where samples are denser."""
    known = np.isfinite(values) & np.isfinite(time_s)
    time_s, values = time_s[known], values[known]
    time_s, first = np.unique(time_s, return_index=True)
    integral = scipy.integrate.cumulative_trapezoid(values[first], time_s, initial=0.0)
    grid = np.arange(0.0, time_s[-1], step)
    edges = np.clip(np.append(grid, grid[-1] + step) - 0.5 * step, time_s[0], time_s[-1])
    width = np.diff(edges)
    mean = np.diff(np.interp(edges, time_s, integral)) / np.maximum(width, 1e-12)
    even = np.where(width > 0.0, mean, np.interp(grid, time_s, values[first]))
    cutoff = min(_BAND_HZ * 2.0 * step, 0.8)
    if even.size < 30:
        return even
    return np.asarray(scipy.signal.sosfiltfilt(scipy.signal.butter(2, cutoff, output="sos"), even))


@dataclass(frozen=True)
class _Fit:
    offset_s: float
    drift: float
    covariance: FloatArray
    correlation: float
    gain_of_likelihood: float
    independent: float
    """Number of independent samples."""
    share: float
    """Of them among all samples."""

    def is_better(self, other: _Fit) -> bool:
        """Return true if the fit is better than another by more than chance."""
        more = (self.gain_of_likelihood - other.gain_of_likelihood) * self.share
        return more > _CERTAIN + _CHANCE * float(np.sqrt(self.independent))

    def at(self, time_s: float) -> float:
        return self.offset_s + self.drift * time_s

    def variance_at(self, time_s: float) -> float:
        along = np.array([1.0, time_s])
        return float(along @ self.covariance @ along)


class _Pair:
    """Two signals at even times from 0 on each."""

    def __init__(self, reference: FloatArray, other: FloatArray, step: float) -> None:
        self._a, self._b, self._step = reference, other, step
        self._t = step * np.arange(other.size)
        grid = step * np.arange(reference.size)
        self._spline = scipy.interpolate.CubicSpline(grid, reference)
        self._slope = self._spline.derivative()
        self._end = float(grid[-1])

    def fits(self, least_s: float) -> list[_Fit]:
        """Refine the lags at which the signals correlate best, and the peaks beside; the best fit first."""
        lags = self._lags(least_s)
        in_order = np.sort(lags)
        waiting, tried, found = lags[:_CANDIDATES].tolist(), set(), list[_Fit]()
        while waiting:
            for lag in waiting:
                tried.add(lag)
                fit = self.best_over_drifts(lag, least_s)
                found += [fit] if fit is not None else []
            found.sort(key=lambda fit: -fit.gain_of_likelihood)
            at = int(np.searchsorted(in_order, found[0].at(0.5 * float(self._t[-1])))) if found else 0
            beside = in_order[max(0, at - _BESIDE) : at + _BESIDE].tolist() if found else []
            waiting = [lag for lag in beside if lag not in tried]
        return found

    def _lags(self, least_s: float) -> FloatArray:
        """Find the offsets [s] at which the correlation of the signals peaks, the best first."""
        a, b, n = self._a - self._a.mean(), self._b - self._b.mean(), self._a.size + self._b.size
        size = scipy.fft.next_fast_len(n, real=True)
        fa, fb = np.conj(scipy.fft.rfft(b, size)), scipy.fft.rfft(a, size)
        ones_a, ones_b = scipy.fft.rfft(np.ones(a.size), size), np.conj(scipy.fft.rfft(np.ones(b.size), size))

        def over(first: FloatArray, second: FloatArray) -> FloatArray:
            return np.asarray(scipy.fft.irfft(first * second, size))

        count = np.maximum(np.rint(over(ones_a, ones_b)), 1.0)
        sum_a, sum_b = over(fb, ones_b), over(ones_a, fa)
        square_a = over(scipy.fft.rfft(a * a, size), ones_b) - sum_a**2 / count
        square_b = over(ones_a, np.conj(scipy.fft.rfft(b * b, size))) - sum_b**2 / count
        both = over(fb, fa) - sum_a * sum_b / count
        floor = 1e-9 * count * max(float(np.var(a)), 1e-300), 1e-9 * count * max(float(np.var(b)), 1e-300)
        r2 = np.clip(both**2 / (np.maximum(square_a, floor[0]) * np.maximum(square_b, floor[1])), 0.0, 1.0 - 1e-9)
        score = np.where(count * self._step >= least_s, -0.5 * count * np.log1p(-r2), -1.0)
        peaks = np.flatnonzero((score >= np.roll(score, 1)) & (score >= np.roll(score, -1)) & (score > 0.0))
        peaks = peaks[score[peaks] > _LIKELY * score[peaks].max(initial=0.0)]
        peaks = peaks[np.argsort(-score[peaks], kind="stable")]
        return np.asarray(np.where(peaks > size // 2, peaks - size, peaks) * self._step)

    def best_over_drifts(self, lag_s: float, least_s: float) -> _Fit | None:
        """Refine a lag from several drifts; None if the common part becomes too short."""
        begin, end = max(0.0, -lag_s), min(float(self._t[-1]), self._end - lag_s)
        if end - begin < 0.9 * least_s:
            return None
        middle, half = 0.5 * (begin + end), 0.5 * (end - begin)
        each = max(1, round(_SHIFT_S / (half * float(_DRIFTS[1] - _DRIFTS[0]))))
        centre = len(_DRIFTS) // 2
        starts = [_DRIFTS[k] for k in range(len(_DRIFTS)) if (k - centre) % each == 0]
        fits = [self.fit(lag_s - drift * middle, float(drift)) for drift in starts]
        return max((fit for fit in fits if fit is not None), key=lambda fit: fit.gain_of_likelihood, default=None)

    def fit(self, offset_s: float, drift: float) -> _Fit | None:
        """Refine offset and drift by Gauss-Newton steps."""
        t, b, start = self._t, self._b, offset_s
        for _ in range(_STEPS):
            at = t + offset_s + drift * t
            inside = (at >= 0.0) & (at <= self._end)
            if np.count_nonzero(inside) * self._step < _OVERLAP_S:
                return None
            at, since, y = at[inside], t[inside], b[inside]
            a, slope = self._spline(at), self._slope(at)
            basis = np.stack([a, np.ones_like(a)], axis=1)
            linear, *_ = np.linalg.lstsq(basis, y, rcond=None)
            residual = y - basis @ linear
            jacobian = linear[0] * np.stack([slope, slope * since], axis=1)
            both = np.concatenate([jacobian, basis], axis=1)
            noise = float(residual @ residual) / y.size + 1e-300
            normal = both.T @ both / noise
            normal[1, 1] += _DRIFT**-2
            gradient = both.T @ residual / noise
            gradient[1] -= drift * _DRIFT**-2
            scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
            move = scale * np.linalg.lstsq(normal * np.outer(scale, scale), scale * gradient, rcond=1e-12)[0]
            limit = min(1.0, 0.05 / max(abs(float(move[0])), 1e-12))
            offset_s, drift = offset_s + limit * float(move[0]), drift + limit * float(move[1])
            if abs(drift) > 4.0 * float(_DRIFTS[-1]) or abs(offset_s - start) > 1.0:
                return None
            if abs(move[0]) < _CONVERGED_S and abs(move[1]) * t[-1] < _CONVERGED_S:
                break
        variance = float(np.var(y)) + 1e-300
        r2 = min(max(1.0 - noise / variance, 0.0), 1.0 - 1e-12)
        blocks = np.minimum((since - since[0]) * _BLOCKS / max(float(since[-1] - since[0]), 1e-12), _BLOCKS - 1)
        scores = np.zeros((_BLOCKS, 4))
        np.add.at(scores, blocks.astype(np.int64), both * (residual / noise)[:, None])
        inverse = np.outer(scale, scale) * np.linalg.pinv(normal * np.outer(scale, scale), rcond=1e-12)
        prior = np.zeros((4, 4))
        prior[1, 1] = _DRIFT**-2
        lag = float(residual[1:] @ residual[:-1]) / (float(residual @ residual) + 1e-300)
        lag = min(max(lag, 0.0), 0.999)
        # A few blocks may hold all that determines the clocks, and show little of the noise of the others.
        covariance = inverse @ (scores.T @ scores + prior) @ inverse + inverse * (1.0 + lag) / (1.0 - lag)
        sign = np.sign(linear[0]) or 1.0
        gain = -0.5 * y.size * float(np.log1p(-r2))
        share = (1.0 - lag) / (1.0 + lag)
        return _Fit(offset_s, drift, covariance[:2, :2], float(sign * np.sqrt(r2)), gain, share * y.size, share)
