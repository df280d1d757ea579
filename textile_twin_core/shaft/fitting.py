"""The course of a chunk's fit: ripple first, then knocks, then noise, jerk and knots until they fit each other."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.shaft.chunk import FIXED_RESPONSE, FREE_RESPONSE, SOFT, Chunk
from textile_twin_core.shaft.intervals import IntervalReadings
from textile_twin_core.shaft.knocks import NARROW, WIDE, find_knocks
from textile_twin_core.shaft.spline import ORDER

STILL, STIFF, WILD = 1e-7, 1e-6, 1e3
"""Intensities of the jerk relative to the squared speed [1/s^3]: the least there is, while knocks are sought, and in a
manoeuvre."""
SIGNIFICANT = 25.0
"""Squared amplitude over variance from which an order of ripple stays in the model."""
BLOCK_S = 0.4
SETTLED = 0.1
FAITH = 2.0
"""Degrees of freedom by which a block keeps to the intensity that it has."""
MANOEUVRE, MANOEUVRE_S = 0.05, 0.2
"""A change of speed, relative to the usual, within a time on either side that no knock makes."""
SHARPENING_ROUNDS, MOST_OUTSIDE = 12, 0.02
LARGEST_RIPPLE = 0.3
KNOCK_ROUNDS, KNOCK_COST = 12, 20.0
"""The squared normalised residuals that a knock must explain."""
SAME_S, HIDDEN, DOUBLED_AT_ONCE = 0.012, 0.3, 2
"""Knocks nearer than this are one; a find of this share of a fitted knock's size beside it tells that it is two."""


