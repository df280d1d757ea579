"""Bootstrap of estimates over whole turns of the shaft."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison.by_turn import turn_normals, turn_scores
from textile_twin_core.comparison.uncertainty import pseudo_residuals

_DRAWS = 400
_SEED = 20160614


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
