"""One chunk of a record fitted as a whole: slow speed as a spline, ripple as harmonics of the angle, knocks as events.

Unknown are the phase psi(t) = spline + sum of knock responses, with theta' = psi' (1 + h(theta)), and the ripple h. The
angle's clock Psi(theta) = integral of 1/(1 + h) turns readings into readings of psi, so that the fit is linear but for
ripple, times and time constant of the knocks, which Gauss-Newton steps find. The prior on the spline's jerk is adapted
block by block, and so is the readings' variance.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.shaft.knocks import NARROW, WIDE, find_knocks, response, response_slopes
from textile_twin_core.shaft.spline import ORDER, Knots, LocalBasis, PenalisedSpline
from textile_twin_core.shaft.turns import TURN

GRID = 2048
RIPPLE_PRIOR = 0.03
SIGNIFICANT = 25.0
"""Squared amplitude over variance from which an order of ripple stays in the model."""
KNOT_S = 0.04
BLOCK_S = 0.4
STIFF, SOFT, WILD = 1e-6, 1e-1, 1e3
"""Intensities of the jerk relative to the squared speed [1/s^3]: the least, to begin with, and in a manoeuvre."""
FAITH = 2.0
"""Degrees of freedom by which a block keeps to the intensity that it has."""
MANOEUVRE, MANOEUVRE_S = 0.05, 0.2
"""A change of speed, relative to the usual, within a time on either side that no knock makes."""
LARGEST_RIPPLE = 0.3
ROUNDS = 8
SAME_S = 0.012
QUADRATURE = np.polynomial.hermite_e.hermegauss(15)


class Clock:
    """Psi(theta), the integral of 1/(1 + h), and its derivatives by the ripple's coefficients, as periodic tables."""

    def __init__(self, orders: IntArray, coefficients: FloatArray) -> None:
        angle = np.arange(GRID + 1) * (TURN / GRID)
        self.orders, self.coefficients = orders, coefficients
        wave = _basis(angle, orders)
        speed = np.maximum(1.0 + wave @ coefficients, 0.2)
        columns = np.concatenate([1.0 / speed[:, None], -wave / (speed**2)[:, None]], axis=1)[:-1]
        spectrum = np.fft.rfft(columns, axis=0)
        k = np.arange(spectrum.shape[0])
        self.mean = spectrum[0].real / GRID
        spectrum[0] = 0.0
        spectrum[1:] /= 1j * k[1:, None]
        table = np.fft.irfft(spectrum, GRID, axis=0)
        self._angle = angle
        self._table = np.concatenate([table, table[:1]])

    def __call__(self, theta: FloatArray) -> FloatArray:
        """(n, 1 + coefficients): Psi, and its derivative by each coefficient."""
        phase = np.mod(theta, TURN)
        out = theta[:, None] * self.mean
        for j in range(self._table.shape[1]):
            out[:, j] += np.interp(phase, self._angle, self._table[:, j])
        return out

    def ripple(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(n,) 1 + h, h', h''."""
        c, s = self.coefficients[0::2], self.coefficients[1::2]
        k = self.orders
        cos, sin = np.cos(np.outer(theta, k)), np.sin(np.outer(theta, k))
        wave, turned = cos * c + sin * s, cos * s - sin * c
        return 1.0 + wave.sum(1), turned @ k, -(wave @ (k * k))

    def theta(self, psi: FloatArray, guess: FloatArray) -> FloatArray:
        """The angle whose Psi is psi, by Newton's steps from a guess."""
        theta = guess
        for _ in range(4):
            theta = theta + (psi - self(theta)[:, 0]) * self.ripple(theta)[0]
        return theta


def _basis(theta: FloatArray, orders: IntArray) -> FloatArray:
    """(n, 2 orders): cos, sin of each order, alternating."""
    arguments = np.outer(theta, orders)
    return np.stack([np.cos(arguments), np.sin(arguments)], axis=2).reshape(theta.size, -1)


@dataclass
class Chunk:
    """Readings to be fitted, and what the fit has found so far.

    Attributes:
        time, angle, variance: (n,) readings; the variance is scaled as the residuals tell.
        orders: orders of ripple in the model.
        harmonics: those that stay in it whatever the data say.
        intensity_scale: square of the usual speed, by which jerk intensities are measured.
    """

    time: FloatArray
    angle: FloatArray
    variance: FloatArray
    orders: IntArray
    harmonics: int
    intensity_scale: float
    response_s: float = 0.04
    knock_times: FloatArray = field(default_factory=lambda: np.zeros(0))
    knock_sizes: FloatArray = field(default_factory=lambda: np.zeros(0))
    ripple: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        typical = float(np.median(np.diff(self.time)))
        span = float(self.time[-1] - self.time[0])
        count = max(int(span / max(KNOT_S, 3.0 * typical)), 1)
        self._set_knots(np.linspace(self.time[0], self.time[-1] + 1e-9, count + 1))
        self._log_response = np.log(self.response_s)
        self.ripple = np.zeros(2 * self.orders.size)

    def _set_knots(self, breaks: FloatArray) -> None:
        self.knots = Knots(breaks)
        self.basis = self.knots.basis(self.time)
        self.intensity = np.full(self.knots.intervals, SOFT * self.intensity_scale)

    # The linear algebra

    def _equations(self) -> tuple[Clock, FloatArray, FloatArray]:
        """The clock, the phase less the knocks, and the (n, p) derivatives by ripple, knock sizes, knock times, log T."""
        clock = Clock(self.orders, self.ripple)
        columns = clock(self.angle)
        ripple, knocks = self.ripple.size, self.knock_times.size
        border = np.zeros((self.time.size, ripple + (2 * knocks + 1 if knocks else 0)))
        border[:, :ripple] = -columns[:, 1:]
        data = columns[:, 0]
        constant = float(np.exp(self._log_response))
        first = np.searchsorted(self.time, self.knock_times)
        for j, (at, size, begin) in enumerate(zip(self.knock_times, self.knock_sizes, first.tolist(), strict=True)):
            angle, speed, stretch = response_slopes(self.time[begin:] - at, constant)
            border[begin:, ripple + j] = angle
            border[begin:, ripple + knocks + j] = -size * speed
            border[begin:, -1] += size * stretch
            data[begin:] -= size * angle
        return clock, data, border

    def _prior(self) -> FloatArray:
        """Inverse prior variances of the border's unknowns."""
        knocks = self.knock_times.size
        size = 4.0 * self.intensity_scale
        tail = [16.0] if knocks else []
        return np.concatenate(
            [
                np.full(self.ripple.size, 1.0 / RIPPLE_PRIOR**2),
                np.full(knocks, 1.0 / size),
                np.full(knocks, 1.0 / 0.02**2),
                tail,
            ]
        )

    def solve(self) -> None:
        """One Gauss-Newton step for everything; leaves residuals, coefficients and the pieces of the covariance."""
        clock, data, border = self._equations()
        weight = 1.0 / self.variance
        course = np.polynomial.polynomial.polyfit(self.time, data, 2)
        data = data - np.polynomial.polynomial.polyval(self.time, course)  # no jerk: kept out of the sums
        spline = PenalisedSpline(self.knots, self.basis, weight, self.intensity)
        stacked = spline.project(np.concatenate([data[:, None], border], axis=1))
        solved = spline.solve(stacked)
        through = solved[:, 1:]
        weighted = border * weight[:, None]
        normal = weighted.T @ border - stacked[:, 1:].T @ through
        prior = self._prior()
        known = np.concatenate([self.ripple, self.knock_sizes])
        pull = np.zeros(prior.size)
        pull[: known.size] = -prior[: known.size] * known
        if self.knock_times.size:
            pull[-1] = -prior[-1] * (self._log_response - np.log(self.response_s))
        right = weighted.T @ data - stacked[:, 1:].T @ solved[:, 0]
        normal[np.diag_indices_from(normal)] += prior
        self._covariance = np.linalg.inv(normal)
        change = self._covariance @ (right + pull)
        self.coefficients = solved[:, 0] - through @ change
        self._through, self._spline, self.clock = through, spline, clock
        fitted = np.sum(self.basis.value * self.coefficients[self.basis.columns], axis=1)
        self.residual = data - fitted - border @ change
        self.coefficients = self.coefficients + self.knots.parabola(course)
        self._apply(change)

    def _apply(self, change: FloatArray) -> None:
        ripple, knocks = self.ripple.size, self.knock_times.size
        self.ripple = self.ripple + change[:ripple]
        if knocks:
            self.knock_sizes = self.knock_sizes + change[ripple : ripple + knocks]
            self.knock_times = self.knock_times + np.clip(change[ripple + knocks : ripple + 2 * knocks], -0.01, 0.01)
            log_response = self._log_response + np.clip(change[-1], -0.3, 0.3)
            self._log_response = np.clip(log_response, np.log(0.004), np.log(0.5))

    # What the data say of the model

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

    def adapt(self) -> None:
        """One step of MacKay's (1992) for the jerk's intensity, in blocks: its power over the freedom the data give it."""
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
        self.intensity = np.maximum(self.intensity * change, STIFF * self.intensity_scale)

    def look_for_knocks(self) -> None:
        """Find knocks against a stiff spline and fit them, round by round until none is left."""
        most = int(4.0 * (self.time[-1] - self.time[0])) + 2
        moved = self._manoeuvres()
        self.intensity = np.where(moved, WILD, STIFF) * self.intensity_scale
        avoided = np.zeros(0)
        for _ in range(ROUNDS):
            self.solve()
            new = self._find(most, WIDE)
            near = np.abs(self.knock_times[:, None] - new[:, 0]) < SAME_S
            if near.any():  # a find beside a fitted knock: that one stands for two and hides both
                avoided = np.concatenate([avoided, self.knock_times[near.any(axis=1)]])
                keep = ~near.any(axis=1)
                self.knock_times, self.knock_sizes = self.knock_times[keep], self.knock_sizes[keep]
                self.solve()
                new = self._find(most, NARROW)
            taken = np.concatenate([self.knock_times, avoided])
            new = new[np.all(np.abs(taken[:, None] - new[:, 0]) >= SAME_S, axis=0)]
            if not new.size:
                break
            order = np.argsort(np.concatenate([self.knock_times, new[:, 0]]))
            self.knock_times = np.concatenate([self.knock_times, new[:, 0]])[order]
            self.knock_sizes = np.concatenate([self.knock_sizes, new[:, 1]])[order]
            for _ in range(3):
                self.solve()
            self._drop_weak()

    def _manoeuvres(self) -> BoolArray:
        """Intervals in which the shaft changes its speed by far more than a knock does: there a soft spline must follow."""
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

    def _settle(self) -> None:
        """Adapt jerk, variance and knots until they fit each other."""
        for round_ in range(14):
            self.solve()
            self.scale_variance()
            self.adapt()
            refined = round_ >= 2 and self.refine()
            if round_ >= 6 and not refined:
                break
        self._drop_weak()
        for _ in range(2):
            self.solve()

    def _credible(self, expected: FloatArray) -> bool:
        ripple = float(np.abs(self.ripple).max(initial=0.0))
        squares = self.residual**2 / expected
        return bool(ripple < LARGEST_RIPPLE and np.mean(squares) < 25.0 and np.isfinite(squares).all())

    # The result

    def states(self, time: FloatArray, guess: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n, 3) theta, omega, alpha and their (n, 3, 3) covariance at times within the chunk.

        The time of a knock is as uncertain as it is: states near it are averaged over it.
        """
        basis = self.knots.basis(time)
        columns = basis.columns
        local = self.coefficients[columns]
        motion = np.stack([np.sum(b * local, axis=1) for b in (basis.value, basis.slope, basis.bend)], axis=1)
        shifts, spread = self._knock_states(time)
        motion += shifts
        clock = Clock(self.orders, self.ripple)
        theta = clock.theta(motion[:, 0], guess)
        value, slope, bend = clock.ripple(theta)
        v, u = motion[:, 1], motion[:, 2]
        states = np.stack([theta, v * value, u * value + v * v * value * slope], axis=1)
        by_motion = _by_motion(v, u, value, slope, bend)
        spread = by_motion @ spread @ by_motion.transpose(0, 2, 1)
        spread += self._linear_covariance(time, theta, clock, basis, by_motion, v, u)
        return states, spread

    def _knock_states(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What the knocks add to psi, psi', psi'' on average over their times, and the covariance from these."""
        shift, spread = np.zeros((time.size, 3)), np.zeros((time.size, 3, 3))
        knocks, ripple = self.knock_times.size, self.ripple.size
        constant = float(np.exp(self._log_response))
        sigma = np.sqrt(np.diag(self._covariance)[ripple + knocks : ripple + 2 * knocks])
        nodes, weights = QUADRATURE
        weights = weights / weights.sum()
        for at, size, width in zip(self.knock_times, self.knock_sizes, sigma, strict=True):
            first = int(np.searchsorted(time, at - 6.0 * width))
            after = time[first:] - at
            plain = size * response(after, constant).T
            close = int(np.searchsorted(after, 6.0 * width))
            if close:
                many = size * response(after[:close, None] - width * nodes, constant)
                mean = many @ weights
                plain[:close] = mean.T
                off = many - mean[:, :, None]
                spread[first : first + close] += np.einsum("ink,jnk,k->nij", off, off, weights)
            shift[first:] += plain
        return shift, spread

    def _linear_covariance(
        self,
        time: FloatArray,
        theta: FloatArray,
        clock: Clock,
        basis: LocalBasis,
        by_motion: FloatArray,
        v: FloatArray,
        u: FloatArray,
    ) -> FloatArray:
        ripple, knocks = self.ripple.size, self.knock_times.size
        after = time[:, None] - self.knock_times
        constant = float(np.exp(self._log_response))
        angle, speed, rate = response(after, constant)
        border = np.zeros((time.size, 3, self._covariance.shape[0]))
        border[:, 0, :ripple] = -clock(theta)[:, 1:]
        for row, values in enumerate((angle, speed, rate)):
            border[:, row, ripple : ripple + knocks] = values
        if knocks:
            stretch = 1e-4
            more, less = response(after, constant * np.exp(stretch)), response(after, constant * np.exp(-stretch))
            border[:, :, -1] = np.moveaxis((more - less) @ self.knock_sizes / (2 * stretch), 0, 1)
            far = response(after, constant)
            pull = -(2.0 * far[2] + far[1] / constant) / constant  # w''
            sigma = np.sqrt(np.diag(self._covariance)[ripple + knocks : ripple + 2 * knocks])
            open_ = np.abs(after) > 6.0 * sigma  # nearer, the average over the knock's time holds it already
            for row, values in enumerate((far[1], far[2], pull)):
                border[:, row, ripple + knocks : ripple + 2 * knocks] = np.where(open_, -values * self.knock_sizes, 0.0)
        local = np.stack([basis.value, basis.slope, basis.bend], axis=1)
        blocks = self._spline.inverse_band()[basis.first]
        covariance = np.einsum("nij,njk,nlk->nil", local, blocks, local)
        covariance = by_motion @ covariance @ by_motion.transpose(0, 2, 1)
        through = np.einsum("nij,njp->nip", local, self._through[basis.columns])
        gradient = by_motion @ (border - through)
        wave = _basis(theta, self.orders)
        turned = np.empty_like(wave)
        turned[:, 0::2] = -wave[:, 1::2] * self.orders
        turned[:, 1::2] = wave[:, 0::2] * self.orders
        value, slope, _ = clock.ripple(theta)
        gradient[:, 1, :ripple] += v[:, None] * wave
        gradient[:, 2, :ripple] += (u + v * v * slope)[:, None] * wave + (v * v * value)[:, None] * turned
        return np.asarray(covariance + gradient @ self._covariance @ gradient.transpose(0, 2, 1))


def _by_motion(v: FloatArray, u: FloatArray, value: FloatArray, slope: FloatArray, bend: FloatArray) -> FloatArray:
    """(n, 3, 3) derivative of (theta, omega, alpha) by (psi, psi', psi'') at fixed ripple."""
    out = np.zeros((v.size, 3, 3))
    out[:, 0, 0] = value
    out[:, 1, 0] = v * slope * value
    out[:, 1, 1] = value
    out[:, 2, 0] = (u * slope + v * v * (slope * slope + value * bend)) * value
    out[:, 2, 1] = 2.0 * v * value * slope
    out[:, 2, 2] = value
    return out
