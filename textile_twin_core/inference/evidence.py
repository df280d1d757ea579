"""The one criterion for departures: the evidence of a set of them, in closed form about a fit, and a sparse search.

With A the information over the inflation, g the gradient, D the prior variances, m = nominal - x and u = g + m / D, the
logarithm of the evidence is u' (A + 1/D)^-1 u / 2 - m' D^-1 m / 2 - log det(I + D A) / 2 plus the log odds of the set
(Laplace's approximation; MacKay 1992).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import log_ndtr

from textile_twin_core.arrays import FloatArray
from textile_twin_core.inference.map_fit import Fit, prior_variance
from textile_twin_core.inference.measurement import Measurement
from textile_twin_core.inference.parameter import DELAY, ROTOR

Departures = frozenset[str]
EQUIVALENT_NATS = 3.0
"""Difference of log evidence below which two explanations are named together."""
_PAIRED = 8
"""Likeliest single departures with which all pairs are tried."""
_MOST = 6
"""Departures beyond which a set no longer grows."""


@dataclass(frozen=True)
class Choice:
    """A set of departures, its log evidence, and sets within `EQUIVALENT_NATS` of it, likeliest first."""

    departing: Departures
    log_evidence: float
    rivals: tuple[tuple[float, Departures], ...]


def log_evidence(measurement: Measurement, fit: Fit, departing: Collection[str], inflation: float) -> float:
    """Log evidence of a set of departures on the quadratic form of the likelihood about a fit."""
    wide = [p for p in measurement.parameters if p.name in departing and p.widest > p.departure]
    at = fit.x
    if wide:  # the width of their prior is that at the posterior mean
        mean = _gaussian(measurement, fit, prior_variance(measurement, departing, at), inflation)[1]
        at = at.copy()
        for p in wide:
            at[measurement.place[p.name]] = mean[measurement.place[p.name]]
    variance = prior_variance(measurement, departing, at)
    found, mean, lower = _gaussian(measurement, fit, variance, inflation)
    bounded = [p for p in measurement.parameters if p.name in departing and np.isfinite(p.low)]
    if bounded:
        root = np.sqrt(variance)
        inverse = solve_triangular(lower, np.eye(root.size), lower=True, check_finite=False)
        sigma = root * np.sqrt(np.sum(inverse**2, axis=0))
        for p in bounded:
            k = measurement.place[p.name]
            # what a bound cuts off of the posterior and of the prior
            low = p.low - p.tolerance
            inside = float(log_ndtr((mean[k] - low) / sigma[k]))
            found += inside - float(log_ndtr((p.nominal - low) / float(root[k])))
    return found + sum(p.log_odds for p in measurement.parameters if p.name in departing)


def _gaussian(
    measurement: Measurement, fit: Fit, variance: FloatArray, inflation: float
) -> tuple[float, FloatArray, FloatArray]:
    """Log evidence of Gaussian priors of these variances, the posterior mean, and a Cholesky factor."""
    information, gradient = fit.information / inflation, fit.gradient / inflation
    away = measurement.nominal - fit.x
    # scaled by the prior, I + D^1/2 A D^1/2 is well conditioned
    root = np.sqrt(variance)
    lower = np.linalg.cholesky(np.eye(root.size) + root[:, None] * information * root)
    u = solve_triangular(lower, root * (gradient + away / variance), lower=True, check_finite=False)
    found = 0.5 * float(u @ u) - 0.5 * float(np.sum(away**2 / variance)) - float(np.sum(np.log(np.diag(lower))))
    mean = fit.x + root * solve_triangular(lower, u, lower=True, trans="T", check_finite=False)
    return found, np.asarray(mean), np.asarray(lower)


def is_one(measurement: Measurement, departing: Collection[str]) -> bool:
    """Whether a set names delay and inertia where a controller of the speed makes them look alike."""
    return measurement.record.speed_controlled and {DELAY, ROTOR} <= set(departing)


def choose(measurement: Measurement, fit: Fit, inflation: float, start: Collection[str] = ()) -> Choice:
    """The likeliest set of departures: add, drop and swap one, and pairs with a likely one where there is none yet."""
    names = measurement.names
    seen: dict[Departures, float] = {}

    def value(departing: Departures) -> float:
        if departing not in seen and not is_one(measurement, departing):
            seen[departing] = log_evidence(measurement, fit, departing, inflation)
        return seen.get(departing, -np.inf)

    here = frozenset(start)
    best = value(here)
    while True:
        moves = [here - {name} for name in here]
        moves += [here - {gone} | {name} for gone in here for name in names if name not in here]
        if len(here) < _MOST:
            moves += [here | {name} for name in names if name not in here]
        if not here:
            single = sorted(names, key=lambda name: -value(frozenset({name})))[:_PAIRED]
            moves += [frozenset({one, other}) for one in single for other in names if other != one]
        top = max(moves, key=value)
        if value(top) <= best + 1e-9:
            break
        here, best = top, value(top)
    near = [(v, s) for s, v in seen.items() if s != here and v > best - EQUIVALENT_NATS]
    return Choice(here, best, tuple(sorted(near, key=lambda each: -each[0])))
