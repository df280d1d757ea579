"""Viscous and dry (Coulomb) friction on the main shaft and on the parts that turn with it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from textile_twin_core.dynamics.loads.load import LoadContext, Uneventful
from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, const, sign
from textile_twin_core.mechanism import MAIN_SHAFT
from textile_twin_core.mechanism.wrenches import Wrenches


@dataclass(frozen=True)
class ShaftFriction(Uneventful):
    """A torque against the shaft's rotation: `viscous_Nms` times its speed, plus `coulomb_Nm` while it turns.

    It acts once, whatever the number of linkages on the shaft.
    """

    viscous_Nms: float = 0.0
    coulomb_Nm: float = 0.0

    def __post_init__(self) -> None:
        for what in ("viscous_Nms", "coulomb_Nm"):
            value = getattr(self, what)
            if not (math.isfinite(value) and value >= 0.0):
                raise MachineError(f"friction of the shaft: {what} must be zero or positive, not {value!r}")

    def intensity(self, context: LoadContext) -> Expr:
        """Express the torque, opposed to the shaft's speed and direction."""
        omega = context.shaft.omega
        return self.viscous_Nms * -omega + self.coulomb_Nm * -sign(omega)

    def unit_force(self, context: LoadContext) -> Expr:
        """Express 1: the load acts on the shaft itself."""
        return const(1.0 if context.carries_shaft_loads else 0.0)

    def apply(self, context: LoadContext, wrenches: Wrenches, intensity: Expr) -> None:
        """Apply a torque to the shaft."""
        wrenches.add_torque(MAIN_SHAFT, intensity * self.unit_force(context))
