"""Posterior of a record: discrete settings, values with standard deviations, and departures from the file.

All values are in the unit of their `ModelParameter`.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.inference.evidence import (
    EQUIVALENT_NATS,
    OF_BODIES,
    Choice,
    Departures,
    QuadraticEvidence,
)
from textile_twin_core.inference.map_fit import Fit, map_fit
from textile_twin_core.inference.measurement import Hypothesis, Measurement
from textile_twin_core.inference.parameter import (
    BUTTERWORTH,
    DELAY,
    LOW_PASS,
    ModelParameter,
)

IMPLAUSIBLE_NATS = 30.0
"""Prior cost of the departures above which another machine is likelier."""
_AGAIN = 10
"""Iterations of the fit of a posterior without the filters of another one."""


@dataclass(frozen=True)
class Posterior:
    """Posterior of a machine and its sensors, given a record.

    Attributes:
        measurement: record, model and parameters, linear about the fit.
        configured: discrete settings and sensor of the machine file.
        fit: values and their covariance; the prior is wide for a departure and the tolerance for any other parameter.
        choice: the parameters that depart, and sets of departures that explain the record equally well.
        log_evidence: of the choice at its own fit.
        others: other discrete hypotheses, likeliest first.
    """

    measurement: Measurement
    configured: Hypothesis
    fit: Fit
    choice: Choice
    log_evidence: float
    others: tuple[Fit, ...]

    @property
    def off_nominal(self) -> Departures:
        """Names of the parameters that depart from the file."""
        return self.choice.off_nominal

    @property
    def plain(self) -> Departures:
        """Departures but those of bodies and links, which could imitate a filter of the torque."""
        return frozenset(name for name in self.off_nominal if self.parameter(name).kind not in OF_BODIES)

    @property
    def hypothesis(self) -> Hypothesis:
        """The likeliest discrete settings."""
        return self.fit.hypothesis

    def parameter(self, name: str) -> ModelParameter:
        """Return a parameter by name."""
        return self.measurement.parameters[self.measurement.place[name]]

    def value(self, name: str) -> float:
        """Value of a parameter. For a sensor it is the departure from `hypothesis`; for the gain see `gain_factor`."""
        return float(self.fit.x[self.measurement.place[name]])

    def departure(self, name: str) -> float:
        """Value less nominal value."""
        return self.value(name) - self.parameter(name).nominal

    def sigma(self, name: str) -> float:
        """Standard deviation of a value, given the tolerances of all others."""
        k = self.measurement.place[name]
        return math.sqrt(float(self.fit.covariance[k, k]))

    def covariance(self, names: Collection[str]) -> FloatArray:
        """Covariance (n, n) of some values."""
        k = [self.measurement.place[name] for name in names]
        return self.fit.covariance[np.ix_(k, k)]

    def equivalents(self, name: str) -> tuple[str, ...]:
        """Parameters whose departure, in place of this one, explains the record equally well, likeliest first."""
        others = self._without_lag(self.off_nominal) - {name}
        rivals = [self._without_lag(s) for _, s in self.choice.rivals]
        swapped = [s - others for s in rivals if others <= s and name not in s and len(s) == len(others) + 1]
        return tuple(dict.fromkeys(next(iter(each)) for each in swapped))

    def _without_lag(self, off_nominal: Departures) -> Departures:
        """Departures without the delay that accompanies a low pass which the file does not have."""
        added = any(n in off_nominal and not self.parameter(n).nominal for n in (LOW_PASS, BUTTERWORTH))
        return off_nominal - {DELAY} if added else off_nominal

    @property
    def explained(self) -> float:
        """Share of the torque's variance that the values explain, sample by sample."""
        residual, good = self.measurement.residual(self.hypothesis, self.fit.x)
        torque = self.measurement.record.torque_Nm[good]
        return 1.0 - float(np.mean(residual[good] ** 2)) / max(float(np.var(torque)), 1e-300) if torque.size else 0.0

    def beside(self, off_nominal: Departures, less: float) -> Posterior:
        """Return a copy with a rival set of departures whose log evidence is less, if that hardly is."""
        if less > EQUIVALENT_NATS:
            return self
        rivals = ((self.log_evidence - less, off_nominal), *self.choice.rivals)
        return replace(self, choice=replace(self.choice, rivals=rivals))

    @property
    def is_motion_uncertain(self) -> bool:
        """True if the motion's uncertainty makes more torque than the values leave unexplained."""
        return self.fit.rms < abs(self.hypothesis.gain) * self.measurement.uncertain_Nm

    @property
    def prior_cost(self) -> float:
        """Prior cost of the departures in nats: large if this machine explains the torque only by many mistakes."""
        cost = 0.0
        for name in sorted(self.off_nominal):
            p = self.parameter(name)
            cost += min(0.5 * (self.departure(name) / p.spread(self.value(name))) ** 2, 6.0) - p.log_odds
        return cost


def evidence_on(measurement: Measurement, found: Posterior, like: Fit) -> float:
    """Log evidence of a posterior on other samples, with the scale and inflation of another fit."""
    return evidence_of(measurement, fit_like(measurement, found, like), found.off_nominal)


def evidence_of(measurement: Measurement, fit: Fit, off_nominal: Departures) -> float:
    """Log evidence of departures about their fit."""
    return QuadraticEvidence(measurement, fit, fit.inflation)(off_nominal) + fit.log_likelihood


def fit_like(measurement: Measurement, found: Posterior, like: Fit) -> Fit:
    """Fit of a posterior on other samples, with the scale and inflation of another fit.

    The torque passes those filters of the other fit, too, at their nominal values, and is fitted again: behind a filter
    samples beside steps of the load weigh less.
    """
    more = like.hypothesis.filters - found.hypothesis.filters
    x = measurement.nominal.copy()
    for name in found.measurement.names:  # the uncertain motion may have other orders
        if name in measurement.place:
            x[measurement.place[name]] = found.value(name)
    return map_fit(
        measurement,
        replace(found.hypothesis, filters=found.hypothesis.filters | more),
        x,
        found.off_nominal,
        free=set(measurement.names) - more,
        iterations=_AGAIN if more else 0,
        inflation=like.inflation,
        scale=like.scale,
        relinearise=True,
    )


def likelier(one: Posterior, other: Posterior) -> Posterior:
    """Return the likelier of two posteriors, compared on the other's samples with its scale and inflation."""
    return one if evidence_on(other.measurement, one, other.fit) >= other.log_evidence else other
