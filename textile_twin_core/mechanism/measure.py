"""Measures: the displacements that people read off a machine, such as a needle's depth or a sley's arc."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, const
from textile_twin_core.expression.blocks import BlockProgram
from textile_twin_core.mechanism.angles import link_angle
from textile_twin_core.mechanism.motion import Motion


@dataclass(frozen=True)
class Displacement:
    """A displacement [m] and its derivatives with respect to theta [m, m]."""

    position: Expr
    first: Expr
    second: Expr


@runtime_checkable
class Measure(Protocol):
    """A named displacement of a machine; it gives NAME_position_m, _velocity_m_s, _acceleration_m_s2."""

    @property
    def name(self) -> str:
        """What is measured: needle, beater, sley."""
        ...

    def displacement(self, motion: Motion) -> Displacement:
        """The displacement over the motion."""
        ...


@dataclass(frozen=True)
class Travel:
    """The distance of a point from a fixed point, along a fixed direction."""

    name: str
    point: str
    origin: str
    direction: tuple[float, float]

    def displacement(self, motion: Motion) -> Displacement:
        """The point's distance along the direction."""
        norm = math.hypot(*self.direction)
        if norm == 0.0:
            raise MachineError(f"measure '{self.name}': direction must not be the zero vector")
        x, y = self.direction[0] / norm, self.direction[1] / norm
        p, o = motion.point(self.point, self.name), motion.point(self.origin, self.name)

        def along(vx: Expr, vy: Expr) -> Expr:
            return x * vx + y * vy

        offset = p.position - o.position
        return Displacement(along(offset.x, offset.y), along(p.first.x, p.first.y), along(p.second.x, p.second.y))


@dataclass(frozen=True)
class Arc:
    """The arc of a point on a rocking link, from the end of its swing where `sense` says the rear is.

    `radius_m` is the point's distance from the link's pivot; `sense` +1 counts the arc
    counter-clockwise from the clockwise end of the swing, -1 the other way.
    """

    name: str
    link: str
    radius_m: float
    sense: int = 1

    def displacement(self, motion: Motion) -> Displacement:
        """Arc length from the rear point."""
        link = motion.link(self.link, self.name)
        angle = link_angle(link, motion.rotations["main_shaft"].direction)
        scale = float(self.sense) * self.radius_m
        swing = scale * angle
        return Displacement(swing - const(_smallest(swing)), scale * link.first, scale * link.second)


def _smallest(swing: Expr) -> float:
    """The smallest value over a turn, to rounding: the grid closes in on it."""
    theta = np.linspace(0.0, 2.0 * np.pi, 4097)[:-1]
    values = np.empty_like(theta)
    program = BlockProgram([swing], ["theta"])
    program([theta], [values])
    centre = theta[int(np.argmin(values))]
    width = theta[1]
    for _ in range(4):
        grid = np.linspace(centre - width, centre + width, 257)
        values = np.empty_like(grid)
        program([grid], [values])
        centre, width = grid[int(np.argmin(values))], width / 64.0
    return float(values.min())
