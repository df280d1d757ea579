"""Viscous damping of the rotation between two links, and of a point's motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

from textile_twin_core.dynamics.loads.load import LoadContext, Uneventful
from textile_twin_core.dynamics.loads.relative import check_other, relative_rate, turn_links
from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr
from textile_twin_core.mechanism.wrenches import Wrenches


@dataclass(frozen=True)
class JointDamping(Uneventful):
    """A torque against the relative rotation of two links, or of a link and the ground, proportional to its speed."""

    link: str
    viscous_Nms: float
    against: str | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.viscous_Nms) and self.viscous_Nms >= 0.0):
            raise MachineError(
                f"damping of '{self.link}': viscous_Nms must be zero or positive, not {self.viscous_Nms!r}"
            )
        check_other(f"damping of '{self.link}'", self.link, self.against)

    def intensity(self, context: LoadContext) -> Expr:
        """Express the coefficient times the negative shaft speed."""
        return self.viscous_Nms * -context.shaft.omega

    def unit_force(self, context: LoadContext) -> Expr:
        """Express the squared derivative of the relative angle."""
        rate = relative_rate(context.motion, self.link, self.against)
        return rate * rate

    def apply(self, context: LoadContext, wrenches: Wrenches, intensity: Expr) -> None:
        """Apply opposite moments to the two links."""
        rate = relative_rate(context.motion, self.link, self.against)
        turn_links(wrenches, self.link, self.against, intensity * rate)


@dataclass(frozen=True)
class PointDamping(Uneventful):
    """A force on a point, proportional and opposed to its velocity: a slider in oil, or a dashpot to the ground."""

    point: str
    viscous_Ns_m: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.viscous_Ns_m) and self.viscous_Ns_m >= 0.0):
            raise MachineError(
                f"damping of point '{self.point}': viscous_Ns_m must be zero or positive, not {self.viscous_Ns_m!r}"
            )

    def intensity(self, context: LoadContext) -> Expr:
        """Express the coefficient times the negative shaft speed."""
        return self.viscous_Ns_m * -context.shaft.omega

    def unit_force(self, context: LoadContext) -> Expr:
        """Express the squared derivative of the point's position."""
        return context.motion.point(self.point, "point_damping").speed_squared

    def apply(self, context: LoadContext, wrenches: Wrenches, intensity: Expr) -> None:
        """Apply a force to the point against its velocity."""
        first = context.motion.point(self.point, "point_damping").first
        wrenches.pull_on_point(self.point, intensity * first)
