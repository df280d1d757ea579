"""RRP dyad: a connecting rod and a slider on a straight guide (Assur group of class II, second kind)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, const, sqrt
from textile_twin_core.mechanism.group import Closure, PlainGroup, check_finite, check_length
from textile_twin_core.mechanism.joint import Joint, guide, pivot
from textile_twin_core.mechanism.motion import LinkMotion, Motion, PointMotion
from textile_twin_core.mechanism.slider_crank import SliderCrank
from textile_twin_core.mechanism.transmission import Transmission, transmission_angles
from textile_twin_core.mechanism.vector import Vector
from textile_twin_core.mechanism.wrenches import Wrenches

Sense = Literal["forward", "backward"]


@dataclass(frozen=True)
class RRPDyad(PlainGroup):
    """A rod from point `from_point` to the slider's joint `end`, and the slider on to its point `tip`.

    `lengths_m` are those of rod and slider. The guide is the line through `guide_point_m` along
    `guide_direction`; the slider's tip lies in that direction from its joint. `branch` says whether
    the rod points along the guide's direction or against it.
    """

    rod: str
    slider: str
    from_point: str
    end: str
    tip: str
    lengths_m: tuple[float, float]
    guide_point_m: tuple[float, float]
    guide_direction: tuple[float, float]
    branch: Sense = "forward"

    def __post_init__(self) -> None:
        for link, length in zip((self.rod, self.slider), self.lengths_m, strict=True):
            check_length(length, f"dyad '{self.name}': length of '{link}'")
        for value in (*self.guide_point_m, *self.guide_direction):
            check_finite(value, f"dyad '{self.name}': guide")
        if math.hypot(*self.guide_direction) == 0.0:
            raise MachineError(f"dyad '{self.name}': guide_direction must not be the zero vector")
        if self.branch not in ("forward", "backward"):
            raise MachineError(f"dyad '{self.name}': branch must be 'forward' or 'backward', not {self.branch!r}")

    @property
    def name(self) -> str:
        """The group's name in messages."""
        return f"{self.rod}-{self.slider}"

    @property
    def pins(self) -> tuple[str, ...]:
        """Both ends of the rod."""
        return self.from_point, self.end

    @property
    def axis(self) -> tuple[float, float]:
        """The guide's unit direction."""
        norm = math.hypot(*self.guide_direction)
        return self.guide_direction[0] / norm, self.guide_direction[1] / norm

    def offset(self, start: PointMotion) -> Expr:
        """Distance of `from_point` from the guide, positive to the left of its direction [m]."""
        across = Vector.of(*self.axis).turned_left()
        return (start.position - Vector.of(*self.guide_point_m)).dot(across)

    def reach(self, start: PointMotion) -> Expr:
        """The rod's extent along the guide; its sign is the branch [m]."""
        crank = self._slider_crank(start)
        if crank is not None:
            return crank.reach
        length, offset = self.lengths_m[0], self.offset(start)
        return self._sense * sqrt((length - offset) * (length + offset))

    def closures(self, motion: Motion) -> tuple[Closure, ...]:
        """The dyad opens when the rod does not reach the guide."""
        start, length = motion.points[self.from_point], self.lengths_m[0]
        crank = self._slider_crank(start)
        offset = self.offset(start)
        less, more = (length - offset, length + offset) if crank is None else crank.factors
        how = f"rod '{self.rod}' is too short to reach the guide of '{self.slider}'"
        return Closure(how, less, length), Closure(how, more, length)

    def transmission(self, motion: Motion, smallest: Sequence[float]) -> Transmission:
        """By the angle between rod and guide normal; its distance is the rod start's from where it just reaches."""
        less, more = (max(value, 0.0) for value in smallest)
        return Transmission(min(less, more), transmission_angles(less, more, 2.0 * self.lengths_m[0]))

    def joints(self, motion: Motion) -> tuple[Joint, ...]:
        """The rod turns about its start, the slider slides along the guide."""
        return pivot(motion, self.rod, self.from_point), guide(self.slider, self.guide_point_m, self.axis)

    def balance(self, wrenches: Wrenches) -> None:
        """The slider's own direction and the rod's moment about its start give the force in their joint."""
        start = wrenches.motion.points[self.from_point]
        along = Vector.of(*self.axis)
        across = along.turned_left()
        rod_force, rod_moment = wrenches.on(self.rod)
        slider_force, _ = wrenches.on(self.slider)
        axial = -slider_force.dot(along)
        lateral = (rod_moment - axial * self.offset(start)) * (1.0 / self.reach(start))
        joint = axial * along + lateral * across
        first = joint - rod_force
        wrenches.add_reaction(self.end, joint)
        wrenches.add_reaction(self.from_point, first)
        wrenches.guide_reactions[self.slider] = -(lateral + slider_force.dot(across))
        wrenches.pull_on_point(self.from_point, -first)

    @property
    def _sense(self) -> float:
        return 1.0 if self.branch == "forward" else -1.0

    def _slider_crank(self, start: PointMotion) -> SliderCrank | None:
        if start.circle is None:
            return None
        return SliderCrank(start.circle, self.lengths_m[0], self.guide_point_m, self.guide_direction, self._sense)

    def solve(self, motion: Motion) -> None:
        """Add rod, slider, their joint and the slider's tip."""
        start = motion.point(self.from_point, self.name)
        rod_length, slider_length = self.lengths_m
        along = Vector.of(*self.axis)
        across = along.turned_left()
        guide = Vector.of(*self.guide_point_m)
        reach, offset = self.reach(start), self.offset(start)
        u = (1.0 / rod_length) * (reach * along - offset * across)
        drift = start.first.dot(across)
        p, q = self._rod_rates(start)
        slide_first = start.first.dot(along) + offset * p
        slide_second = start.second.dot(along) + offset * q + drift * p

        travel = (start.position - guide).dot(along) + reach
        joint = PointMotion.sliding(guide + travel * along, along, slide_first, slide_second)
        tip = PointMotion.sliding(guide + (travel + slider_length) * along, along, slide_first, slide_second)
        motion.add_link(LinkMotion(self.rod, self.from_point, self.end, rod_length, u, p, q), self.name)
        zero = const(0.0)
        motion.add_link(LinkMotion(self.slider, self.end, self.tip, slider_length, along, zero, zero), self.name)
        motion.add_point(self.end, joint, self.name)
        motion.add_point(self.tip, tip, self.name)

    def _rod_rates(self, start: PointMotion) -> tuple[Expr, Expr]:
        """First and second derivative of the rod's angle with respect to theta."""
        crank = self._slider_crank(start)
        if crank is not None and start.circle is not None:
            p, q = crank.rod_rates()
            shaft = start.circle.shaft
            return p * shaft.first, q * (shaft.first * shaft.first) + p * shaft.second
        across = Vector.of(*self.axis).turned_left()
        inverse = 1.0 / self.reach(start)
        p = -(start.first.dot(across) * inverse)
        return p, -((start.second.dot(across) + self.offset(start) * (p * p)) * inverse)
