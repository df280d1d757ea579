"""Friction on the main shaft: viscous and dry (Coulomb), of its bearings and of what else turns with it."""

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
    """A torque against the shaft's rotation: `viscous_Nms` times its speed, and `coulomb_Nm` while it turns.

    It acts once, however many linkages the shaft carries.
    """

    viscous_Nms: float = 0.0
    coulomb_Nm: float = 0.0

    def __post_init__(self) -> None:
        for what in ("viscous_Nms", "coulomb_Nm"):
            value = getattr(self, what)
            if not (math.isfinite(value) and value >= 0.0):
                raise MachineError(f"friction of the shaft: {what} must be zero or positive, not {value!r}")

    def intensity(self, context: LoadContext) -> Expr:
        """Against the shaft's speed and against its direction."""
        omega = context.shaft.omega
        return self.viscous_Nms * -omega + self.coulomb_Nm * -sign(omega)

    def unit_force(self, context: LoadContext) -> Expr:
        """It acts on the shaft itself."""
        return const(1.0 if context.carries_shaft_loads else 0.0)

    def apply(self, context: LoadContext, wrenches: Wrenches, intensity: Expr) -> None:
        """A torque on the shaft."""
        wrenches.add_torque(MAIN_SHAFT, intensity * self.unit_force(context))
