"""Uncertainties that hold under model error: residuals may be correlated within a turn of the shaft.

They come from the sums of each turn, or from a bootstrap over whole turns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.inference.robust import HUBER, robust_scale

_ALONE = 1e-9
"""Share of the information in the other turns below which one turn alone determines a parameter."""
_FEW = 3.0
"""Degrees of freedom below which turns may agree by chance."""
_DETERMINED = 0.5
"""Share of a parameter's variance that the turns must determine."""
_NORMAL95 = 1.959964
_DRAWS = 400
_SEED = 20160614


def turn_normals(columns: FloatArray, place: IntArray) -> FloatArray:
    """Normal matrices (t, k, k) of columns (n, k); place: (n,) number of each sample's turn, from 0."""
    turns, count = int(place.max(initial=-1)) + 1, columns.shape[1]
    normals = np.empty((turns, count, count))
    for row in range(count):
        for column in range(row, count):
            normals[:, row, column] = np.bincount(place, weights=columns[:, row] * columns[:, column])
            normals[:, column, row] = normals[:, row, column]
    return normals


def turn_scores(columns: FloatArray, residual: FloatArray, place: IntArray) -> FloatArray:
    """Right sides (t, k) of the same turns, for residuals (n,)."""
    scores = np.empty((int(place.max(initial=-1)) + 1, columns.shape[1]))
    for k, column in enumerate(columns.T):
        scores[:, k] = np.bincount(place, weights=column * residual)
    return scores


@dataclass(frozen=True)
class Estimate:
    """A value, its standard deviation, and its 95 % interval; nan where unknown."""

    value: float
    sigma: float = math.nan
    interval95: tuple[float, float] = (math.nan, math.nan)

    @classmethod
    def normal(cls, value: float, sigma: float) -> Estimate:
        """Return the estimate of a normal distribution."""
        return cls(value, sigma, (value - _NORMAL95 * sigma, value + _NORMAL95 * sigma))

    def scaled(self, factor: float, shift: float = 0.0) -> Estimate:
        """Return factor * value + shift, with its uncertainty."""
        ends = sorted(factor * end + shift for end in self.interval95)
        return Estimate(factor * self.value + shift, abs(factor) * self.sigma, (ends[0], ends[1]))


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of k estimates.

    Attributes:
        covariance: (k, k). half_width: (k,) half the widths of their 95 % intervals.
        independent: (k,) variances if the residuals of all samples were independent.
    """

    covariance: FloatArray
    half_width: FloatArray
    independent: FloatArray

    def wider(self, moved: Sequence[FloatArray]) -> Uncertainty:
        """Widen by the moves (k,) of the estimates under other, equally good choices: each is a possible bias."""
        if not moved:
            return self
        bias = sum((np.outer(each, each) for each in moved), np.zeros_like(self.covariance))
        half = np.hypot(self.half_width, scipy.stats.norm.ppf(0.975) * np.sqrt(np.diag(bias)))
        return Uncertainty(self.covariance + bias, half, self.independent)

    def estimate(self, number: int, value: float) -> Estimate:
        """Return one estimate with its uncertainty."""
        sigma, half = math.sqrt(self.covariance[number, number]), float(self.half_width[number])
        return Estimate(float(value), sigma, (float(value) - half, float(value) + half))


def uncertainty_by_turns(
    slopes: FloatArray, residual: FloatArray, turn: IntArray, instruments: FloatArray | None = None
) -> Uncertainty:
    """Uncertainty of estimates whose residuals are correlated within a turn.

    The sandwich estimator with turns as clusters in the form of Bell and McCaffrey 2002 ("CR2", unbiased when the
    samples are independent), and Student's quantile with their degrees of freedom (Satterthwaite) for each parameter,
    which matter in a run-up of few turns. Two or three turns may agree by chance: with so few degrees of freedom the
    uncertainty is at least that of independent samples. With instruments both use the slopes projected on them
    (Pustejovsky and Tipton 2018, section 2.3). Huber's loss enters by pseudo-residuals. A parameter determined by one
    turn alone has the uncertainty of independent samples.

    Args:
        slopes: (n, k) of the expected torque by the parameters. residual: (n,) measured less expected.
        turn: (n,) the turn to which each sample belongs.
        instruments: (n, k) orthogonal to the residual; None for the slopes, as in least squares.
    """
    pseudo = pseudo_residuals(residual)
    size = np.sqrt(np.mean(slopes**2, axis=0)) + 1e-300
    scaled = slopes / size
    if instruments is not None:
        held = instruments / size
        scaled = held @ (np.linalg.pinv(held.T @ held, rcond=1e-13, hermitian=True) @ (held.T @ scaled))
    root = _inverse_root(scaled.T @ scaled)
    basis = scaled @ root
    adjusted, degrees = _by_turns(basis, pseudo, turn, root)
    across = root @ (adjusted.T @ adjusted) @ root.T
    independent = root @ root.T * float(np.mean(pseudo**2))
    undetermined = np.isnan(degrees)
    covariance = np.where(undetermined | undetermined[:, None], independent, across)
    quantile = np.where(undetermined, scipy.stats.norm.ppf(0.975), scipy.stats.t.ppf(0.975, degrees))
    half = quantile * np.sqrt(np.diag(covariance))
    alone = np.sqrt(np.diag(independent))
    few = degrees < _FEW  # nan is not
    short = np.where(few, np.maximum(1.0, alone / np.maximum(np.sqrt(np.diag(covariance)), 1e-300)), 1.0)
    half = np.where(few, np.maximum(half, scipy.stats.norm.ppf(0.975) * alone), half)
    covariance = covariance * np.outer(short, short) / np.outer(size, size)
    return Uncertainty(covariance, half / size, np.diag(independent) / size**2)


def uncertainty_by_turns_and_angle(
    slopes: FloatArray, residual: FloatArray, turn: IntArray, sector: IntArray, instruments: FloatArray
) -> Uncertainty:
    """Uncertainty of estimates whose residuals are correlated within a turn, and at the same angle of all turns.

    An error of the model or of the estimated acceleration that repeats in every turn is common to all turns, so turns
    alone do not show it. Clustering both ways adds the variance by sectors of the turn less that of independent samples
    (Cameron, Gelbach and Miller 2011).

    Args:
        slopes, residual, turn, instruments: see `uncertainty_by_turns`.
        sector: (n,) of the turn in which each sample lies.
    """
    found = uncertainty_by_turns(slopes, residual, turn, instruments)
    beside = uncertainty_by_turns(slopes, residual, sector, instruments)
    repeated = np.maximum(np.diag(beside.covariance) - beside.independent, 0.0)
    return found.wider([*np.diag(np.sqrt(repeated))])


def pseudo_residuals(residual: FloatArray) -> FloatArray:
    """Residuals (n,) whose least squares has the scatter of a fit with Huber's loss (Huber 1981, 7.6; Bickel 1976).

    Residuals beyond the bound are clipped to it, and all are divided by the share of samples within it, since a
    clipped sample no longer restrains the estimate.
    """
    bound = HUBER * robust_scale(residual)
    within = float(np.mean(np.abs(residual) <= bound))
    return np.asarray(np.clip(residual, -bound, bound) / max(within, 0.5))


def _inverse_root(normal: FloatArray) -> FloatArray:
    """Root R with R R' the pseudo-inverse of a normal matrix (k, k)."""
    size, axes = np.linalg.eigh(normal)
    determined = size > 1e-13 * size[-1]
    return np.asarray(axes * np.where(determined, 1.0 / np.sqrt(np.where(determined, size, 1.0)), 0.0))


