"""Estimates of sensors and friction, given the tolerances of the machine file, and given the file exactly."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.inference.map_fit import Fit, map_fit
from textile_twin_core.inference.parameter import COULOMB, DELAY, GAIN, HELD, OF_A_LAW, OFFSET, VISCOUS, ZERO
from textile_twin_core.inference.posterior import Posterior

_NORMAL95 = 1.959964


@dataclass(frozen=True)
class Settled:
    """Two fits of the same free parameters: with all other numbers within tolerances, and exactly as in the file.

    Attributes:
        posterior: of the record.
        free: parameters that are estimated.
        tolerant: fit with all other numbers within their tolerances.
    """

    posterior: Posterior
    free: frozenset[str]
    tolerant: Fit

    @cached_property
    def exact(self) -> Fit:
        """Fit with all other numbers as in the file."""
        p, m = self.posterior, self.posterior.measurement
        x = m.nominal.copy()
        for name in sorted(self.free):
            x[m.place[name]] = p.value(name)
        like = p.fit
        return map_fit(m, p.hypothesis, x, self.free, free=self.free, inflation=like.inflation, scale=like.scale)

    def value(self, name: str) -> float:
        """Value given the file's tolerances."""
        return float(self.tolerant.x[self.posterior.measurement.place[name]])

    def departure(self, name: str) -> float:
        """Value less nominal value."""
        return self.value(name) - self.posterior.parameter(name).nominal

    def sigma(self, weights: str | Mapping[str, float]) -> float:
        """Standard deviation of a value, or of a weighted sum of values, given the file's tolerances."""
        w = self._weights(weights)
        return math.sqrt(max(float(w @ self.tolerant.covariance @ w), 0.0))

    def given_file(self, name: str) -> tuple[float, float]:
        """Value and standard deviation where all other numbers are exactly as in the file."""
        place = self.posterior.measurement.place
        k = [place[each] for each in self.free]
        inverse = np.linalg.inv(np.linalg.inv(self.exact.covariance)[np.ix_(k, k)])
        w = self._weights(name)[k]
        return float(self.exact.x[place[name]]), math.sqrt(max(float(w @ inverse @ w), 0.0))

    def interval95(self, name: str) -> tuple[float, float]:
        """95 % interval, over records whose files are off within their tolerances."""
        half = _NORMAL95 * self.sigma(name)
        return self.value(name) - half, self.value(name) + half

    def _weights(self, weights: str | Mapping[str, float]) -> FloatArray:
        names = self.posterior.measurement.names
        by_name = {weights: 1.0} if isinstance(weights, str) else weights
        return np.array([by_name.get(name, 0.0) for name in names])


def settle(posterior: Posterior, free: Collection[str]) -> Settled:
    """Estimate some parameters of a record.

    Args:
        posterior: of the record.
        free: names of the parameters.
    """
    m = posterior.measurement
    # an order's sine is free with its cosine, and the ripple that the encoder leaves uncertain always
    free = frozenset(p.name for p in m.parameters if p.departs(free) or p.kind == "motion")
    x, like = posterior.fit.x, posterior.fit
    tolerant = map_fit(
        m, posterior.hypothesis, x, free, iterations=5, inflation=like.inflation, scale=like.scale, relinearise=True
    )
    return Settled(posterior, free, tolerant)


def settled_sensors(posterior: Posterior, both_directions: bool = False) -> frozenset[str]:
    """Names of the parameters that `calibrate` estimates: identifiable sensors and friction, and all departures.

    Args:
        posterior: of the record.
        both_directions: the shaft turns in both directions, so that an offset differs from friction.
    """
    m = posterior.measurement
    free = {*posterior.off_nominal, GAIN, COULOMB, *(p.name for p in m.parameters if p.kind in OF_A_LAW)}
    if m.model.depends_on_angle():
        free |= {ZERO}
    if m.record.one_speed:
        kept = DELAY if DELAY in posterior.off_nominal and ZERO not in posterior.off_nominal else ZERO
        free = (free - {ZERO, DELAY}) | ({kept} if kept == DELAY or ZERO in free else set())
    else:
        free |= {DELAY, VISCOUS}
    if m.record.speed_controlled and not m.model.shaft_inertias.isdisjoint(free):
        free -= {DELAY}
    if both_directions or (m.record.standstills and HELD not in posterior.off_nominal):
        free |= {OFFSET}
    return frozenset(free)
