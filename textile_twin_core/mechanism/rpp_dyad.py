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

    The slot stands at `slot_angle_rad` to the guide, counter-clockwise. The new point `end` is where slot and guide
    cross: the slider's link goes from there along the guide to the second of `tips`, the block's from its pin along the
    slot to the first. `lengths_m` are those of block and slider. The guide is the line through `guide_point_m` along
    `guide_direction`, on the ground or, with `guide_on`, in the frame of that link. `slot_m` are the distances along
    the slot from the guide between which the pin must stay.

    Raises:
        MachineError: for lengths, a guide or a slot that cannot be, and a slot parallel to the guide.

    Example:
        >>> yoke = RPPDyad("block", "yoke", "A", "Q", ("S", "T"), (0.04, 0.3), (0.0, 0.0), (1.0, 0.0))
        >>> motion = Linkage({"O": (0.0, 0.0)}, (Crank("crank", "O", "A", 0.1), yoke)).solved
        >>> motion.points["Q"].position.x  # 0.1 cos(theta)
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
        """The guide's unit direction, in the frame that it is declared in."""
        return unit(self.guide_direction)

    def guide(self, motion: Motion) -> GuideLine:
        """The guide as it moves."""
        return GuideLine.of(motion, self.guide_on, self.guide_point_m, self.guide_direction, self.name)

    def ways(self, motion: Motion) -> Seen:
        """Way of the slider along its guide, and of the pin along the slot from the guide [m]."""
        cosine, sine = unit_direction(self.slot_angle_rad)
        seen = self.guide(motion).seen(motion.point(self.from_point, self.name))
        x0, x1, x2 = seen.along
        t0, t1, t2 = ((1.0 / sine) * value for value in seen.across)
        return Seen((x0 - cosine * t0, x1 - cosine * t1, x2 - cosine * t2), (t0, t1, t2))

    def solve(self, motion: Motion) -> None:
        """Add block and slider, the point where their guides cross, and their tips."""
        pin, line, ways = motion.point(self.from_point, self.name), self.guide(motion), self.ways(motion)
        slot = line.direction.rotated(*unit_direction(self.slot_angle_rad))
        (block_length, slider_length), (block_tip, tip) = self.lengths_m, self.tips
        p, q = line.first, line.second
        across, along = Sliding(ways.across[1], self.slider), Sliding(ways.along[1], self.guide_on)
        block = LinkMotion(self.block, self.from_point, block_tip, block_length, slot, p, q, sliding=across)
        slider = LinkMotion(self.slider, self.end, tip, slider_length, line.direction, p, q, sliding=along)
        motion.add_link(block, self.name)
        motion.add_link(slider, self.name)
        way, *rates = ways.along
        motion.add_point(self.end, line.point(way, *rates), self.name)
        motion.add_point(tip, line.point(way + slider_length, *rates), self.name)
        motion.add_point(block_tip, block.end_motion(pin), self.name)

    def closures(self, motion: Motion) -> tuple[Closure, ...]:
        """It always closes, but for the ends of its slot."""
        return slot_ends(self.block, self.ways(motion).across[0], self.slot_m)

    def joints(self, motion: Motion) -> tuple[Joint, ...]:
        """The slider slides along its guide, the block along the slider's slot."""
        return self.guide(motion).joint(self.slider), guide(
            self.block, (0.0, 0.0), unit_direction(self.slot_angle_rad), self.slider
        )

    def balance(self, wrenches: Wrenches) -> None:
        """The slider's own direction gives the force across the slot; along it the pin bears what acts on the block."""
        motion = wrenches.motion
        line, (way, *_) = self.guide(motion), self.ways(motion).across
        _, sine = unit_direction(self.slot_angle_rad)
        across: Vector = motion.links[self.block].direction.turned_left()
        block_force, block_moment = wrenches.on(self.block)
        slider_force, slider_moment = wrenches.on(self.slider)
        size = (1.0 / sine) * slider_force.dot(line.direction)
        pressed = size * across  # all that the block puts on the slider
        pin = pressed - block_force
        wrenches.guide_reactions[self.block] = -size
        wrenches.transmitted[self.block] = -block_moment
        bears = -(pressed + slider_force).dot(line.direction.turned_left())
        moment = -(slider_moment + block_moment + way * size)
        line.bear(wrenches, self.slider, motion.points[self.end].position, bears, moment)
        wrenches.add_reaction(self.from_point, pin)
        wrenches.pull_on_point(self.from_point, -pin)
