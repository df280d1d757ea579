"""Shaft angle at which a force begins or ends: the likelihood of every angle, from the samples beside the event."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.uncertainty import Estimate

SPREADS_RAD = tuple(np.radians([0.01, 0.02, 0.03, 0.06, 0.12, 0.25, 0.5, 1.0, 2.0]).tolist())
_OUTLIERS = 1e-4
_OUTLIER_SIGMAS = 100.0
_FAR = 5.0
"""Distance from an event, in spreads, beyond which the force has its full value, or none, to 3e-7."""


@dataclass(frozen=True)
class BesideEvent:
    """Samples near an event, (m,): angle past it, measured torque, and torque predicted before and after it."""

    relative_rad: FloatArray
    measured: FloatArray
    before: FloatArray
    after: FloatArray

    def error(self, shift_rad: float, spread_rad: float) -> float:
        """Sum of absolute errors with the event shifted and the force growing over the spread."""
        past = scipy.special.ndtr((self.relative_rad - shift_rad) / spread_rad)
        return float(np.sum(np.abs(self.measured - self.before - past * (self.after - self.before))))


def event_angle(beside: BesideEvent, scale: float, about_rad: float, reach_rad: float) -> Estimate:
    """Posterior of an event's shift, under a uniform prior of shifts and spreads.

    Two kinds of event are compared. One is a discontinuity: each sample lies before it or after it, and errors of the
    stamps decide on which side. The other grows over the spread (needle points that are not level). Noise is normal,
    with a share of 1e-4 of outliers. Few samples lie at an event, so its likelihood is no parabola, and least squares
    would be overconfident.

    Args:
        beside: samples near the event. scale: standard deviation of the noise.
        about_rad, reach_rad: centre and half width of the shifts tried, 200 to a side.
    """
    shifts = about_rad + np.linspace(-reach_rad, reach_rad, 401)
    logs = np.array(
        [[_log_likelihoods(beside, shifts, spread, scale, steep) for spread in SPREADS_RAD] for steep in (True, False)]
    )
    mass = np.exp(logs - logs.max()).sum(axis=1).sum(axis=0)
    mass /= mass.sum()
    mean = float(mass @ shifts)
    # A shift represents all within half a step of it; else a posterior narrower than a step would have no width.
    step = float(shifts[1] - shifts[0])
    sigma = float(np.sqrt(mass @ (shifts - mean) ** 2 + step**2 / 12.0))
    edges = shifts[0] + step * (np.arange(shifts.size + 1) - 0.5)
    reached = np.concatenate(([0.0], np.cumsum(mass)))
    low, high = (float(np.interp(share, reached, edges)) for share in (0.025, 0.975))
    return Estimate(mean, sigma, (low, high))


def _log_likelihoods(beside: BesideEvent, shifts: FloatArray, spread: float, scale: float, steep: bool) -> FloatArray:
    """Log likelihoods (k,) of the samples at shifts (k,) of the event."""
    middle, reach = 0.5 * (shifts[0] + shifts[-1]), 0.5 * float(np.ptp(shifts)) + _FAR * spread
    near = np.abs(beside.relative_rad - middle) < reach
    far, close = (
        BesideEvent(beside.relative_rad[k], beside.measured[k], beside.before[k], beside.after[k])
        for k in (~near, near)
    )
    always = _log_likelihood(far, middle, spread, scale, steep)
    return np.array([always + _log_likelihood(close, float(s), spread, scale, steep) for s in shifts])


def _log_likelihood(beside: BesideEvent, shift: float, spread: float, scale: float, steep: bool) -> float:
    past = scipy.special.ndtr((beside.relative_rad - shift) / spread)
    step = beside.after - beside.before
    if steep:
        early = np.exp(-0.5 * ((beside.measured - beside.before) / scale) ** 2)
        late = np.exp(-0.5 * ((beside.measured - beside.after) / scale) ** 2)
        density = (1.0 - past) * early + past * late
    else:
        density = np.exp(-0.5 * ((beside.measured - beside.before - past * step) / scale) ** 2)
    return float(np.sum(np.log((1.0 - _OUTLIERS) * density + _OUTLIERS / _OUTLIER_SIGMAS)))
