"""Criterion for departures from nominal: the evidence of a set of them, in closed form about a fit, and its search.

With A the information over the inflation, g the gradient, D the prior variances, m = nominal - x and u = g + m / D, the
logarithm of the evidence is u' (A + 1/D)^-1 u / 2 - m' D^-1 m / 2 - log det(I + D A) / 2 plus the log odds of the set
(Laplace's approximation; MacKay 1992).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.inference.map_fit import Fit, prior_variance
from textile_twin_core.inference.measurement import Measurement
from textile_twin_core.inference.parameter import DELAY, FILTERS, HIGH_PASS

Departures = frozenset[str]
EQUIVALENT_NATS = 3.0
"""Difference of log evidence below which two explanations are named together."""
OF_BODIES = (
    "mass",
    "inertia",
    "centroid",
    "length",
    "ground",
    "angle",
    "spring",
    "preload",
    "load",
    "plane",
)
"""Kinds of the numbers of bodies, links and springs."""
_PAIRED = 8
"""Likeliest single departures with which all pairs are tried."""
_MOST = 6
"""Largest number of departures in a set."""


@dataclass(frozen=True)
class Choice:
    """A set of departures, its log evidence, and sets within `EQUIVALENT_NATS` of it, likeliest first."""

    off_nominal: Departures
    log_evidence: float
    rivals: tuple[tuple[float, Departures], ...]


class QuadraticEvidence:
    """Log evidence of sets of departures on the quadratic form of the likelihood about one fit.

    The matrix with all parameters at their everyday tolerance is inverted once; each set changes the prior of a few
    parameters, which costs matrices of its own size (Woodbury's identity).

    Args:
        measurement: record and parameters.
        fit: the fit, with information and gradient.
        inflation: of the information.
    """

    def __init__(self, measurement: Measurement, fit: Fit, inflation: float) -> None:
        self._parameters, self._place = measurement.parameters, measurement.place
        self._x, self._nominal = fit.x, measurement.nominal
        variance = prior_variance(measurement, (), fit.x)
        information, gradient = fit.information / inflation, fit.gradient / inflation
        away = measurement.nominal - fit.x
        # scaled by the tolerances, I + D^1/2 A D^1/2 is well conditioned
        self._root = root = np.sqrt(variance)
        matrix = np.eye(root.size) + root[:, None] * information * root
        self._inverse = np.linalg.inv(matrix)
        self._side = root * (gradient + away / variance)
        self._mean = self._inverse @ self._side
        self._everyday = -0.5 * float(np.linalg.slogdet(matrix)[1])
        self._away = away / root

    def __call__(self, off_nominal: Collection[str]) -> float:
        """Log evidence of a set of departures, odds included."""
        known = sorted((p for p in self._parameters if p.departs(off_nominal)), key=lambda p: p.name)
        k = np.array([self._place[p.name] for p in known], dtype=np.int64)
        spread = np.array([p.spread(v) for p, v in zip(known, self._x[k].tolist(), strict=True)])
        if any(p.widest > p.departure for p in known):  # the width of their prior is that at the posterior mean
            mean = self._gaussian(k, spread)[1]
            spread = np.array([p.spread(v) for p, v in zip(known, mean.tolist(), strict=True)])
        found, mean, sigma = self._gaussian(k, spread)
        for p, m, s, wide in zip(known, mean.tolist(), sigma.tolist(), spread.tolist(), strict=True):
            if np.isfinite(p.low):
                # share of the posterior and of the prior within the bound
                low = p.low - p.tolerance
                found += float(log_ndtr((m - low) / s)) - float(log_ndtr((p.nominal - low) / wide))
        total: float = float(found) + sum(p.log_odds for p in known)
        return total

    def _gaussian(self, k: IntArray, spread: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """Log evidence, and posterior mean and standard deviation of the parameters k under priors this wide."""
        narrower = (self._root[k] / spread) ** 2 - 1.0
        inverse = self._inverse[np.ix_(k, k)]
        inner = np.eye(k.size) + narrower[:, None] * inverse
        side = narrower * self._away[k]
        moved = self._mean[k] + inverse @ side
        solved = np.linalg.solve(inner.T, inverse.T).T
        mean = moved - solved @ (narrower * moved)
        whole = float(self._side @ self._mean) + 2.0 * float(side @ self._mean[k]) + float(side @ inverse @ side)
        quadratic = whole - float((narrower * moved) @ mean)
        prior = float(self._away @ self._away) + float(np.sum(narrower * self._away[k] ** 2))
        determinant = float(np.linalg.slogdet(inner)[1]) + 2.0 * float(np.sum(np.log(spread / self._root[k])))
        found = self._everyday + 0.5 * (quadratic - prior) - 0.5 * determinant
        sigma = self._root[k] * np.sqrt(np.maximum(np.diag(solved), 1e-300))
        return found, self._x[k] + self._root[k] * mean, sigma


def is_one(measurement: Measurement, off_nominal: Collection[str]) -> bool:
    """Return true for delay and an inertia of the shaft together: a speed-controlled drive makes them look alike.

    Their difference is then mostly the error of the estimated acceleration, which an inertia that is too small removes.
    """
    if not measurement.record.speed_controlled or DELAY not in off_nominal:
        return False
    return not measurement.model.shaft_inertias.isdisjoint(off_nominal)


def undeclared_filters(measurement: Measurement, fit: Fit) -> Departures:
    """Return the filters of a fit's hypothesis that the machine file does not have, a low pass with its delay.

    Low pass and delay look alike at low frequencies: given an exact delay the corner would seem known too well.
    """
    found = frozenset(n for n in fit.hypothesis.filters if not measurement.nominal[measurement.place[n]])
    return found if found <= {HIGH_PASS} else found | {DELAY}


def hidden_by_motion(measurement: Measurement, fit: Fit) -> frozenset[str]:
    """Return the numbers of bodies and links whose usual mistake changes the torque less than the motion's uncertainty.

    The encoder, its rate and the shaft's inertia cannot show these.
    """
    if not measurement.uncertain_Nm:
        return frozenset()
    slope = fit.scale * np.sqrt(np.diag(fit.information) / max(fit.count, 1))
    return frozenset(
        p.name
        for p, each in zip(measurement.parameters, slope.tolist(), strict=True)
        if p.kind in OF_BODIES and each * p.departure < measurement.uncertain_Nm
    )


def choose(measurement: Measurement, fit: Fit, inflation: float, start: Collection[str] = ()) -> Choice:
    """Search the likeliest set of departures: add, drop and swap one; from an empty set also add pairs.

    Filters of the fit's hypothesis that the file does not have are in each set, other filters in none, and no body
    behind a high pass that the file does not have.
    """
    always = undeclared_filters(measurement, fit)
    absent = set(FILTERS) - fit.hypothesis.filters | hidden_by_motion(measurement, fit)
    if HIGH_PASS in always:  # first the mean has to be in the record: its change over a run-up looks like a body's
        absent |= {p.name for p in measurement.parameters if p.kind in (*OF_BODIES, "rotor")}
    names = tuple(p.name for p in measurement.parameters if p.may_depart and p.name not in absent)
    start = always.union(start)
    evidence = QuadraticEvidence(measurement, fit, inflation)
    seen: dict[Departures, float] = {}

    def value(off_nominal: Departures) -> float:
        if off_nominal not in seen and always <= off_nominal and not is_one(measurement, off_nominal):
            seen[off_nominal] = evidence(off_nominal)
        return seen.get(off_nominal, -np.inf)

    here = frozenset(start)
    best = value(here)
    while True:
        inside = sorted(here)  # sets have no order of their own, and the first of equals wins
        moves = [here - {name} for name in inside]
        moves += [here - {gone} | {name} for gone in inside for name in names if name not in here]
        if len(here) < _MOST + len(always):
            moves += [here | {name} for name in names if name not in here]
        if here == always:
            single = sorted(names, key=lambda name: -value(here | {name}))[:_PAIRED]
            moves += [here | {one, other} for one in single for other in names if other != one]
        top = max(moves, key=value)
        if value(top) <= best + 1e-9:
            break
        here, best = top, value(top)
    near = [(v, s) for s, v in seen.items() if s != here and v > best - EQUIVALENT_NATS]
    return Choice(here, best, tuple(sorted(near, key=lambda each: -each[0])))
