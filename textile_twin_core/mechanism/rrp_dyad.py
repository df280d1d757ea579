"""RRP dyad: a connecting rod and a slider on a straight guide (Assur group of class II, second kind)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, sqrt
from textile_twin_core.mechanism.group import Closure, PlainGroup, check_length
from textile_twin_core.mechanism.guide_line import GuideLine, check_guide, check_slot, slot_ends, unit
from textile_twin_core.mechanism.joint import Joint, pivot
from textile_twin_core.mechanism.motion import LinkMotion, Motion, PointMotion, Sliding
from textile_twin_core.mechanism.slider_crank import SliderCrank
from textile_twin_core.mechanism.transmission import Transmission, transmission_angles
from textile_twin_core.mechanism.wrenches import Wrenches

Sense = Literal["forward", "backward"]


@dataclass(frozen=True)
class RRPDyad(PlainGroup):
    """A rod from point `from_point` to the slider's joint `end`, and a slider from there to its point `tip`.

    `lengths_m` are those of rod and slider. The guide is the line through `guide_point_m` along `guide_direction`; the
    slider's tip lies in that direction from its joint. `branch` says whether the rod points along the guide's direction
    or against it. With `guide_on` the guide belongs to that link, and point and direction are in the link's frame
    (start point, x along the link). `slot_m` are the two distances from `guide_point_m` between which the joint must
    stay.
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
    guide_on: str | None = None
    slot_m: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for link, length in zip((self.rod, self.slider), self.lengths_m, strict=True):
            check_length(length, f"dyad '{self.name}': length of '{link}'")
        check_guide(f"dyad '{self.name}'", self.guide_point_m, self.guide_direction)
        check_slot(f"dyad '{self.name}'", self.slot_m)
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
        """Unit direction of the guide, in the frame of its declaration."""
        return unit(self.guide_direction)

    def guide(self, motion: Motion) -> GuideLine:
        """Express the guide over the motion."""
        return GuideLine.of(motion, self.guide_on, self.guide_point_m, self.guide_direction, self.name)

    def reach(self, motion: Motion) -> Expr:
        """Express the rod's extent along the guide; its sign is the branch [m]."""
        start = motion.points[self.from_point]
        crank = self._slider_crank(start)
        if crank is not None:
            return crank.reach
        length, offset = self.lengths_m[0], self.guide(motion).seen(start).across[0]
        return self._sense * sqrt((length - offset) * (length + offset))

    def closures(self, motion: Motion) -> tuple[Closure, ...]:
        """Require a rod that reaches the guide, and a joint within the slot."""
        start, length = motion.points[self.from_point], self.lengths_m[0]
        crank, seen = self._slider_crank(start), self.guide(motion).seen(start)
        offset = seen.across[0]
        less, more = (length - offset, length + offset) if crank is None else crank.factors
        how = f"rod '{self.rod}' is too short to reach the guide of '{self.slider}'"
        ends = slot_ends(self.slider, seen.along[0] + self.reach(motion), self.slot_m)
        return Closure(how, less, length), Closure(how, more, length), *ends

    def transmission(self, motion: Motion, smallest: Sequence[float]) -> Transmission:
        """Take the angle between rod and guide normal; the distance is the rod start's from the limit of reach."""
        less, more = (max(value, 0.0) for value in smallest)
        return Transmission(min(less, more), transmission_angles(less, more, 2.0 * self.lengths_m[0]))

    def transmission_cosine(self, motion: Motion) -> Expr:
        """Express the cosine of the angle between rod and guide normal."""
        less, more = (closure.value for closure in self.closures(motion)[:2])
        return (0.5 / self.lengths_m[0]) * (more - less)

    def joints(self, motion: Motion) -> tuple[Joint, ...]:
        """Return the turning joint of the rod and the sliding joint of the slider."""
        return pivot(motion, self.rod, self.from_point), self.guide(motion).joint(self.slider)

    def balance(self, wrenches: Wrenches) -> None:
        """Solve the joint force from the slider's balance along its guide and the rod's moment about its start."""
        motion = wrenches.motion
        start, line = motion.points[self.from_point], self.guide(motion)
        along, across = line.direction, line.direction.turned_left()
        rod_force, rod_moment = wrenches.on(self.rod)
        slider_force, slider_moment = wrenches.on(self.slider)
        axial = -slider_force.dot(along)
        lateral = (rod_moment - axial * line.seen(start).across[0]) * (1.0 / self.reach(motion))
        joint = axial * along + lateral * across
        first = joint - rod_force
        wrenches.add_reaction(self.end, joint)
        wrenches.add_reaction(self.from_point, first)
        bears = -(lateral + slider_force.dot(across))
        line.bear(wrenches, self.slider, motion.points[self.end].position, bears, -slider_moment)
        wrenches.pull_on_point(self.from_point, -first)

    @property
    def _sense(self) -> float:
        return 1.0 if self.branch == "forward" else -1.0

    def _slider_crank(self, start: PointMotion) -> SliderCrank | None:
        if start.circle is None or self.guide_on is not None:
            return None
        return SliderCrank(start.circle, self.lengths_m[0], self.guide_point_m, self.guide_direction, self._sense)

    def solve(self, motion: Motion) -> None:
        """Add rod, slider, their joint and the slider's tip."""
        start, line = motion.point(self.from_point, self.name), self.guide(motion)
        rod_length, slider_length = self.lengths_m
        along, across = line.direction, line.direction.turned_left()
        seen, reach = line.seen(start), self.reach(motion)
        offset, drift, _ = seen.across
        u = (1.0 / rod_length) * (reach * along - offset * across)
        p, q = self._rod_rates(motion)  # rate of the rod relative to the guide
        slide = seen.along[0] + reach
        rates = seen.along[1] + offset * p, seen.along[2] + offset * q + drift * p
        slides = Sliding(rates[0], self.guide_on)
        first, second = p + line.first, q + line.second
        motion.add_link(LinkMotion(self.rod, self.from_point, self.end, rod_length, u, first, second), self.name)
        turning = line.first, line.second
        slider = LinkMotion(self.slider, self.end, self.tip, slider_length, along, *turning, sliding=slides)
        motion.add_link(slider, self.name)
        motion.add_point(self.end, line.point(slide, *rates), self.name)
        motion.add_point(self.tip, line.point(slide + slider_length, *rates), self.name)

    def _rod_rates(self, motion: Motion) -> tuple[Expr, Expr]:
        """Express the first and second derivative, by theta, of the rod's angle relative to the guide."""
        start = motion.points[self.from_point]
        crank = self._slider_crank(start)
        if crank is not None and start.circle is not None:
            p, q = crank.rod_rates()
            shaft = start.circle.shaft
            return p * shaft.first, q * (shaft.first * shaft.first) + p * shaft.second
        offset, drift, sag = self.guide(motion).seen(start).across
        inverse = 1.0 / self.reach(motion)
        p = -(drift * inverse)
        return p, -((sag + offset * (p * p)) * inverse)
