"""Uncertainties that hold under model error: a bootstrap over whole turns of the shaft."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison.settings_fit import SettingsFit, huber_weights

DRAWS = 1000
_SEED = 20160614


@dataclass(frozen=True)
class Estimate:
    """A value, its standard deviation, and the interval that holds it in 95 of 100 recordings; nan where not known."""

    value: float
    sigma: float = math.nan
    interval95: tuple[float, float] = (math.nan, math.nan)

    def scaled(self, factor: float, shift: float = 0.0) -> Estimate:
        """factor * value + shift, with its uncertainty."""
        ends = sorted(factor * end + shift for end in self.interval95)
        return Estimate(factor * self.value + shift, abs(factor) * self.sigma, (ends[0], ends[1]))


def bootstrap_moves(
    jacobian: FloatArray,
    residual: FloatArray,
    turn: IntArray,
    draws: int = DRAWS,
    instruments: FloatArray | None = None,
) -> FloatArray:
    """By how much each estimate moves when the turns of the record are drawn again with replacement: (draws, k).

    One Gauss-Newton step from the estimate for each draw, with Huber weights (the one-step bootstrap of Shao and Tu
    1995, section 3.5, with blocks as the turns; Kuensch 1989 for blocks). Residuals of a turn stay together, whatever
    the model leaves in them.

    Args:
        jacobian: (n, k) slopes of the expected torque. residual: (n,) measured less expected.
        turn: (n,) the turn to which each sample belongs.
        draws: number of draws.
        instruments: (n, k) what the residual was made orthogonal to; None: the slopes, as by least squares.
    """
    scale = 1.4826 * float(np.median(np.abs(residual))) + 1e-300
    weight = huber_weights(residual, scale)
    sizes = np.sqrt(np.mean(jacobian**2, axis=0)) + 1e-300
    scaled = jacobian / sizes
    weighted = (scaled if instruments is None else instruments / sizes) * weight[:, None]
    turns, place = np.unique(turn, return_inverse=True)
    k = jacobian.shape[1]
    normals = np.empty((turns.size, k, k))
    for row in range(k):
        for column in range(k):
            normals[:, row, column] = np.bincount(place, weights=weighted[:, row] * scaled[:, column])
    scores = np.stack([np.bincount(place, weights=residual * weighted[:, c]) for c in range(k)], axis=1)
    rng = np.random.default_rng(_SEED)
    drawn = rng.multinomial(turns.size, np.full(turns.size, 1.0 / turns.size), size=draws).astype(np.float64)
    total = np.einsum("dt,tij->dij", drawn, normals)
    total += 1e-12 * np.trace(total, axis1=1, axis2=2)[:, None, None] * np.eye(k)
    moves = np.linalg.solve(total, (drawn @ scores)[..., None])[..., 0] / sizes
    # A bootstrap of few blocks is too narrow by the share of the mean that each block takes.
    return np.asarray(moves * math.sqrt(turns.size / max(turns.size - 1.0, 1.0)))


def moves_of(
    jacobian: FloatArray, residual: FloatArray, turn: IntArray, instruments: FloatArray | None = None
) -> FloatArray:
    """The moves of `bootstrap_moves`, widened where samples on their own would scatter more.

    Turns of a run-up weigh much and are few; a bootstrap over them alone is then too narrow.
    """
    moves = bootstrap_moves(jacobian, residual, turn, instruments=instruments)
    sizes = np.sqrt(np.mean(jacobian**2, axis=0)) + 1e-300
    scaled = jacobian / sizes
    held = scaled if instruments is None else instruments / sizes
    inverse = np.linalg.pinv(held.T @ scaled, rcond=1e-13)
    variance = np.einsum("ij,jk,ik->i", inverse, held.T @ held, inverse)
    alone = np.sqrt(variance * float(np.mean(residual**2))) / sizes
    return np.asarray(moves * np.maximum(1.0, alone / (np.std(moves, axis=0) + 1e-300)))


def estimates(fit: SettingsFit) -> dict[str, Estimate]:
    """Every freed setting with its uncertainty by `moves_of`."""
    good = fit.good
    if not fit.free:
        return {}
    moves = moves_of(fit.jacobian[good], fit.residual[good], fit.turn[good])
    return {name: estimate(getattr(fit.settings, name), moves[:, k]) for k, name in enumerate(fit.free)}


def estimate(value: float, moves: FloatArray) -> Estimate:
    """A value with the moves of its bootstrap: their scatter, and the basic bootstrap's interval."""
    low, high = np.percentile(moves, [2.5, 97.5])
    return Estimate(float(value), float(np.std(moves)), (float(value - high), float(value - low)))
