"""Fit of chosen numbers to every sample of a record, by instruments that are free of the acceleration's errors."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.uncertainty import Uncertainty, uncertainty_by_turns_and_angle
from textile_twin_core.inference.map_fit import SECTORS, TURN, map_fit, prior_variance, weigh
from textile_twin_core.inference.measurement import Hypothesis, Measurement
from textile_twin_core.inference.record import RecordedMotion
from textile_twin_core.inference.robust import huber_weights, robust_scale

_MOST_LOSS = 2.0
"""Factor on a standard deviation above which instruments cost more than the errors of the acceleration."""
_ROUNDS, _STILL, _RUN_AWAY = 8, 1e-4, 2.0
_STEPS = 25


@dataclass(frozen=True)
class InstrumentedFit:
    """Values of a fit, and the rows that give their uncertainty.

    Attributes:
        x: (k,) values of all parameters of the measurement.
        free: names of the fitted ones, f of them.
        slopes, instruments: (n, f) of the expected torque by the fitted parameters, on the record's motion and on the
            clean one; weighted.
        residual: (n,) measured less expected torque, weighted [N m].
        turn, sector: (n,) number of each row's turn, and of its sector of the turn; a standstill has its own ones.
    """

    x: FloatArray
    free: tuple[str, ...]
    slopes: FloatArray
    instruments: FloatArray
    residual: FloatArray
    turn: IntArray
    sector: IntArray

    @property
    def uncertainty(self) -> Uncertainty:
        """Covariance and intervals of the fitted parameters."""
        return uncertainty_by_turns_and_angle(self.slopes, self.residual, self.turn, self.sector, self.instruments)


def instrumented_fit(
    measurement: Measurement,
    hypothesis: Hypothesis,
    start: FloatArray,
    free: Collection[str],
    clean: RecordedMotion | None = None,
) -> InstrumentedFit:
    """Fit parameters by robust least squares, then by instrumental variables.

    Errors of the shaft's acceleration are in the slopes as well as in the residual, which biases least squares. Slopes
    on a motion without these errors are instruments: the residual is made orthogonal to them (Soederstroem and Stoica
    1983, with Huber's weights). Where they would double a standard deviation, or their steps diverge, the values of
    least squares stay.

    Args:
        measurement: record, model and parameters.
        hypothesis: discrete settings of the sensors.
        start: (k,) values.
        free: names of the parameters to fit.
        clean: motion without the errors of single accelerations; None: least squares.
    """
    names = tuple(name for name in measurement.names if name in free)
    least = map_fit(measurement, hypothesis, start, names, free=names, iterations=_STEPS)
    variance = prior_variance(measurement, names, least.x)
    first = _rows(measurement, None, hypothesis, least.x, names, variance)
    if clean is None:
        return first
    other = measurement.on(replace(measurement.record, motion=clean))
    fit = begun = _rows(measurement, other, hypothesis, least.x, names, variance)
    if _loss(begun) > _MOST_LOSS:
        return first
    low = np.array([measurement.parameters[measurement.place[name]].low for name in names])
    place = [measurement.place[name] for name in names]
    for _ in range(_ROUNDS):
        step, size = _step(fit, low - fit.x[place])
        x = fit.x.copy()
        x[place] += step
        fit = _rows(measurement, other, hypothesis, x, names, variance)
        if float(np.max(np.abs(step) * size, initial=0.0)) < _STILL * float(np.std(fit.residual)):
            break
    return fit if np.std(fit.residual) < _RUN_AWAY * np.std(begun.residual) else first


def _rows(
    m: Measurement,
    other: Measurement | None,
    hypothesis: Hypothesis,
    x: FloatArray,
    names: tuple[str, ...],
    variance: FloatArray,
) -> InstrumentedFit:
    """Weighted residuals, slopes and instruments at x; standstills in the unit of the scale."""
    here = weigh(m, hypothesis, x, variance, 1.0, 0.0)
    k = [m.place[name] for name in names]
    root = np.sqrt(here.own)[:, None]
    slopes, residual, turn = here.slopes[:, k] * root, here.residual * root[:, 0], here.turn
    sector = np.floor(np.mod(here.theta, TURN) * (SECTORS / TURN)).astype(np.int64)
    instruments = slopes
    if other is not None:
        seen = other.expected(hypothesis, x, slopes=True)
        assert seen.slopes is not None
        columns, good = other.means(seen.slopes[:, k], seen.good)
        both: BoolArray = good[here.good]
        instruments = columns[here.good] * root
        slopes, instruments, residual = slopes[both], instruments[both], residual[both]
        turn, sector = turn[both], sector[both]
    standing, standing_slopes = m.at_standstill(hypothesis, x, slopes=True)
    if standing.size and standing_slopes is not None:
        still = standing_slopes[:, k] * here.scale
        slopes, instruments = np.concatenate([slopes, still]), np.concatenate([instruments, still])
        residual = np.concatenate([residual, standing * here.scale])
        turn = np.concatenate([turn, int(turn.max(initial=0)) + 1 + np.arange(standing.size)])
        sector = np.concatenate([sector, SECTORS + np.arange(standing.size)])
    return InstrumentedFit(x, names, slopes, instruments, residual, turn, sector)


def _step(fit: InstrumentedFit, lowest: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the next step, and the change of the torque per unit of each parameter.

    Parameters that would pass their bound stop at it, and the others are solved without them.
    """
    size = np.sqrt(np.mean(fit.slopes**2, axis=0)) + 1e-300
    weighted = fit.instruments / size * huber_weights(fit.residual, robust_scale(fit.residual))[:, None]
    normal, right = weighted.T @ (fit.slopes / size), weighted.T @ fit.residual
    step, stopped = np.zeros(size.size), np.zeros(size.size, dtype=np.bool_)
    for _ in range(size.size + 1):
        step[stopped] = lowest[stopped]
        moving = ~stopped
        sides = right[moving] - normal[np.ix_(moving, stopped)] @ (step[stopped] * size[stopped])
        step[moving] = np.linalg.lstsq(normal[np.ix_(moving, moving)], sides, rcond=1e-12)[0] / size[moving]
        below = moving & (step < lowest)
        if not below.any():
            break
        stopped |= below
    return step, size


def _loss(fit: InstrumentedFit) -> float:
    """Largest factor by which instruments widen a standard deviation."""
    size = np.sqrt(np.mean(fit.slopes**2, axis=0)) + 1e-300
    slopes, instruments = fit.slopes / size, fit.instruments / size
    if np.linalg.matrix_rank(instruments) < instruments.shape[1]:
        return float(np.inf)
    best = np.diag(np.linalg.pinv(slopes.T @ slopes, rcond=1e-13, hermitian=True))
    gain = np.linalg.pinv(instruments.T @ slopes, rcond=1e-13)
    reached = np.einsum("ij,jk,ik->i", gain, instruments.T @ instruments, gain)
    return float(np.sqrt(np.max(reached / best, initial=1.0)))