def _by_turns(
    basis: FloatArray, residual: FloatArray, turn: IntArray, root: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Scores of the turns (m, k), adjusted for the effect of each turn on the fit, and degrees of freedom (k,).

    The latter are nan if most of a parameter's variance comes from turns that alone determine it.
    In an orthonormal basis of the slopes the hat matrix of a turn and its inverse root are k by k.
    """
    place = np.unique(turn, return_inverse=True)[1]
    scores, hat = turn_scores(basis, residual, place), turn_normals(basis, place)
    share, axes = np.linalg.eigh(hat)
    lost = np.where(1.0 - share > _ALONE, 1.0 / np.sqrt(np.maximum(1.0 - share, _ALONE)), 0.0)
    adjust = np.einsum("tik,tk,tjk->tij", axes, lost, axes)
    # For independent residuals: variances of a parameter's adjusted scores, less their covariance due to the fit.
    weighed = np.einsum("tij,cj->tci", adjust, root)
    shared = np.einsum("tij,tcj->cti", hat, weighed)
    own, common = np.einsum("tci,cti->ct", weighed, shared), np.sum(shared**2, axis=2)
    trace = np.sum(own - common, axis=1)
    squares = np.sum(own**2 - 2.0 * own * common, axis=1) + np.sum(
        np.einsum("cti,ctj->cij", shared, shared) ** 2, axis=(1, 2)
    )
    degrees = np.maximum(trace**2 / np.maximum(squares, 1e-300), 1.0)
    degrees[trace < _DETERMINED * np.sum(root**2, axis=1)] = np.nan
    return np.einsum("tij,tj->ti", adjust, scores), degrees


def bootstrap_moves(slopes: FloatArray, residual: FloatArray, turn: IntArray) -> FloatArray:
    """Moves (draws, k) of the estimates when the turns of the record are resampled with replacement.

    One Gauss-Newton step from the estimate for each draw, with pseudo-residuals of Huber's loss (the one-step bootstrap
    of Shao and Tu 1995, section 3.5, with turns as blocks; Kuensch 1989 for blocks). Residuals of a turn stay
    together, since they may be correlated.

    Args:
        slopes: (n, k) of the expected torque. residual: (n,) measured less expected.
        turn: (n,) the turn to which each sample belongs.
    """
    pseudo = pseudo_residuals(residual)
    sizes = np.sqrt(np.mean(slopes**2, axis=0)) + 1e-300
    scaled = slopes / sizes
    turns, place = np.unique(turn, return_inverse=True)
    normals, scores = turn_normals(scaled, place), turn_scores(scaled, pseudo, place)
    rng = np.random.default_rng(_SEED)
    drawn = rng.multinomial(turns.size, np.full(turns.size, 1.0 / turns.size), size=_DRAWS).astype(np.float64)
    total = np.einsum("dt,tij->dij", drawn, normals)
    total += 1e-12 * np.trace(total, axis1=1, axis2=2)[:, None, None] * np.eye(slopes.shape[1])
    moves = np.linalg.solve(total, (drawn @ scores)[..., None])[..., 0] / sizes
    # With few blocks a bootstrap is too narrow, by the share of each block in the mean.
    return np.asarray(moves * math.sqrt(turns.size / max(turns.size - 1.0, 1.0)))


def with_sigma(value: float, sigma: float, sign: str = "z") -> str:
    """Text of a value and its standard deviation to three decimals, or as many as the deviation needs for one digit."""
    places = 3 if not 0.0 < sigma < 5e-4 else min(-math.floor(math.log10(sigma)), 12)
    return f"{value:{sign}.{places}f} +- {sigma:.{places}f}"
