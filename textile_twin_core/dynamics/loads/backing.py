"""Backing friction on a needle: one force inside the backing, another outside."""

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

    The needle is in the backing while its travel is at or beyond the plane: `entry_plane_m` when it enters,
    `exit_plane_m` when it leaves. Friction at standstill is zero.

    The state depends on the position alone, not on the history: a needle that is in the backing at the start of a
    record meets friction while it leaves. Between two different planes the direction of travel decides, as for a
    shaft that turns continuously. A needle that never reaches the entry plane stays outside the backing.

    References:
        Xu et al. 2016: 1000 N "on" and "under" the backing, and the angles of entry and exit.
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
        """Express 1 while the needle is in the backing, else 0."""
        travel = self._displacement(context)
        if self.entry_plane_m == self.exit_plane_m:
            return at_least(travel.position, self.entry_plane_m)
        if not self.enters(context):
            return const(0.0)
        going_in = at_least(travel.first * context.shaft.omega, 0.0)
        plane = select(going_in, self.entry_plane_m, self.exit_plane_m)
        return at_least(travel.position, plane)

    def intensity(self, context: LoadContext) -> Expr:
        """Express the friction against the velocity of the travel, inside and outside the backing."""
        against = -sign(self._displacement(context).first * context.shaft.omega)
        inside = self.inside(context)
        return self.force_N * (against * inside) + self.free_force_N * (against * (1.0 - inside))

    def unit_force(self, context: LoadContext) -> Expr:
        """Express the travel's derivative, through which a force along the travel acts on the shaft."""
        return self._displacement(context).first

    def apply(self, context: LoadContext, wrenches: Wrenches, intensity: Expr) -> None:
        """Apply the friction force at the travel's point."""
        measure = self._travel(context)
        norm = math.hypot(*measure.direction)
        direction = Vector.of(measure.direction[0] / norm, measure.direction[1] / norm)
        wrenches.pull_on_point(measure.point, intensity * direction)

    def crossings(self, context: LoadContext) -> tuple[Crossing, ...]:
        """Return the events of entering and leaving the backing."""
        if not self.enters(context):
            return ()
        travel = self._displacement(context).position
        return (
            Crossing(f"{self.on}_enters_backing", travel - self.entry_plane_m, rising=True),
            Crossing(f"{self.on}_leaves_backing", travel - self.exit_plane_m, rising=False),
        )

    def enters(self, context: LoadContext) -> bool:
        """Return whether the travel reaches the entry plane; only an exit plane before it can be passed alone."""
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
            raise MachineError(f"backing on '{self.on}': there is no straight travel of this name; available: {there}")
        return measure
