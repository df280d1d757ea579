"""Force law as a record shows it: forces at its knots with their covariance, and what follows from them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.dynamics.loads import ForceCurve
from textile_twin_core.inference.curved_torque import CurvedTorque
from textile_twin_core.inference.map_fit import Fit
from textile_twin_core.inference.posterior import Posterior

_CONSTANT: Final = 0.02
"""Variation of a force over its peak up to which it is a constant one: so near is a curve known."""
_DETERMINED: Final = 0.1
"""Standard deviation over the curve's peak above which a knot counts as not determined."""


@dataclass(frozen=True)
class LearnedCurve:
    """A force law with standard deviations.

    Attributes:
        name, measure: of the load. knots: (k,) values of the measure.
        in_N, out_N: (k,) force against the motion while the measure grows and shrinks.
        covariance: (2k, 2k) of both together, the way in first.
        speed_power: power of the shaft speed with which the force grows. at_speed_rad_s: speed of the values.
    """

    name: str
    measure: str
    knots: FloatArray
    in_N: FloatArray
    out_N: FloatArray
    covariance: FloatArray
    speed_power: Literal[0, 1, 2]
    at_speed_rad_s: float

    @property
    def in_sigma_N(self) -> FloatArray:
        """(k,) standard deviations on the way in."""
        return np.sqrt(np.diag(self.covariance)[: self.knots.size])

    @property
    def out_sigma_N(self) -> FloatArray:
        """(k,) standard deviations on the way out."""
        return np.sqrt(np.diag(self.covariance)[self.knots.size :])

    @property
    def peak_N(self) -> float:
        """Largest force."""
        return float(max(np.max(np.abs(self.in_N)), np.max(np.abs(self.out_N))))

    @property
    def varies(self) -> bool:
        """True unless the force is a constant one to what a curve is known."""
        force = np.concatenate([self.in_N, self.out_N])
        return float(np.ptp(force)) > _CONSTANT * self.peak_N

    def undetermined(self, growing: bool = True) -> BoolArray:
        """(k,) mask of the knots whose force the record does not determine."""
        sigma = self.in_sigma_N if growing else self.out_sigma_N
        return np.asarray(sigma > _DETERMINED * self.peak_N)

    def load(self) -> ForceCurve:
        """Return the law as a load of a machine."""
        down, up = (tuple(np.round(each, 3).tolist()) for each in (self.in_N, self.out_N))
        knots, speed = tuple(np.round(self.knots, 8).tolist()), self.at_speed_rad_s if self.speed_power else None
        return ForceCurve(self.name, self.measure, knots, down, up, speed_power=self.speed_power, at_speed_rad_s=speed)

    def work_J(self) -> tuple[float, float, float, float]:
        """Work against the force on the way in and on the way out, each with its standard deviation [J]."""
        width = np.diff(self.knots, prepend=self.knots[0], append=self.knots[-1])
        share = 0.5 * (width[:-1] + width[1:])
        found = []
        for k, force in enumerate((self.in_N, self.out_N)):
            part = slice(k * share.size, (k + 1) * share.size)
            found += [float(share @ force), math.sqrt(max(float(share @ self.covariance[part, part] @ share), 0.0))]
        return found[0], found[1], found[2], found[3]


def learned(posterior: Posterior, fit: Fit | None = None) -> LearnedCurve:
    """Return the force law of a posterior of `learn_curve`, from its own fit or another one of its parameters."""
    model = posterior.measurement.model
    assert isinstance(model, CurvedTorque)
    fit = fit or posterior.fit
    k = [posterior.measurement.place[name] for name in model.names]
    forces = model.spread @ fit.x[k]
    covariance = model.spread @ fit.covariance[np.ix_(k, k)] @ model.spread.T
    place, way = model.place, model.knots.size
    return LearnedCurve(
        place.name, place.measure, model.knots, forces[:way], forces[way:], covariance, model.power, model.speed_rad_s
    )


def curve_and(name: str, posterior: Posterior, fit: Fit) -> FloatArray:
    """Return the covariance (2k,) of the forces with another parameter."""
    m = posterior.measurement
    assert isinstance(m.model, CurvedTorque)
    return np.asarray(m.model.spread @ fit.covariance[[m.place[each] for each in m.model.names], m.place[name]])
