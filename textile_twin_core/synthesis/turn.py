"""One turn of the shaft at constant speed: expressions over its angle, and the rotation of a time ratio."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.errors import SceneError
from textile_twin_core.expression import Expr, interpret
from textile_twin_core.expression.loop import Numpy

SAMPLES = 720
_ROUNDING = 1e-9


def shaft_angles(samples: int = SAMPLES) -> FloatArray:
    """Return (n,) equally spaced angles of one turn from 0 [rad]."""
    return np.arange(samples, dtype=np.float64) * (2.0 * math.pi / samples)


def over_turn(expressions: Sequence[Expr], theta: FloatArray, speed_rad_s: float = 0.0) -> list[FloatArray]:
    """Evaluate expressions of the shaft's state (n,) at angles (n,) [rad]; NaN where a machine cannot close."""
    inputs = {"theta": theta, "omega": speed_rad_s, "alpha": 0.0}
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        found = interpret(expressions, inputs, Numpy)
    return [np.array(np.broadcast_to(np.asarray(value, dtype=np.float64), theta.shape)) for value in found]


def without_effect(columns: FloatArray, single: FloatArray) -> BoolArray:
    """Return (k,) whether effects of single linkages, columns (n, k) of `single`, cancel to rounding in `columns`."""
    return np.asarray(np.linalg.norm(columns, axis=0) <= _ROUNDING * np.linalg.norm(single, axis=0))


def rotation_of_time_ratio(ratio: float) -> float:
    """Compute the crank rotation [rad] of a forward stroke that takes `ratio` times as long as the return.

    Raises SceneError for a ratio that is not positive.
    """
    if not (math.isfinite(ratio) and ratio > 0.0):
        raise SceneError(f"time ratio {ratio!r}: give a positive number, 1 for out and back in equal times")
    return 2.0 * math.pi * ratio / (1.0 + ratio)
