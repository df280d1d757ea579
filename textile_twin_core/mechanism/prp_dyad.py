"""PRP dyad: two sliders pinned to each other, each on its own guide (Assur group of class II, fifth kind)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr
from textile_twin_core.mechanism.extremes import smallest_value, values_over
from textile_twin_core.mechanism.group import Closure, PlainGroup, check_length
from textile_twin_core.mechanism.guide_line import GuideLine, check_guide, check_slot, slot_ends
from textile_twin_core.mechanism.joint import Joint
from textile_twin_core.mechanism.motion import LinkMotion, Motion, Sliding
from textile_twin_core.mechanism.transmission import Transmission
from textile_twin_core.mechanism.vector import Vector
from textile_twin_core.mechanism.wrenches import Wrenches


@dataclass(frozen=True)
class Guide:
    """A straight guide through `point_m` along `direction`, in the frame of the link `on`, or of the ground if None.

    `slot_m` are the two distances from the point between which the slider must stay.
    """

    on: str | None = None
    point_m: tuple[float, float] = (0.0, 0.0)
    direction: tuple[float, float] = (1.0, 0.0)
    slot_m: tuple[float, float] | None = None


@dataclass(frozen=True)
class GuideCrossing:
    """Crossing of two guides: the sine between them, and each slider's position [m] with two derivatives by theta."""

    sine: Expr
    positions: tuple[tuple[Expr, Expr, Expr], tuple[Expr, Expr, Expr]]


