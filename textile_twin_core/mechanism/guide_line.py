"""A straight guide and its motion, on the ground or on a link of an earlier group."""

from __future__ import annotations

import math
from dataclasses import dataclass

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, const, real
from textile_twin_core.mechanism.group import Closure, check_finite
from textile_twin_core.mechanism.joint import Joint, guide
from textile_twin_core.mechanism.motion import Motion, PointMotion
from textile_twin_core.mechanism.vector import Vector
from textile_twin_core.mechanism.wrenches import Wrenches


@dataclass(frozen=True)
class Seen:
    """A point in the frame of its guide: position along it and to its left [m], with two derivatives by theta."""

    along: tuple[Expr, Expr, Expr]
    across: tuple[Expr, Expr, Expr]


@dataclass(frozen=True)
class GuideLine:
    """The line through `origin` along the unit vector `direction`, which turns at the rates `first` and `second`.

    `place_m` and `axis` are point and unit vector in the frame of the guide's link `on`, or of the ground if `on` is
    None.
    """

    origin: PointMotion
    direction: Vector
    first: Expr
    second: Expr
    place_m: tuple[float, float]
    axis: tuple[float, float]
    on: str | None

    @classmethod
    def of(
        cls, motion: Motion, on: str | None, point_m: tuple[float, float], along: tuple[float, float], asked_by: str
    ) -> GuideLine:
        """Place a guide through a point along a vector.

        Both are in the frame of the link `on`: origin at its start point, x along the link.

        Raises:
            MachineError: for an unknown link.
        """
        axis = unit(along)
        if on is None:
            return cls(PointMotion.fixed(*point_m), Vector.of(*axis), const(0.0), const(0.0), point_m, axis, None)
        link = motion.link(on, asked_by)
        direction, p, q, start = link.direction, link.first, link.second, motion.points[link.start]
        lever = point_m[0] * direction + point_m[1] * direction.turned_left()
        normal = lever.turned_left()
        first, second = start.first + p * normal, start.second + q * normal - (p * p) * lever
        origin = PointMotion(start.position + lever, first, second, first.dot(first), first.dot(second))
        return cls(origin, direction.rotated(*axis), p, q, point_m, axis, on)

    def seen(self, point: PointMotion) -> Seen:
        """Express a point in the frame of the guide."""
        e, n, p, q = self.direction, self.direction.turned_left(), self.first, self.second
        d = point.position - self.origin.position
        x, y = d.dot(e), d.dot(n)
        v, w = point.first - self.origin.first, point.second - self.origin.second
        x1, y1 = v.dot(e) + p * y, v.dot(n) - p * x
        x2 = w.dot(e) + 2.0 * (p * y1) + q * y + (p * p) * x
        y2 = w.dot(n) - 2.0 * (p * x1) - q * x + (p * p) * y
        return Seen((x, x1, x2), (y, y1, y2))

    def point(self, slide: Expr, first: Expr, second: Expr) -> PointMotion:
        """Express the point at a position along the guide [m], given the position's derivatives."""
        e, p, q = self.direction, self.first, self.second
        if self.on is None:
            return PointMotion.sliding(self.origin.position + slide * e, e, first, second)
        n = e.turned_left()
        along = self.origin.first + first * e + (slide * p) * n
        bend = self.origin.second + (second - slide * (p * p)) * e + (2.0 * (first * p) + slide * q) * n
        return PointMotion(self.origin.position + slide * e, along, bend, along.dot(along), along.dot(bend))

    def joint(self, slider: str) -> Joint:
        """Return the sliding joint of a slider in the guide."""
        return guide(slider, self.place_m, self.axis, self.on)

    def bear(self, wrenches: Wrenches, slider: str, at: Vector, across: Expr, moment: Expr) -> None:
        """Apply the guide's reaction on a slider: a force to the left of its direction [N] and a moment [N m].

        The opposites act on the guide's link.
        """
        wrenches.guide_reactions[slider] = across
        wrenches.transmitted[slider] = moment
        if self.on is not None:
            link = wrenches.motion.links[self.on]
            force = (-across) * self.direction.turned_left()
            lever = at - wrenches.motion.points[link.start].position
            wrenches.add(self.on, force, lever.cross(force) - moment)


def unit(vector: tuple[float, float]) -> tuple[float, float]:
    """Normalise a vector to length 1."""
    norm = real.hypot(*vector)
    return vector[0] / norm, vector[1] / norm


def check_guide(what: str, point_m: tuple[float, float], direction: tuple[float, float]) -> None:
    """Raise MachineError unless point and direction of a guide are finite and the direction is not zero."""
    for value in (*point_m, *direction):
        check_finite(value, f"{what}: guide")
    if real.hypot(*direction) == 0.0:
        raise MachineError(f"{what}: guide_direction must not be the zero vector")


def check_slot(what: str, slot_m: tuple[float, float] | None) -> None:
    """Raise MachineError unless the ends of a slot are finite and increasing."""
    if slot_m is not None and not -math.inf < slot_m[0] < slot_m[1] < math.inf:
        raise MachineError(f"{what}: slot_m must be two rising, finite distances in metres, not {list(slot_m)!r}")


def slot_ends(slider: str, slide: Expr, slot_m: tuple[float, float] | None) -> tuple[Closure, ...]:
    """Return the closures that are positive while a slider stays within the ends of its slot."""
    if slot_m is None:
        return ()
    low, high = slot_m
    words = "leaves its slot", "it begins", "lengthen slot_m, or change what drives the slider"
    return tuple(
        Closure(f"'{slider}' passes the end of its slot at {end:g} m", value, high - low, *words, limit=True)
        for end, value in ((low, slide - low), (high, high - slide))
    )
