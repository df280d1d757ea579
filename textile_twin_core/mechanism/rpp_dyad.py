"""RPP dyad: a block in the slot of a slider, as in a Scotch yoke (Assur group of class II, fourth kind)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from textile_twin_core.errors import MachineError
from textile_twin_core.mechanism.group import Closure, PlainGroup, check_length
from textile_twin_core.mechanism.guide_line import GuideLine, Seen, check_guide, check_slot, slot_ends, unit
from textile_twin_core.mechanism.joint import Joint, guide
from textile_twin_core.mechanism.motion import LinkMotion, Motion, Sliding
from textile_twin_core.mechanism.vector import Vector, unit_direction
from textile_twin_core.mechanism.wrenches import Wrenches

_LEAST_SINE = 1e-3


@dataclass(frozen=True)
class RPPDyad(PlainGroup):
    """A block pinned at `from_point`, in a straight slot of a slider on a guide.

    The slot is at `slot_angle_rad` to the guide, counter-clockwise. Slot and guide cross at the new point `end`. The
    slider's link goes from `end` along the guide to the second of `tips`; the block's link goes from its pin along the
    slot to the first. `lengths_m` are those of block and slider. The guide is the line through `guide_point_m` along
    `guide_direction`, on the ground or, with `guide_on`, in the frame of that link. `slot_m` are the two distances
    along the slot from the guide between which the pin must stay.

    Raises:
        MachineError: for impossible lengths, guide or slot, and for a slot parallel to the guide.

    Examples:
        >>> import numpy as np
        >>> from textile_twin_core.mechanism import Crank, Linkage
        >>> from textile_twin_core.mechanism.extremes import values_over
        >>> yoke = RPPDyad("block", "yoke", "A", "Q", ("S", "T"), (0.04, 0.3), (0.0, 0.0), (1.0, 0.0))
        >>> motion = Linkage({"O": (0.0, 0.0)}, (Crank("crank", "O", "A", 0.1), yoke)).solved
        >>> values_over(motion.points["Q"].position.x, np.array([0.0, np.pi])).round(9).tolist()  # 0.1 cos(theta)
        [0.1, -0.1]
    """

    block: str
    slider: str
    from_point: str
    end: str
    tips: tuple[str, str]
    lengths_m: tuple[float, float]
    guide_point_m: tuple[float, float]
    guide_direction: tuple[float, float]
    slot_angle_rad: float = math.pi / 2.0
    guide_on: str | None = None
    slot_m: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for link, length in zip((self.block, self.slider), self.lengths_m, strict=True):
            check_length(length, f"dyad '{self.name}': length of '{link}'")
        check_guide(f"dyad '{self.name}'", self.guide_point_m, self.guide_direction)
        check_slot(f"dyad '{self.name}'", self.slot_m)
        if not (math.isfinite(self.slot_angle_rad) and abs(math.sin(self.slot_angle_rad)) >= _LEAST_SINE):
            raise MachineError(
                f"dyad '{self.name}': slot_angle_rad must lie away from 0 and pi, where the slot is parallel to the "
                f"guide and holds nothing, not {self.slot_angle_rad!r}"
            )

    @property
    def name(self) -> str:
        """The group's name in messages."""
        return f"{self.block}-{self.slider}"

    @property
    def pins(self) -> tuple[str, ...]:
        """The block's pin."""
        return (self.from_point,)

    @property
    def axis(self) -> tuple[float, float]:
        """Unit direction of the guide, in the frame of its declaration."""
        return unit(self.guide_direction)

    def guide(self, motion: Motion) -> GuideLine:
        """Express the guide over the motion."""
        return GuideLine.of(motion, self.guide_on, self.guide_point_m, self.guide_direction, self.name)

    def positions(self, motion: Motion) -> Seen:
        """Express the slider's position along its guide, and the pin's along the slot from the guide [m]."""
        cosine, sine = unit_direction(self.slot_angle_rad)
        seen = self.guide(motion).seen(motion.point(self.from_point, self.name))
        x0, x1, x2 = seen.along
        t0, t1, t2 = ((1.0 / sine) * value for value in seen.across)
        return Seen((x0 - cosine * t0, x1 - cosine * t1, x2 - cosine * t2), (t0, t1, t2))

    def solve(self, motion: Motion) -> None:
        """Add block and slider, the crossing of their guides, and their tips."""
        pin, line, positions = motion.point(self.from_point, self.name), self.guide(motion), self.positions(motion)
        slot = line.direction.rotated(*unit_direction(self.slot_angle_rad))
        (block_length, slider_length), (block_tip, tip) = self.lengths_m, self.tips
        p, q = line.first, line.second
        across, along = Sliding(positions.across[1], self.slider), Sliding(positions.along[1], self.guide_on)
        block = LinkMotion(self.block, self.from_point, block_tip, block_length, slot, p, q, sliding=across)
        slider = LinkMotion(self.slider, self.end, tip, slider_length, line.direction, p, q, sliding=along)
        motion.add_link(block, self.name)
        motion.add_link(slider, self.name)
        slide, *rates = positions.along
        motion.add_point(self.end, line.point(slide, *rates), self.name)
        motion.add_point(tip, line.point(slide + slider_length, *rates), self.name)
        motion.add_point(block_tip, block.end_motion(pin), self.name)

    def closures(self, motion: Motion) -> tuple[Closure, ...]:
        """Return the ends of the slot; the dyad closes everywhere else."""
        return slot_ends(self.block, self.positions(motion).across[0], self.slot_m)

    def joints(self, motion: Motion) -> tuple[Joint, ...]:
        """Return the sliding joints of the slider on its guide and of the block in the slot."""
        return self.guide(motion).joint(self.slider), guide(
            self.block, (0.0, 0.0), unit_direction(self.slot_angle_rad), self.slider
        )

    def balance(self, wrenches: Wrenches) -> None:
        """Solve the force across the slot from the slider's balance; the pin bears the block's load along the slot."""
        motion = wrenches.motion
        line, (slide, *_) = self.guide(motion), self.positions(motion).across
        _, sine = unit_direction(self.slot_angle_rad)
        across: Vector = motion.links[self.block].direction.turned_left()
        block_force, block_moment = wrenches.on(self.block)
        slider_force, slider_moment = wrenches.on(self.slider)
        size = (1.0 / sine) * slider_force.dot(line.direction)
        pressed = size * across  # total force of the block on the slider
        pin = pressed - block_force
        wrenches.guide_reactions[self.block] = -size
        wrenches.transmitted[self.block] = -block_moment
        bears = -(pressed + slider_force).dot(line.direction.turned_left())
        moment = -(slider_moment + block_moment + slide * size)
        line.bear(wrenches, self.slider, motion.points[self.end].position, bears, moment)
        wrenches.add_reaction(self.from_point, pin)
        wrenches.pull_on_point(self.from_point, -pin)
