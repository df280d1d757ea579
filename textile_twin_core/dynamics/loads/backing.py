"""Backing: friction of a needle, one force while it is through the backing and one while it is free."""

from __future__ import annotations

import math
from dataclasses import dataclass

from textile_twin_core.dynamics.loads.load import Crossing, LoadContext
from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, at_least, const, select, sign
from textile_twin_core.mechanism import Displacement, Travel
from textile_twin_core.mechanism.extremes import smallest_value
from textile_twin_core.mechanism.vector import Vector
from textile_twin_core.mechanism.wrenches import Wrenches


@dataclass(frozen=True)
class Backing:
    """Friction that opposes the travel `on`: `force_N` while the needle is in the backing, else `free_force_N`.

    The needle is in the backing while its travel is at or beyond the plane: `entry_plane_m` while it
    goes in, `exit_plane_m` while it comes out. At rest there is no friction. Where it stands tells, not how it came
    there: a needle that is in the backing when the record begins is held by it on its way out. Between two planes the
    way tells, as of a shaft that turns through; a needle that never comes as far as the entry is not held at all.
    Xu et al. 2016 give 1000 N "on" and "under" the backing and the angles of entry and exit.
    """

    on: str
    force_N: float
    entry_plane_m: float
    exit_plane_m: float
    free_force_N: float = 0.0

    def __post_init__(self) -> None:
        for what in ("force_N", "entry_plane_m", "exit_plane_m", "free_force_N"):
            if not math.isfinite(getattr(self, what)):
                raise MachineError(f"backing on '{self.on}': {what} must be a finite number")
        for what in ("force_N", "free_force_N"):
            if getattr(self, what) < 0.0:
                raise MachineError(
                    f"backing on '{self.on}': {what} must be zero or positive, not {getattr(self, what):g}: friction "
                    "always opposes the travel"
                )

    def inside(self, context: LoadContext) -> Expr:
        """1 while the needle is in the backing."""
        travel = self._displacement(context)
        if self.entry_plane_m == self.exit_plane_m:
            return at_least(travel.position, self.entry_plane_m)
        if not self._enters(context):
            return const(0.0)
        going_in = at_least(travel.first * context.shaft.omega, 0.0)
        plane = select(going_in, self.entry_plane_m, self.exit_plane_m)
        return at_least(travel.position, plane)

    def intensity(self, context: LoadContext) -> Expr:
        """Friction against the velocity of the travel, in the backing and outside."""
        against = -sign(self._displacement(context).first * context.shaft.omega)
        inside = self.inside(context)
        return self.force_N * (against * inside) + self.free_force_N * (against * (1.0 - inside))

    def unit_force(self, context: LoadContext) -> Expr:
        """A force along the travel works on the shaft through the travel's derivative."""
        return self._displacement(context).first

    def apply(self, context: LoadContext, wrenches: Wrenches, intensity: Expr) -> None:
        """The friction force at the travel's point."""
        measure = self._travel(context)
        norm = math.hypot(*measure.direction)
        direction = Vector.of(measure.direction[0] / norm, measure.direction[1] / norm)
        wrenches.pull_on_point(measure.point, intensity * direction)

    def crossings(self, context: LoadContext) -> tuple[Crossing, ...]:
        """The needle enters and leaves the backing."""
        if not self._enters(context):
            return ()
        travel = self._displacement(context).position
        return (
            Crossing(f"{self.on}_enters_backing", travel - self.entry_plane_m, rising=True),
            Crossing(f"{self.on}_leaves_backing", travel - self.exit_plane_m, rising=False),
        )

    def _enters(self, context: LoadContext) -> bool:
        """Whether the travel comes as far as the entry, asked where the exit lies before it and can be passed alone."""
        if self.exit_plane_m >= self.entry_plane_m:
            return True
        _, below = smallest_value(-self._displacement(context).position, context.motion.range_rad)
        return -below >= self.entry_plane_m

    def _displacement(self, context: LoadContext) -> Displacement:
        return context.displacements[self._travel(context).name]

    def _travel(self, context: LoadContext) -> Travel:
        measure = context.measures.get(self.on)
        if not isinstance(measure, Travel):
            there = ", ".join(m.name for m in context.measures.values() if isinstance(m, Travel)) or "none"
            raise MachineError(f"backing on '{self.on}': there is no straight travel of this name; there are: {there}")
        return measure
