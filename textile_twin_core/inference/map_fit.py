"""Robust maximum-a-posteriori fit: Huber's loss of the residuals over their inflation, and Gaussian priors.

Gauss-Newton with Levenberg's damping on the normal equations, which costs a tenth of a trust region on the slopes
themselves; samples may leave the fit while time shifts, which a general solver does not allow.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.inference.blocks import OVERLAP
from textile_twin_core.inference.measurement import Expected, Hypothesis, Measurement
from textile_twin_core.inference.parameter import COULOMB, DELAY, DRIFT, GAIN, ROTOR, ZERO
from textile_twin_core.inference.robust import huber_loss, huber_weights

TURN = 2.0 * np.pi
_LONGEST = {ZERO: 0.15, DELAY: 0.01, DRIFT: 3e-4, GAIN: 0.7}
"""Longest step of one iteration, since the torque oscillates with the angle."""
_HIGHEST = {GAIN: 0.95}
"""Upper bounds: beyond this one the gain would be twenty times that of the nearest unit."""
_REACH = 6.0
"""Bounds of the values in standard deviations of the widest departure."""
_CONVERGED, _MOST_DAMPING = 1e-2, 1e4
_AS_PREDICTED = 0.5
"""Fall of the cost, over that predicted by the slopes, from which the next step takes the same slopes."""
_KEPT = 0.7
"""Share of the samples that a step must keep."""
_WIDENED = 3
"""Most refits with updated widths of the priors."""
_BESIDE = 3.0
"""Standard deviation of a sample beside a step of the load, in scales of the residual, that halves its weight."""
CLUSTERED = (ZERO, DELAY, GAIN, COULOMB, ROTOR)
"""Parameters whose scores per turn, and per sector of the turn, give the inflation of the residuals."""
SECTORS = 24
"""Sectors of the turn in which residuals count as correlated between turns."""


@dataclass(frozen=True)
class Fit:
    """A fit and the quadratic form of the likelihood about it.

    Attributes:
        x: (k,) values. hypothesis: discrete settings.
        information: (k, k) of the samples without inflation and of the readings at standstill, which have none,
            times the inflation; gradient: (k,) of their log likelihood, likewise.
        scale: of Huber's loss [N m]. inflation: variance of scores per turn over that of independent samples.
        rms: of the residual [N m]. explained: share of the torque's variance.
        log_likelihood: with the given inflation, without constants. Samples that a shift of time removes from the fit
            count as the mean of the others, so that removing samples makes no delay likelier.
        covariance: (k, k) of the values, priors included.
        count: residuals that entered.
    """

    x: FloatArray
    hypothesis: Hypothesis
    information: FloatArray
    gradient: FloatArray
    scale: float
    inflation: float
    rms: float
    explained: float
    log_likelihood: float
    covariance: FloatArray
    count: int


@dataclass(frozen=True)
class Weighed:
    """Weighted residuals at one place: normal matrix, gradient, cost and their sources.

    information, gradient: of the samples, without inflation. standing, standing_gradient: of the readings at
    standstill, which have a standard deviation of their own.
    absent: cost of the samples that are not in the fit, each as the mean of the others.
    slopes, every: of the residuals in the fit, and (m, k) of all samples.
    """

    information: FloatArray
    gradient: FloatArray
    standing: FloatArray
    standing_gradient: FloatArray
    scale: float
    cost: float
    absent: float
    residual: FloatArray
    own: FloatArray
    good: BoolArray
    rms: float
    theta: FloatArray
    turn: IntArray
    weighted: FloatArray
    slopes: FloatArray
    every: FloatArray


def prior_variance(measurement: Measurement, off_nominal: Collection[str], x: FloatArray) -> FloatArray:
    """Prior variances (k,): of departures for the named parameters, of everyday tolerances for all others."""
    pairs = zip(measurement.parameters, x.tolist(), strict=True)
    return np.array([(p.spread(v) if p.departs(off_nominal) else p.tolerance) ** 2 for p, v in pairs])


def map_fit(
    measurement: Measurement,
    hypothesis: Hypothesis,
    x: FloatArray,
    off_nominal: Collection[str],
    *,
    free: Collection[str] | None = None,
    iterations: int = 20,
    inflation: float = 0.0,
    scale: float = 0.0,
    relinearise: bool = False,
) -> Fit:
    """Fit all parameters, or those named in `free`, from x on.

    Args:
        measurement: record and model.
        hypothesis: discrete settings.
        x: (k,) start.
        off_nominal: parameters with the wide prior of a departure.
        free: parameters that may move; None: all.
        iterations: most iterations.
        inflation, scale: of the residuals where they are known from another fit; 0: estimated.
        relinearise: follow departures of the machine's numbers, on which the torque depends nonlinearly.
    """
    names = measurement.names
    index = np.array([k for k, name in enumerate(names) if free is None or name in free], dtype=np.int64)
    given = inflation or 1.0
    reach = np.array([_REACH * p.widest for p in measurement.parameters])
    low = np.maximum(measurement.nominal - reach, [p.low for p in measurement.parameters])
    high = np.minimum(measurement.nominal + reach, [_HIGHEST.get(name, np.inf) for name in names])
    variance, damping = prior_variance(measurement, off_nominal, x), 0.0

    def at(x: FloatArray) -> tuple[Measurement, Weighed]:
        near = measurement.linearised(x, off_nominal if relinearise else ())
        return near, weigh(near, hypothesis, x, variance, given, scale)

    near, here = at(x)
    exact = True  # slopes at x
    for _ in range(iterations):
        normal = here.information / given + here.standing + np.diag(1.0 / variance)
        slope = here.gradient / given + here.standing_gradient - (x - measurement.nominal) / variance
        trial: FloatArray = np.clip(x + _step(names, index, normal, slope, damping, (low - x, high - x)), low, high)
        step = trial - x
        predicted = float(step @ (2.0 * slope - normal @ step))
        seen = near.expected(hypothesis, trial)
        cost = _cost(near, hypothesis, trial, variance, given, here, seen)
        fell, converged = here.cost - cost, exact and predicted < _CONVERGED
        if fell > -1e-9:
            x, damping = trial, damping / 10.0 if damping > 1e-6 else 0.0
            moved = near.about is not measurement.linearised(x, off_nominal if relinearise else ()).about
            if not moved and (converged or (predicted > _CONVERGED and fell > _AS_PREDICTED * predicted)):
                here, exact = weigh(near, hypothesis, x, variance, given, scale, seen, here.every), False
            else:
                (near, here), exact = at(x), True
        elif not exact:
            (near, here), exact = at(x), True
        else:
            damping = max(10.0 * damping, 1e-3)
        if converged or damping > _MOST_DAMPING:
            break
    used = inflation or float(np.median(inflations(measurement, here)))
    away = x - measurement.nominal
    information = here.information + used * here.standing
    covariance = np.asarray(np.linalg.inv(information / used + np.diag(1.0 / variance)))
    torque = measurement.record.torque_Nm
    return Fit(
        x,
        hypothesis,
        information,
        here.gradient + used * here.standing_gradient,
        here.scale,
        used,
        here.rms,
        1.0 - here.rms**2 / max(float(np.var(torque)), 1e-300),
        -0.5 * (here.cost - float(np.sum(away**2 / variance)) + here.absent),
        covariance,
        here.residual.size,
    )


def fit_with_prior_update(
    measurement: Measurement, hypothesis: Hypothesis, x: FloatArray, off_nominal: Collection[str], **options: Any
) -> Fit:
    """Repeat `map_fit` from its result while the widths of the priors change, since they follow large departures."""
    fit = map_fit(measurement, hypothesis, x, off_nominal, **options)
    for _ in range(_WIDENED):
        before, after = prior_variance(measurement, off_nominal, x), prior_variance(measurement, off_nominal, fit.x)
        if np.all(np.maximum(before / after, after / before) < 2.0):
            break
        x = fit.x
        fit = map_fit(measurement, hypothesis, x, off_nominal, **options)
    return fit


def weigh(
    measurement: Measurement,
    hypothesis: Hypothesis,
    x: FloatArray,
    variance: FloatArray,
    inflation: float,
    scale: float,
    seen: Expected | None = None,
    known: FloatArray | None = None,
) -> Weighed:
    """Weigh the residuals at x.

    Args:
        scale: of Huber's loss; 0: that of these residuals.
        seen: expected readings at x. known: (m, k) slopes near x.
    """
    record = measurement.record
    if seen is None or known is None:
        seen = measurement.expected(hypothesis, x, slopes=True)
        known = seen.slopes
    assert known is not None
    usable = seen.good & np.isfinite(known.sum(axis=1))
    error, noise = measurement.error(seen)
    own = np.ones_like(error)
    if not record.block_s and seen.good.any():
        own = 1.0 / (1.0 + (seen.sigma / (_BESIDE * noise)) ** 2)
    averaged, good = measurement.means(np.stack([error, own, seen.theta], 1), usable)
    residual, own, theta = averaged.T
    slopes, _ = measurement.means(known, usable)
    if not good.all():
        residual, own, theta, slopes = residual[good], own[good], theta[good], slopes[good]
    if not scale:
        # averages over a step of the load scatter more but count in full: no robust scale there
        scale = float(np.sqrt(np.mean(residual**2))) if record.block_s else noise
    weight = huber_weights(residual, scale) * own
    root = np.sqrt(weight)
    scaled = slopes * root[:, None]
    information = scaled.T @ scaled / scale**2
    gradient = scaled.T @ (root * residual) / scale**2
    standing, standing_slopes = measurement.at_standstill(hypothesis, x, slopes=True)
    assert standing_slopes is not None
    weighted = standing_slopes * huber_weights(standing, 1.0)[:, None]
    loss = float(np.sum(own * huber_loss(residual, scale))) / inflation
    absent = loss * (good.size - residual.size) / max(residual.size, 1)
    cost = loss + float(np.sum(huber_loss(standing, 1.0)))
    cost += float(np.sum((x - measurement.nominal) ** 2 / variance))
    turn = np.floor(theta / TURN).astype(np.int64)
    if record.block_s * abs(record.speed_rad_s) > 0.5 * TURN:
        # averages over a turn scatter from turn to turn: batches of the square root of their number show it
        turn = turn // max(math.isqrt(int(np.ptp(turn))), 1) if turn.size else turn
    rms = float(np.sqrt(np.sum(own * residual**2) / max(float(np.sum(own)), 1e-300)))
    return Weighed(
        information, gradient, weighted.T @ standing_slopes, weighted.T @ standing, scale, cost, absent, residual, own,
        good, rms, theta, turn, weight * residual, slopes, known,
    )  # fmt: skip


def _cost(
    measurement: Measurement,
    hypothesis: Hypothesis,
    x: FloatArray,
    variance: FloatArray,
    inflation: float,
    here: Weighed,
    seen: Expected,
) -> float:
    """Cost at another place with the weights of this one, over their common samples; infinite with too few."""
    columns, good = measurement.means(measurement.error(seen)[0][:, None], seen.good)
    both = here.good & good
    count = np.count_nonzero(both)
    if count < _KEPT * np.count_nonzero(here.good):
        return float("inf")
    own = np.ones(both.size)
    own[here.good] = here.own
    loss = float(np.sum(own[both] * huber_loss(columns[both, 0], here.scale))) / inflation
    standing, _ = measurement.at_standstill(hypothesis, x)
    prior = float(np.sum((x - measurement.nominal) ** 2 / variance))
    return loss * np.count_nonzero(here.good) / count + float(np.sum(huber_loss(standing, 1.0))) + prior


def _step(
    names: tuple[str, ...],
    index: IntArray,
    normal: FloatArray,
    slope: FloatArray,
    damping: float,
    room: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Damped step of the free parameters, zero for the others.

    A parameter that would leave its `room` goes to the bound, and the others are solved for again beside it: an offset
    must take all of a mean torque that a friction of zero cannot (projected Newton, Bertsekas 1982).
    """
    size = np.sqrt(np.diag(normal))
    scaled = normal / np.outer(size, size)
    step = np.zeros(len(names))
    free = index
    while free.size:
        side = slope[free] / size[free] - scaled[free] @ (step * size * ~np.isin(np.arange(step.size), free))
        inner = scaled[np.ix_(free, free)] + damping * np.eye(free.size)
        step[free] = np.linalg.solve(inner, side) / size[free]
        inside = (step[free] >= room[0][free]) & (step[free] <= room[1][free])
        if inside.all():
            break
        step = np.clip(step, *room)
        free = free[inside]
    for name, longest in _LONGEST.items():
        away = abs(step[names.index(name)])
        if away > longest:
            step *= longest / away
    return step


