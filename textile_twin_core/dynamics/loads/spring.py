"""Springs between two points, and between a link and another link or the ground."""

from __future__ import annotations

import math
from dataclasses import dataclass

from textile_twin_core.dynamics.loads.load import LoadContext, Uneventful
from textile_twin_core.dynamics.loads.relative import check_other, relative_motion, turn_links
from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, const, interpret, sqrt
from textile_twin_core.mechanism.angles import link_angle
from textile_twin_core.mechanism.vector import Vector
from textile_twin_core.mechanism.wrenches import Wrenches


def _check(what: str, stiffness: float, *others: float) -> None:
    if not (math.isfinite(stiffness) and stiffness > 0.0):
        raise MachineError(f"{what}: the stiffness must be positive, not {stiffness!r}")
    if not all(math.isfinite(v) for v in others):
        raise MachineError(f"{what}: free length or angle and preload must be finite")


@dataclass(frozen=True)
class Spring(Uneventful):
    """A straight spring between two points with the pull stiffness * (length - free length) + preload.

    The points may be fixed or moving. They must never coincide, since a spring without length has no direction.
    """

    from_point: str
    to_point: str
    stiffness_N_m: float
    free_length_m: float
    preload_N: float = 0.0

    def __post_init__(self) -> None:
        what = f"spring from '{self.from_point}' to '{self.to_point}'"
        _check(what, self.stiffness_N_m, self.free_length_m, self.preload_N)
        if self.from_point == self.to_point:
            raise MachineError(f"{what}: it needs two different points")

    def intensity(self, context: LoadContext) -> Expr:
        """Express the stiffness."""
        return const(self.stiffness_N_m)

    def unit_force(self, context: LoadContext) -> Expr:
        """Express minus the slope of the stored energy."""
        a, b = (context.motion.point(name, "spring") for name in (self.from_point, self.to_point))
        return -(self._pull(context).dot(b.first - a.first))

    def apply(self, context: LoadContext, wrenches: Wrenches, intensity: Expr) -> None:
        """Apply opposite pulls to the two points."""
        pull = intensity * self._pull(context)
        wrenches.pull_on_point(self.from_point, pull)
        wrenches.pull_on_point(self.to_point, -pull)

    def _pull(self, context: LoadContext) -> Vector:
        """Express the pull on the first point towards the second, per unit of stiffness [m]."""
        a, b = (context.motion.point(name, "spring") for name in (self.from_point, self.to_point))
        span = b.position - a.position
        slack = self.free_length_m - self.preload_N / self.stiffness_N_m
        return (1.0 - slack / sqrt(span.dot(span))) * span


@dataclass(frozen=True)
class TorsionSpring(Uneventful):
    """A spring that turns `link` back towards `free_angle_rad`, relative to the link `against` or to +x.

    Its torque is stiffness * (free angle - angle) + preload, counter-clockwise on the link. The angle is unwrapped so
    that the middle of its range lies nearest to the free angle.
    """

    link: str
    stiffness_Nm_rad: float
    free_angle_rad: float
    preload_Nm: float = 0.0
    against: str | None = None

    def __post_init__(self) -> None:
        _check(f"torsion spring on '{self.link}'", self.stiffness_Nm_rad, self.free_angle_rad, self.preload_Nm)
        check_other(f"torsion spring on '{self.link}'", self.link, self.against)

    def intensity(self, context: LoadContext) -> Expr:
        """Express the stiffness."""
        return const(self.stiffness_Nm_rad)

    def unit_force(self, context: LoadContext) -> Expr:
        """Express minus the slope of the stored energy."""
        return self._turn_back(context) * relative_motion(context.motion, self.link, self.against).first

    def apply(self, context: LoadContext, wrenches: Wrenches, intensity: Expr) -> None:
        """Apply opposite moments to the two links."""
        turn_links(wrenches, self.link, self.against, intensity * self._turn_back(context))

    def _turn_back(self, context: LoadContext) -> Expr:
        """Express the torque on the link per unit of stiffness [rad]."""
        motion = context.motion
        angle = link_angle(relative_motion(motion, self.link, self.against), motion, self.free_angle_rad)
        inside = sum(motion.range_rad) / 2.0
        begin, end = (interpret([angle], {"theta": inside + turn}, math)[0] for turn in (0.0, 2.0 * math.pi))
        if abs(end - begin) > math.pi:
            raise MachineError(
                f"torsion spring on '{self.link}': the link turns round with the shaft, so a spring would wind up "
                "for ever; put it on a link that swings"
            )
        return self.free_angle_rad + self.preload_Nm / self.stiffness_Nm_rad - angle
