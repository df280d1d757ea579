"""Rigid arm: a second link fixed to an earlier one at its start point."""

from __future__ import annotations

from dataclasses import dataclass

from textile_twin_core.mechanism.group import Closure, check_finite, check_length
from textile_twin_core.mechanism.motion import LinkMotion, Motion
from textile_twin_core.mechanism.vector import unit_direction


@dataclass(frozen=True)
class RigidArm:
    """An arm of `length_m` rigid with the link `on`, from that link's start point to the point `end`.

    `angle_rad` is the arm's angle minus the link's.
    """

    name: str
    on: str
    end: str
    length_m: float
    angle_rad: float = 0.0

    def __post_init__(self) -> None:
        check_length(self.length_m, f"arm '{self.name}': length_m")
        check_finite(self.angle_rad, f"arm '{self.name}': angle_rad")

    def solve(self, motion: Motion) -> None:
        """Add the arm and its end point."""
        carrier = motion.link(self.on, self.name)
        start = motion.point(carrier.start, self.name)
        u = carrier.direction.rotated(*unit_direction(self.angle_rad))
        p, q = carrier.first, carrier.second
        angle = None if carrier.angle is None else carrier.angle + self.angle_rad
        arm = LinkMotion(self.name, carrier.start, self.end, self.length_m, u, p, q, angle)
        motion.add_link(arm, self.name)
        motion.add_point(self.end, arm.end_motion(start), self.name)

    def closures(self, motion: Motion) -> tuple[Closure, ...]:
        """None: it always closes."""
        return ()