def inflations(measurement: Measurement, here: Weighed) -> FloatArray:
    """Variance of the scores per turn over that of independent samples, by parameter, at least that of white noise.

    Scores of the same sector in all turns are summed, too: an error that repeats in every turn, as of the acceleration
    at a step of the load, shows there alone (clusters both ways, Cameron, Gelbach and Miller 2011).
    """
    asked = [measurement.place[name] for name in CLUSTERED]
    alone = np.maximum(np.diag(here.information)[asked], 1e-300)
    sector = np.floor(np.mod(here.theta, TURN) * (SECTORS / TURN)).astype(np.int64)
    by_turn, by_sector = (
        np.array([scores @ scores for scores in _scores(here, asked, np.unique(each, return_inverse=True)[1])])
        for each in (here.turn, sector)
    )
    of_turns, of_sectors = (clustered / here.scale**4 / alone for clustered in (by_turn, by_sector))
    white = np.ones(len(asked))
    if measurement.record.block_s:  # neighbours of slow slopes repeat each other
        rows = np.zeros((here.good.size, len(asked)))
        rows[here.good] = here.slopes[:, asked]
        white += OVERLAP * np.maximum(np.sum(rows[1:] * rows[:-1], 0) / np.maximum(np.sum(rows**2, 0), 1e-300), 0.0)
    return np.maximum(of_turns, white) + np.maximum(of_sectors - 1.0, 0.0)


def _scores(here: Weighed, asked: list[int], place: IntArray) -> list[FloatArray]:
    """Sums of the scores of some parameters over the samples of each place."""
    return [np.bincount(place, column * here.weighted).astype(np.float64) for column in here.slopes[:, asked].T]