class ChunkFit(Chunk):
    """A chunk that fits itself."""

    def fit(self) -> None:
        """The whole course: rough ripple, knocks, adapted noise, knots where they are needed.

        Where that leaves the readings unexplained, as in the most violent motion, a soft spline alone follows them.
        """
        expected = self.variance
        self.solve()
        self.scale_variance()
        self.solve()
        moved = self._manoeuvres()
        if np.mean(moved) > 0.5:  # nothing comes round often enough to be called a ripple
            self.orders, self.ripple = self.orders[:0], self.ripple[:0]
            self.harmonics = 0
        self.intensity = np.where(moved, WILD, SOFT) * self.intensity_scale
        self.solve()
        self.prune()
        self.solve()
        self.look_for_knocks()
        self._settle()
        if self._credible(expected):
            return
        misfit = float(np.mean(self.residual**2))
        kept = (self.orders, self.ripple, self.knock_times, self.knock_sizes, self.variance, self.intensity, self.knots)
        self.orders, self.ripple = self.orders[:0], self.ripple[:0]
        self.knock_times = self.knock_sizes = np.zeros(0)
        self.variance = expected
        self._set_knots(np.linspace(self.knots.breaks[0], self.knots.breaks[-1], self.knots.intervals + 1))
        self.intensity[:] = WILD * self.intensity_scale
        self._settle()
        if float(np.mean(self.residual**2)) > 0.5 * misfit and np.abs(kept[1]).max(initial=0.0) < LARGEST_RIPPLE:
            self.orders, self.ripple, self.knock_times, self.knock_sizes, self.variance, intensity, knots = kept
            self._set_knots(knots.breaks)
            self.intensity = intensity
            self.solve()

    def sharpen(self, width: float, noise: FloatArray, coarse: BoolArray) -> float | None:
        """Fit on, the `coarse` readings taken as intervals of `width` about them; `noise` (n,) is their variance.

        Returns:
            The noise's variance as it was found [rad^2], None where the motion does not go through the intervals: the
            fit is then as it was.
        """
        plain = (self.angle, self.variance, self.intensity, self.orders, self.ripple)
        plain_knocks = (self.knock_times, self.knock_sizes)
        intervals = IntervalReadings(self.angle[coarse], width, noise[coarse])
        self.angle, self.variance = self.angle.copy(), self.variance.copy()
        for round_ in range(SHARPENING_ROUNDS):
            fitted = (self.angle - self.residual * self.clock.ripple(self.angle)[0])[coarse]
            if round_ > 2:
                intervals.learn(fitted)
            self.angle[coarse], self.variance[coarse] = intervals.linear(fitted)
            self.solve()
            if round_ == 2:
                self.prune()
                self._drop_weak()
                self.solve()
            if round_ > 0:
                self.adapt()
        fitted = (self.angle - self.residual * self.clock.ripple(self.angle)[0])[coarse]
        if not intervals.outside(fitted) < MOST_OUTSIDE:
            self.angle, self.variance, self.intensity, self.orders, self.ripple = plain
            self.knock_times, self.knock_sizes = plain_knocks
            self.solve()
            return None
        return float(np.median(intervals.variance))

    def _settle(self) -> None:
        """Adapt jerk, variance and knots until they fit each other."""
        for round_ in range(14):
            self.solve()
            self.scale_variance()
            change = self.adapt()
            refined = round_ >= 2 and self.refine()
            if not refined and (round_ >= 6 or (round_ >= 2 and change < SETTLED)):
                break
        self._drop_weak()
        for _ in range(2):
            self.solve()

    def _credible(self, expected: FloatArray) -> bool:
        ripple = float(np.abs(self.ripple).max(initial=0.0))
        squares = self.residual**2 / expected
        return bool(ripple < LARGEST_RIPPLE and np.mean(squares) < 25.0 and np.isfinite(squares).all())

    def prune(self) -> None:
        """Leave out orders of ripple that the data do not show."""
        variances = np.diag(self._covariance)[: self.ripple.size]
        power = (self.ripple**2 / variances).reshape(-1, 2).sum(1)
        keep = (power > SIGNIFICANT) | (self.orders <= self.harmonics)
        self.orders = self.orders[keep]
        self.ripple = self.ripple[np.repeat(keep, 2)]

    def scale_variance(self) -> None:
        """Fit the readings' variance to the residuals within three sigmas, so that events do not count."""
        squares = self.residual**2 / self.variance
        within = squares[squares <= 9.0 * float(np.median(squares)) / 0.4549]
        ratio = float(np.mean(within)) / 0.9733
        self.variance = np.maximum(self.variance * min(max(ratio, 1e-4), 1e4), 1e-16)

    def adapt(self) -> float:
        """A step of MacKay's (1992) for the jerk's intensity, in blocks: its power over the freedom the data give.

        Returns:
            The largest change of its logarithm.
        """
        jerk = self.knots.jerk()
        first = np.arange(self.knots.intervals)
        lengths = np.diff(self.knots.breaks)
        columns = first[:, None] + np.arange(ORDER)
        value = np.sum(jerk * self.coefficients[columns], axis=1)
        blocks = self._spline.inverse_band()[: self.knots.intervals]
        spread = np.einsum("ij,ijk,ik->i", jerk, blocks, jerk)
        through = np.einsum("ij,ijp->ip", jerk, self._through[columns])
        spread += np.einsum("ip,pq,iq->i", through, self._covariance, through)
        block = ((self.knots.breaks[:-1] - self.knots.breaks[0]) / BLOCK_S).astype(int)
        freedom = np.bincount(block, np.clip(1.0 - spread * lengths / self.intensity, 0.0, 1.0))
        usual = np.exp(np.bincount(block, np.log(self.intensity)) / np.bincount(block))
        power = (np.bincount(block, lengths * value**2) + FAITH * usual) / (freedom + FAITH)
        change = np.clip(power / usual, 0.1, 10.0)[block]
        adapted = np.maximum(self.intensity * change, STILL * self.intensity_scale)
        largest = float(np.abs(np.log(adapted / self.intensity)).max())
        self.intensity = adapted
        return largest

    def look_for_knocks(self) -> None:
        """Find knocks against a stiff spline and fit them, round by round while that explains more than it costs."""
        most = int(4.0 * (self.time[-1] - self.time[0])) + 2
        self.intensity = np.where(self._manoeuvres(), WILD, STIFF) * self.intensity_scale
        self.response_prior = FIXED_RESPONSE
        self.solve()
        self._avoided = np.zeros(0)
        best, kept, failures = self._cost(), self._knocks(), 0
        for _ in range(KNOCK_ROUNDS):
            new = self._new_knocks(most)
            if not new.size:
                break
            order = np.argsort(np.concatenate([self.knock_times, new[:, 0]]))
            self.knock_times = np.concatenate([self.knock_times, new[:, 0]])[order]
            self.knock_sizes = np.concatenate([self.knock_sizes, new[:, 1]])[order]
            cost = self._converge()
            if cost < best:
                best, kept, failures = cost, self._knocks(), 0
            else:
                failures += 1
                if failures == 4:
                    break
        self.knock_times, self.knock_sizes, self.ripple = kept
        self.response_prior = FREE_RESPONSE
        self._converge()

    def _knocks(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return self.knock_times, self.knock_sizes, self.ripple

    def _cost(self) -> float:
        return float(np.sum(self.residual**2 / self.variance)) + KNOCK_COST * self.knock_times.size

    def _converge(self) -> float:
        """Gauss-Newton steps until they gain nothing; the cost."""
        before = np.inf
        for _ in range(8):
            self.solve()
            cost = self._cost()
            if cost > 0.98 * before:
                break
            before = cost
        self._drop_weak()
        self.solve()
        return self._cost()

    def _new_knocks(self, most: int) -> FloatArray:
        """Knocks that the residual shows; fitted ones that stand for two, and hide both, are taken back."""
        new = self._find(most, WIDE)
        near = np.abs(self.knock_times[:, None] - new[:, 0]) < SAME_S
        near &= np.abs(new[:, 1]) > HIDDEN * np.abs(self.knock_sizes[:, None])
        excess = np.max(np.where(near, np.abs(new[:, 1]), 0.0), axis=1, initial=0.0)
        doubled = np.argsort(excess)[-DOUBLED_AT_ONCE:]
        doubled = doubled[excess[doubled] > 0.0]
        if doubled.size:
            self._avoided = np.concatenate([self._avoided, self.knock_times[doubled]])
            self.knock_times = np.delete(self.knock_times, doubled)
            self.knock_sizes = np.delete(self.knock_sizes, doubled)
            self.solve()
            new = self._find(most, NARROW)
        new = self._apart(new)
        return new if new.size or doubled.size else self._apart(self._find(most, NARROW))

    def _apart(self, new: FloatArray) -> FloatArray:
        taken = np.concatenate([self.knock_times, self._avoided])
        return new[np.all(np.abs(taken[:, None] - new[:, 0]) >= SAME_S, axis=0)]

    def _manoeuvres(self) -> BoolArray:
        """Intervals in which the shaft changes its speed by far more than a knock does: a soft spline must follow."""
        at = np.arange(self.knots.intervals)[:, None] + np.arange(ORDER)
        slope = self.knots.basis(self.knots.breaks[:-1]).slope
        speed = np.sum(slope * self.coefficients[at], axis=1)
        reach = max(int(MANOEUVRE_S / float(np.median(np.diff(self.knots.breaks)))), 1)
        around = np.lib.stride_tricks.sliding_window_view(np.pad(speed, reach, mode="edge"), 2 * reach + 1)
        return np.asarray(np.ptp(around, axis=1) > MANOEUVRE * np.sqrt(self.intensity_scale))

    def _find(self, most: int, window_s: tuple[float, float, float]) -> FloatArray:
        sigma = float(np.median(np.abs(self.residual))) / 0.6745
        sigma = max(sigma, float(np.sqrt(np.median(self.variance))))
        new = find_knocks(self.time, self.residual, sigma, float(np.exp(self._log_response)), most, window_s)
        interval = np.searchsorted(self.knots.breaks, new[:, 0]) - 1
        return new[self.intensity[interval] < WILD * self.intensity_scale]

    def _drop_weak(self) -> None:
        ripple, knocks = self.ripple.size, self.knock_times.size
        if not knocks:
            return
        sigma = np.sqrt(np.diag(self._covariance)[ripple : ripple + knocks])
        inside = (self.knock_times > self.time[0]) & (self.knock_times < self.time[-1])
        keep = (np.abs(self.knock_sizes) > 4.0 * sigma) & inside
        self.knock_times, self.knock_sizes = self.knock_times[keep], self.knock_sizes[keep]

    def refine(self) -> bool:
        """Halve the knots where the residuals are too large; whether any was."""
        if self.knots.intervals < 3:
            return False
        squares = self.residual**2 / self.variance
        own = np.bincount(self.basis.first, np.minimum(squares, 1e4), self.knots.intervals)
        count = np.bincount(self.basis.first, minlength=self.knots.intervals)
        wide = np.convolve(own, np.ones(3), "same") / np.maximum(np.convolve(count, np.ones(3), "same"), 1)
        coarse = (wide > 2.5) & (count > 6)
        if not coarse.any():
            return False
        breaks = self.knots.breaks
        middle = (breaks[:-1] + breaks[1:])[coarse] / 2.0
        intensity = np.interp(np.sort(np.concatenate([breaks[:-1], middle])), breaks[:-1], np.log(self.intensity))
        self._set_knots(np.sort(np.concatenate([breaks, middle])))
        self.intensity = np.exp(intensity)
        self.intensity[self._touched(middle)] = SOFT * self.intensity_scale
        return True

    def _touched(self, times: FloatArray) -> IntArray:
        at = np.searchsorted(self.knots.breaks, times) - 1
        near = np.concatenate([at + k for k in range(-2, 4)])
        return np.unique(np.clip(near, 0, self.knots.intervals - 1))
