"""Readings of a coarse encoder as the intervals that they are: the linear readings that weigh as much in a fit.

With steps larger than the noise of the stamps the rounding of the counts is no noise: it repeats from sample to sample
where the shaft turns by nearly whole steps a sample. What is known is that the angle was within the step.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from textile_twin_core.arrays import FloatArray

FAR = 5.0
_NO_WEIGHT = 1e-6
"""Share of a plain reading's weight below which a reading well within its step is left out."""


class IntervalReadings:
    """Readings known to within a step, with noise.

    Args:
        reading: (n,) middle of the step [rad].
        width: the step [rad].
        variance: (n,) of the noise that is added before the reading is rounded [rad^2].
    """

    def __init__(self, reading: FloatArray, width: float, variance: FloatArray) -> None:
        self.reading, self.width, self.variance = reading, width, variance

    def linear(self, fitted: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The (n,) angles and variances of linear readings with the likelihood's slope and bend at the `fitted` angles.

        A fit to these, again and again, is Newton's way to the likeliest motion.
        """
        sigma = np.sqrt(self.variance)
        low, high = self._ends(fitted, sigma)
        shift, weight = self._slope_and_bend(low, high)
        return fitted + sigma * shift / weight, self.variance / weight

    def learn(self, fitted: FloatArray) -> None:
        """Scale the noise by a step of its own likelihood at the `fitted` angles."""
        low, high = self._ends(fitted, np.sqrt(self.variance))
        near = (low < FAR) & (high > -FAR)
        if not near.any():
            return
        low, high = low[near], high[near]
        mass = ndtr(high) - ndtr(low)
        excess = (low * _density(low) - high * _density(high)) / mass
        known = max(float(np.mean(self._slope_and_bend(low, high)[1])), 0.02)
        # an expectation-maximisation step, lengthened by the share of what is known
        self.variance = self.variance * float(np.exp(np.clip(np.log1p(np.mean(excess)) / known, -0.7, 0.7)))

    def outside(self, fitted: FloatArray) -> float:
        """Share of the readings whose step is beyond what the noise explains."""
        low, high = self._ends(fitted, np.sqrt(self.variance))
        return float(np.mean((low > FAR) | (high < -FAR)))

    def _ends(self, fitted: FloatArray, sigma: FloatArray) -> tuple[FloatArray, FloatArray]:
        away = self.reading - fitted
        return (away - self.width / 2.0) / sigma, (away + self.width / 2.0) / sigma

    @staticmethod
    def _slope_and_bend(low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean of the noise within (low, high), and what its spread lacks of one (both per sigma)."""
        inner_low, inner_high = np.minimum(low, FAR), np.maximum(high, -FAR)
        mass = ndtr(inner_high) - ndtr(inner_low)
        at_low, at_high = _density(inner_low), _density(inner_high)
        shift = (at_low - at_high) / mass
        weight = np.maximum((inner_high * at_high - inner_low * at_low) / mass + shift**2, _NO_WEIGHT)
        for beyond, end in ((low > FAR, low), (high < -FAR, high)):  # as good as a reading at the near end
            shift = np.where(beyond, end + 1.0 / np.where(beyond, end, 1.0), shift)
            weight = np.where(beyond, 1.0, weight)
        return shift, weight


def _density(x: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-0.5 * x * x) / np.sqrt(2.0 * np.pi))
