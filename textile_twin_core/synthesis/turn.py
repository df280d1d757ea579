"""One turn of the shaft at constant speed: values of expressions over its angle, without compiling."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.expression import Expr, interpret
from textile_twin_core.expression.loop import Numpy

SAMPLES = 720
_ROUNDING = 1e-9


def shaft_angles(samples: int = SAMPLES) -> FloatArray:
    """(n,) equally spaced angles of one turn from 0 [rad]."""
    return np.arange(samples, dtype=np.float64) * (2.0 * math.pi / samples)


def over_turn(expressions: Sequence[Expr], theta: FloatArray, speed_rad_s: float = 0.0) -> list[FloatArray]:
    """Values (n,) of expressions of the shaft's state at angles (n,) [rad]; NaN where a machine cannot close."""
    inputs = {"theta": theta, "omega": speed_rad_s, "alpha": 0.0}
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        found = interpret(expressions, inputs, Numpy)
    return [np.array(np.broadcast_to(np.asarray(value, dtype=np.float64), theta.shape)) for value in found]


def without_effect(columns: FloatArray, single: FloatArray) -> BoolArray:
    """(k,) of columns (n, k) those that are but rounding: what single linkages do, (n, k), and all of them undo."""
    return np.asarray(np.linalg.norm(columns, axis=0) <= _ROUNDING * np.linalg.norm(single, axis=0))
