"""Torque and force as tables over the shaft angle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from textile_twin_core.dynamics.loads.load import LoadContext, Uneventful
from textile_twin_core.dynamics.loads.periodic_table import PeriodicTable
from textile_twin_core.dynamics.loads.relative import link_of_load, turn_links
from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, const, cos, sin
from textile_twin_core.mechanism import MAIN_SHAFT, Rotation
from textile_twin_core.mechanism.vector import Vector
from textile_twin_core.mechanism.wrenches import Wrenches


@dataclass(frozen=True)
class TorqueTable(Uneventful):
    """A torque on `on`, counter-clockwise positive, as a table over the shaft angle (see PeriodicTable).

    A torque on the main shaft acts once, at the shaft's angle; one on a link acts in every linkage at its own crank
    angle.
    """

    angle_rad: tuple[float, ...]
    torque_Nm: tuple[float, ...]
    on: str = MAIN_SHAFT
    scale: float = 1.0
    harmonics: int | None = None

    def __post_init__(self) -> None:
        _ = self.table

    @cached_property
    def table(self) -> PeriodicTable:
        """The table as a series."""
        return PeriodicTable(f"torque table on '{self.on}'", self.angle_rad, self.torque_Nm, self.harmonics)

    def intensity(self, context: LoadContext) -> Expr:
        """Express the factor on the table."""
        return const(self.scale)

    def unit_force(self, context: LoadContext) -> Expr:
        """Express the table's torque times the derivative of the angle on which it acts."""
        if self.on == MAIN_SHAFT:
            return self._torque(context)
        return self._torque(context) * link_of_load(context.motion, self.on).first

    def apply(self, context: LoadContext, wrenches: Wrenches, intensity: Expr) -> None:
        """Apply a moment to the shaft or link."""
        torque = intensity * self._torque(context)
        if self.on == MAIN_SHAFT:
            wrenches.add_torque(MAIN_SHAFT, torque)
        else:
            turn_links(wrenches, self.on, None, torque)

    def _torque(self, context: LoadContext) -> Expr:
        if self.on != MAIN_SHAFT:
            return self.table.at(context.motion.rotations[MAIN_SHAFT].direction)
        if not context.carries_shaft_loads:
            return const(0.0)
        theta = context.shaft.theta
        half = Vector(cos(0.5 * theta), sin(0.5 * theta))
        return self.table.at(Rotation(half, theta, const(1.0), const(0.0)).direction)


@dataclass(frozen=True)
class ForceTable(Uneventful):
    """A force on `point` along the fixed `direction`, as a table over the crank's angle (see PeriodicTable)."""

    point: str
    direction: tuple[float, float]
    angle_rad: tuple[float, ...]
    force_N: tuple[float, ...]
    scale: float = 1.0
    harmonics: int | None = None

    def __post_init__(self) -> None:
        if not (all(math.isfinite(v) for v in self.direction) and any(self.direction)):
            raise MachineError(f"force table on '{self.point}': direction must be a finite vector that is not zero")
        _ = self.table

    @cached_property
    def table(self) -> PeriodicTable:
        """The table as a series."""
        return PeriodicTable(f"force table on '{self.point}'", self.angle_rad, self.force_N, self.harmonics)

    def intensity(self, context: LoadContext) -> Expr:
        """Express the factor on the table."""
        return const(self.scale)

    def unit_force(self, context: LoadContext) -> Expr:
        """Express the work of the force per angle."""
        return self._force(context).dot(context.motion.point(self.point, "force_table").first)

    def apply(self, context: LoadContext, wrenches: Wrenches, intensity: Expr) -> None:
        """Apply the force to the point."""
        wrenches.pull_on_point(self.point, intensity * self._force(context))

    def _force(self, context: LoadContext) -> Vector:
        norm = math.hypot(*self.direction)
        unit = Vector.of(self.direction[0] / norm, self.direction[1] / norm)
        return self.table.at(context.motion.rotations[MAIN_SHAFT].direction) * unit
