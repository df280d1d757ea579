"""Measures: displacements read off a machine, such as a needle's depth or a sley's arc."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, const, real, substitute, topological_order
from textile_twin_core.mechanism.angles import link_angle
from textile_twin_core.mechanism.extremes import smallest_value, values_over
from textile_twin_core.mechanism.group import check_length
from textile_twin_core.mechanism.linkage import THETA
from textile_twin_core.mechanism.motion import Motion

_TURNING, _NEWTON_STEPS = 1e-3, 4


@dataclass(frozen=True)
class Displacement:
    """A displacement [m] and its derivatives with respect to theta [m, m]."""

    position: Expr
    first: Expr
    second: Expr


@runtime_checkable
class Measure(Protocol):
    """A named displacement of a machine, with the outputs NAME_position_m, _velocity_m_s and _acceleration_m_s2."""

    @property
    def name(self) -> str:
        """Name of the measured part, such as needle, beater or sley."""
        ...

    def displacement(self, motion: Motion) -> Displacement:
        """Express the displacement over the motion."""
        ...

    def tool(self, motion: Motion) -> str:
        """Return the point whose displacement is measured, such as a needle's tip."""
        ...


@dataclass(frozen=True)
class Travel:
    """Distance of a point from a fixed point, along a fixed direction.

    Raises:
        MachineError: for a direction that is zero or not finite, or an origin that moves.
    """

    name: str
    point: str
    origin: str
    direction: tuple[float, float]

    def __post_init__(self) -> None:
        if not (all(math.isfinite(v) for v in self.direction) and any(self.direction)):
            raise MachineError(f"measure '{self.name}': direction must be a finite vector that is not zero")

    def displacement(self, motion: Motion) -> Displacement:
        """Express the point's distance along the direction."""
        norm = real.hypot(*self.direction)
        x, y = self.direction[0] / norm, self.direction[1] / norm
        p, o = motion.point(self.point, self.name), motion.point(self.origin, self.name)
        if not o.is_fixed:
            raise MachineError(f"measure '{self.name}': origin '{self.origin}' must be fixed to the ground")

        def along(vx: Expr, vy: Expr) -> Expr:
            return x * vx + y * vy

        offset = p.position - o.position
        return Displacement(along(offset.x, offset.y), along(p.first.x, p.first.y), along(p.second.x, p.second.y))

    def tool(self, motion: Motion) -> str:
        """Return the point itself."""
        return self.point


@dataclass(frozen=True)
class Arc:
    """Arc travelled by a point of a rocking link, from the rear end of its swing.

    `radius_m` is the point's distance from the link's pivot. With `sense` +1 the arc counts counter-clockwise from the
    clockwise end of the swing, with -1 clockwise from the other end.

    Raises:
        MachineError: for a radius that is not positive, another sense, or a link that rotates fully.
    """

    name: str
    link: str
    radius_m: float
    sense: int = 1

    def __post_init__(self) -> None:
        check_length(self.radius_m, f"measure '{self.name}': radius_m")
        if self.sense not in (1, -1):
            raise MachineError(f"measure '{self.name}': sense must be 1 or -1, not {self.sense!r}")

    def displacement(self, motion: Motion) -> Displacement:
        """Express the arc length from the rear point."""
        link = motion.link(self.link, self.name)
        angle = link_angle(link, motion)
        begin, end = values_over(angle, np.array(motion.range_rad))
        if motion.turns_fully and abs(end - begin) > math.pi:
            raise MachineError(
                f"measure '{self.name}': link '{self.link}' turns round; an arc is measured on a link that swings"
            )
        scale = float(self.sense) * self.radius_m
        swing = Displacement(scale * angle, scale * link.first, scale * link.second)
        return Displacement(swing.position - _minimum(swing, motion.range_rad), swing.first, swing.second)

    def tool(self, motion: Motion) -> str:
        """Return the link's end."""
        return motion.link(self.link, self.name).end


def _minimum(swing: Displacement, range_rad: tuple[float, float]) -> Expr:
    """Express the minimum of a displacement as a function of its parameters.

    Newton's method follows the minimum from its angle at the present parameters.
    """
    place, minimum = smallest_value(swing.position, range_rad)
    if all(node.op != "parameter" for node in topological_order([swing.position])):
        return const(minimum)
    theta: Expr = const(place)
    if abs(values_over(swing.first, np.array([place]))[0]) < _TURNING * abs(
        values_over(swing.second, np.array([place]))[0]
    ):
        for _ in range(_NEWTON_STEPS):
            slope, bend = substitute([swing.first, swing.second], {THETA: theta})
            theta = theta - slope / bend
    return substitute([swing.position], {THETA: theta})[0]