@dataclass(frozen=True)
class PRPDyad(PlainGroup):
    """Two sliders pinned to each other at the new point `end`, where their guides cross.

    Each slider's link goes from there along its guide to its point of `tips`, by its length in `lengths_m`. At least
    one guide belongs to a link that moves.

    Raises:
        MachineError: for impossible lengths, guides or slots, and for two guides on one link.

    Examples:
        >>> ram = PRPDyad(("die", "ram"), "D", ("S", "E"), (0.05, 0.3), (Guide("lever"), Guide(None, (0.0, 0.22))))
        >>> ram.name
        'die-ram'
    """

    sliders: tuple[str, str]
    end: str
    tips: tuple[str, str]
    lengths_m: tuple[float, float]
    guides: tuple[Guide, Guide]

    def __post_init__(self) -> None:
        for link, length, guide in zip(self.sliders, self.lengths_m, self.guides, strict=True):
            check_length(length, f"dyad '{self.name}': length of '{link}'")
            check_guide(f"dyad '{self.name}'", guide.point_m, guide.direction)
            check_slot(f"dyad '{self.name}'", guide.slot_m)
        if self.guides[0].on == self.guides[1].on:
            raise MachineError(f"dyad '{self.name}': both guides are on one link, so nothing moves; put one on another")

    @property
    def name(self) -> str:
        """The group's name in messages."""
        return "-".join(self.sliders)

    @property
    def pins(self) -> tuple[str, ...]:
        """The joint of the sliders."""
        return (self.end,)

    def lines(self, motion: Motion) -> tuple[GuideLine, GuideLine]:
        """Express both guides over the motion."""
        one, two = (GuideLine.of(motion, g.on, g.point_m, g.direction, self.name) for g in self.guides)
        return one, two

    def crossing(self, motion: Motion) -> GuideCrossing:
        """Solve the sliders' positions from the loop closure and its derivatives."""
        one, two = self.lines(motion)
        sine = one.direction.cross(two.direction)

        def positions(between: Vector) -> tuple[Expr, Expr]:
            return between.cross(two.direction) / sine, between.cross(one.direction) / sine

        slide = positions(two.origin.position - one.origin.position)
        carried = [
            line.origin.first + (x * line.first) * line.direction.turned_left()
            for line, x in zip((one, two), slide, strict=True)
        ]
        rate = positions(carried[1] - carried[0])
        bent = [
            line.origin.second
            + (2.0 * (v * line.first) + x * line.second) * line.direction.turned_left()
            - (x * (line.first * line.first)) * line.direction
            for line, x, v in zip((one, two), slide, rate, strict=True)
        ]
        bend = positions(bent[1] - bent[0])
        return GuideCrossing(sine, ((slide[0], rate[0], bend[0]), (slide[1], rate[1], bend[1])))

    def solve(self, motion: Motion) -> None:
        """Add both sliders, their joint and their tips."""
        lines, positions = self.lines(motion), self.crossing(motion).positions
        straight = 1 if lines[1].on is None else 0  # the guide on the ground, if there is one
        motion.add_point(self.end, lines[straight].point(*positions[straight]), self.name)
        for slider, tip, length, line, (slide, rate, bend) in zip(
            self.sliders, self.tips, self.lengths_m, lines, positions, strict=True
        ):
            slides = Sliding(rate, line.on)
            link = LinkMotion(slider, self.end, tip, length, line.direction, line.first, line.second, None, slides)
            motion.add_link(link, self.name)
            motion.add_point(tip, line.point(slide + length, rate, bend), self.name)

    def closures(self, motion: Motion) -> tuple[Closure, ...]:
        """Require guides that are not parallel, and sliders within their slots."""
        found = self.crossing(motion)
        sines = values_over(found.sine, np.linspace(*motion.range_rad, 9))
        sense = 1.0 if float(np.median(sines)) >= 0.0 else -1.0
        parallel = f"the guides of '{self.sliders[0]}' and '{self.sliders[1]}' come parallel"
        ends = (
            slot_ends(slider, slide[0], guide.slot_m)
            for slider, slide, guide in zip(self.sliders, found.positions, self.guides, strict=True)
        )
        return Closure(parallel, sense * found.sine, 1.0), *(end for both in ends for end in both)

    def transmission(self, motion: Motion, smallest: Sequence[float]) -> Transmission:
        """Take the angle between the guides; the distance is how far they diverge over the shorter slider's length."""
        one, two = self.lines(motion)
        cosine = one.direction.dot(two.direction)
        smallest_angle, largest_angle = (
            smallest_value(cosine, motion.range_rad)[1],
            -smallest_value(-cosine, motion.range_rad)[1],
        )
        near = math.asin(min(1.0, max(smallest[0], 0.0)))
        low, high = (math.acos(max(-1.0, min(1.0, value))) for value in (largest_angle, smallest_angle))
        return Transmission(math.sin(near) * min(self.lengths_m), (max(low, near), min(high, math.pi - near)))

    def transmission_cosine(self, motion: Motion) -> Expr:
        """Express the cosine of the angle between the guides."""
        one, two = self.lines(motion)
        return one.direction.dot(two.direction)

    def joints(self, motion: Motion) -> tuple[Joint, ...]:
        """Return the sliding joint of each slider."""
        one, two = self.lines(motion)
        return one.joint(self.sliders[0]), two.joint(self.sliders[1])

    def balance(self, wrenches: Wrenches) -> None:
        """Solve the force in the sliders' joint from each slider's balance along its guide."""
        motion = wrenches.motion
        one, two = self.lines(motion)
        (first_force, first_moment), (second_force, second_moment) = (wrenches.on(s) for s in self.sliders)
        along_one, along_two = first_force.dot(one.direction), -second_force.dot(two.direction)
        across_one, across_two = one.direction.turned_left(), two.direction.turned_left()
        joint = (1.0 / one.direction.cross(two.direction)) * (along_two * across_one - along_one * across_two)
        at = motion.points[self.end].position
        wrenches.add_reaction(self.end, joint)  # force of the first slider on the second
        one.bear(wrenches, self.sliders[0], at, (joint - first_force).dot(across_one), -first_moment)
        two.bear(wrenches, self.sliders[1], at, -(joint + second_force).dot(across_two), -second_moment)
