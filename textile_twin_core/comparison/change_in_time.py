"""A force or a gain that changes while a recording runs, from the residual of a fit with constant values."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.comparison.evidence import Evidence
from textile_twin_core.dynamics.loads import Backing, ShaftFriction
from textile_twin_core.inference.parameter import GAIN, gain_factor
from textile_twin_core.inference.posterior import Posterior

_MOST_KNOTS, _TURNS_A_KNOT = 8, 5.0
"""Most knots of the value over time, and fewest turns between two of them."""
_EXPLAINS = 0.5
"""Largest share of the residual's mean square that a change may leave."""
_ALIKE = 1.5
"""Ratio of what two changes leave below which they are not distinguished."""


@dataclass(frozen=True)
class ChangeInTime:
    """A force or the torque sensor's gain that changes, linear between knots.

    Attributes:
        name: path of the value. equivalents: paths of values whose change explains the record nearly as well.
        away: (k,) the value at the knots beside its mean over the samples; of the gain, as a share of it.
        torque_Nm: (m,) what the change adds to the readings.
    """

    name: str
    equivalents: tuple[str, ...]
    away: FloatArray
    torque_Nm: FloatArray


def change_in_time(evidence: Evidence, posterior: Posterior) -> ChangeInTime | None:
    """Find the force or gain whose change over time explains most of a residual; None if none does.

    Args:
        evidence: all samples. posterior: fitted with constant values.
    """
    p, m = posterior, posterior.measurement
    names = [known.name for known in m.parameters if known.kind == "force" or known.name == GAIN]
    knots = min(_MOST_KNOTS, int(evidence.track.turns / _TURNS_A_KNOT))
    every = m.on(replace(m.record, time_s=evidence.time_s, torque_Nm=evidence.torque_Nm, block_s=0.0))
    residual, good = every.residual(p.hypothesis, p.fit.x)
    if knots < 2 or np.count_nonzero(good) < knots:
        return None
    slopes = every.expected(p.hypothesis, p.fit.x, slopes=True).slopes
    assert slopes is not None
    inside = evidence.time_s[good]
    at = np.linspace(float(inside[0]), float(inside[-1]), knots)
    hats = np.stack([np.interp(evidence.time_s, at, row) for row in np.eye(knots)], 1)
    columns = {name: np.nan_to_num(slopes[:, m.place[name]]) for name in names}
    fits = {name: _fitted(hats * columns[name][:, None], residual, good) for name in names}
    best = min(names, key=lambda name: fits[name][1])
    if best == GAIN and any(not isinstance(load, Backing | ShaftFriction) for load in m.model.machine.loads):
        return None  # a law or a spring may change, too, and is no single value
    away, left = fits[best]
    if left >= _EXPLAINS * _square(residual[good]) or np.ptp(away) < p.parameter(best).threshold:
        return None
    weight = columns[best][good] ** 2
    away = away - float(weight @ (hats[good] @ away)) / float(weight.sum())
    added = hats @ away * columns[best]
    if best == GAIN:  # the column is by the parameter, whose slope the factor is
        away = away * gain_factor(p.value(GAIN))
    alike = tuple(name for name in names if name != best and fits[name][1] < _ALIKE * left)
    return ChangeInTime(best, alike, away, added)


def _fitted(columns: FloatArray, residual: FloatArray, good: BoolArray) -> tuple[FloatArray, float]:
    """Coefficients of the columns (m, k), and the mean square of the residual (m,) that they leave."""
    found: FloatArray = np.asarray(np.linalg.lstsq(columns[good], residual[good], rcond=1e-10)[0], np.float64)
    return found, _square((residual - columns @ found)[good])


def _square(values: FloatArray) -> float:
    return float(np.mean((values - np.mean(values)) ** 2))
