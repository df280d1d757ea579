"""One chunk of a record fitted as a whole: slow speed as a spline, ripple as harmonics of the angle, knocks as events.

Unknown are the phase psi(t) = spline + sum of knock responses, with theta' = psi' (1 + h(theta)), and the ripple h. The
angle's clock Psi(theta) = integral of 1/(1 + h) turns readings into readings of psi, so that the fit is linear but for
ripple, times and time constant of the knocks, which Gauss-Newton steps find. The prior on the spline's jerk is adapted
block by block, and so is the readings' variance.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.shaft.clock import Clock, motion_gradient, wave_basis
from textile_twin_core.shaft.knocks import response, response_slopes
from textile_twin_core.shaft.spline import Knots, LocalBasis, PenalisedSpline

RIPPLE_PRIOR = 0.03
KNOT_S = 0.04
SOFT = 0.1
"""Intensity of the jerk relative to the squared speed [1/s^3] to begin with: speed may change by a third in 1 s."""
FREE_RESPONSE, FIXED_RESPONSE = 16.0, 1e8
"""Inverse variances of log T beforehand: when it is fitted, and while knocks are still being sought."""
STRETCH = 1e-4
QUADRATURE = np.polynomial.hermite_e.hermegauss(15)


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
        self.response_prior = FREE_RESPONSE
        self.ripple = np.zeros(2 * self.orders.size)

    def _set_knots(self, breaks: FloatArray) -> None:
        self.knots = Knots(breaks)
        self.basis = self.knots.basis(self.time)
        self.intensity = np.full(self.knots.intervals, SOFT * self.intensity_scale)

    # The linear algebra

    def _equations(self) -> tuple[Clock, FloatArray, FloatArray]:
        """The clock, the phase less the knocks, and (n, p) derivatives by ripple, knock sizes, knock times, log T."""
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
        tail = [self.response_prior] if knocks else []
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
        course = np.asarray(np.polynomial.polynomial.polyfit(self.time, data, 2), dtype=np.float64)
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
        by_motion = motion_gradient(v, u, value, slope, bend)
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
            more, less = (response(after, constant * np.exp(sign * STRETCH)) for sign in (1.0, -1.0))
            border[:, :, -1] = np.moveaxis((more - less) @ self.knock_sizes / (2.0 * STRETCH), 0, 1)
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
        wave = wave_basis(theta, self.orders)
        turned = np.empty_like(wave)
        turned[:, 0::2] = -wave[:, 1::2] * self.orders
        turned[:, 1::2] = wave[:, 0::2] * self.orders
        value, slope, _ = clock.ripple(theta)
        gradient[:, 1, :ripple] += v[:, None] * wave
        gradient[:, 2, :ripple] += (u + v * v * slope)[:, None] * wave + (v * v * value)[:, None] * turned
        return np.asarray(covariance + gradient @ self._covariance @ gradient.transpose(0, 2, 1))
