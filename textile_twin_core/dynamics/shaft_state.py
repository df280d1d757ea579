"""The state of the main shaft as expressions."""

from __future__ import annotations

from dataclasses import dataclass, field

from textile_twin_core.expression import Expr, square, variable
from textile_twin_core.mechanism import THETA

OMEGA = variable("omega")
ALPHA = variable("alpha")
INPUTS = ("theta", "omega", "alpha")


@dataclass(frozen=True)
class ShaftState:
    """Angle [rad], speed [rad/s] and acceleration [rad/s^2] of the main shaft, and the squared speed."""

    theta: Expr = THETA
    omega: Expr = OMEGA
    alpha: Expr = ALPHA
    omega_squared: Expr = field(default_factory=lambda: square(OMEGA))
