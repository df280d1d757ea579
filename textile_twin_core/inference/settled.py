"""Sensors and friction settled: values given the machine file exactly, and how far its tolerances may move them."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from textile_twin_core.inference.map_fit import Fit, map_fit
from textile_twin_core.inference.parameter import COULOMB, DELAY, GAIN, OFFSET, VISCOUS, ZERO
from textile_twin_core.inference.posterior import Posterior


@dataclass(frozen=True)
class Settled:
    """Two fits of the same free parameters: with all other numbers exactly as in the file, and within tolerances.

    Attributes:
        posterior: of the record.
        free: parameters that are settled.
        exact: fit with all other numbers as in the file; its values go with that file.
        tolerant: fit with all other numbers within their tolerances.
    """

    posterior: Posterior
    free: frozenset[str]
    exact: Fit
    tolerant: Fit

    def value(self, name: str) -> float:
        """Value given the file exactly."""
        return float(self.exact.x[self.posterior.measurement.place[name]])

    def departure(self, name: str) -> float:
        """Value less nominal value."""
        return self.value(name) - self.posterior.parameter(name).nominal

    def sigma(self, weights: str | Mapping[str, float]) -> float:
        """Standard deviation of a value, or of a sum of values, about the truth, given the file's tolerances.

        That is the spread of the tolerant posterior and the distance from its mean.
        """
        w = self._weights(weights)
        away = float(w @ (self.exact.x - self.tolerant.x))
        return math.sqrt(max(float(w @ self.tolerant.covariance @ w), 0.0) + away**2)

    def sigma_given_file(self, weights: str | Mapping[str, float]) -> float:
        """Standard deviation given that all other numbers are exactly as in the file."""
        w = self._weights(weights)
        k = [self.posterior.measurement.place[name] for name in self.free]
        inverse = np.linalg.inv(np.linalg.inv(self.exact.covariance)[np.ix_(k, k)])
        return math.sqrt(max(float(w[k] @ inverse @ w[k]), 0.0))

    def interval95(self, name: str) -> tuple[float, float]:
        """Interval that holds the truth in 95 of 100 records whose files are off within their tolerances."""
        k = self.posterior.measurement.place[name]
        mean, half = float(self.tolerant.x[k]), 1.959964 * math.sqrt(float(self.tolerant.covariance[k, k]))
        value = self.value(name)
        return min(mean - half, value), max(mean + half, value)

    def _weights(self, weights: str | Mapping[str, float]) -> np.ndarray:
        names = self.posterior.measurement.names
        by_name = {weights: 1.0} if isinstance(weights, str) else weights
        return np.array([by_name.get(name, 0.0) for name in names])


def settle(posterior: Posterior, free: Collection[str]) -> Settled:
    """Settle some parameters of a record.

    Args:
        posterior: of the record.
        free: names of the parameters.
    """
    m = posterior.measurement
    x = m.nominal.copy()
    for name in free:
        x[m.place[name]] = posterior.value(name)
    hypothesis, inflation, scale = posterior.hypothesis, posterior.fit.inflation, posterior.fit.scale
    exact = map_fit(m, hypothesis, x, free, free=free, inflation=inflation, scale=scale)
    tolerant = map_fit(m, hypothesis, posterior.fit.x, free, inflation=inflation, scale=scale, relinearise=True)
    return Settled(posterior, frozenset(free), exact, tolerant)


def settled_sensors(posterior: Posterior, both_ways: bool = False) -> frozenset[str]:
    """Sensors and friction that a record tells, and all departures: what `calibrate` settles.

    Args:
        posterior: of the record.
        both_ways: the shaft turns either way, so that an offset is not friction.
    """
    m = posterior.measurement
    free = {*posterior.departing, GAIN, COULOMB}
    if m.model.depends_on_angle():
        free |= {ZERO}
    if m.record.one_speed:
        kept = DELAY if DELAY in posterior.departing and ZERO not in posterior.departing else ZERO
        free = (free - {ZERO, DELAY}) | ({kept} if kept == DELAY or ZERO in free else set())
    else:
        free |= {DELAY, VISCOUS}
    if m.record.standstills or both_ways:
        free |= {OFFSET}
    return frozenset(free)
