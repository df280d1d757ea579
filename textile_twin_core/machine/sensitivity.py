"""Exact partial derivatives of the torque by the shaft's state, for the standard deviation of a prediction."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics import INPUTS
from textile_twin_core.expression import Expr, derivative, variable
from textile_twin_core.expression.loop import Loop
from textile_twin_core.expression.scalar import compile_scalar

_FEW = 16


class TorqueSensitivity:
    """Gradient of the balancing torque by (theta, omega, alpha)."""

    def __init__(self, torque: Expr) -> None:
        slopes = [derivative([torque], variable(name))[0] for name in INPUTS]
        self._scalar = compile_scalar(slopes, INPUTS)
        self._program = Loop(slopes, INPUTS)

    def gradient(self, theta: FloatArray, omega: FloatArray, alpha: FloatArray) -> FloatArray:
        """Compute the (n, 3) gradient [N m/rad, N m s/rad, N m s^2/rad] at (n,) states; NaN where undetermined."""
        if theta.size <= _FEW:
            states = zip(theta.tolist(), omega.tolist(), alpha.tolist(), strict=True)
            return np.array([self._single(state) for state in states]).reshape(-1, 3)
        out = np.empty((3, theta.size))
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            self._program([theta, omega, alpha], list(out))
        return np.ascontiguousarray(out.T)

    def _single(self, state: tuple[float, ...]) -> tuple[float, ...]:
        try:
            return self._scalar(*state)
        except (ValueError, ZeroDivisionError):
            return (math.nan,) * len(INPUTS)
