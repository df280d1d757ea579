"""Rigid arm: a second link fixed to an earlier one at its start point."""

from __future__ import annotations

from dataclasses import dataclass

from textile_twin_core.mechanism.group import PlainGroup, check_finite, check_length
from textile_twin_core.mechanism.joint import Joint
from textile_twin_core.mechanism.motion import LinkMotion, Motion
from textile_twin_core.mechanism.vector import unit_direction
from textile_twin_core.mechanism.wrenches import Wrenches


@dataclass(frozen=True)
class RigidArm(PlainGroup):
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

    @property
    def pins(self) -> tuple[str, ...]:
        """Empty: the arm is fixed to its link."""
        return ()

    def joints(self, motion: Motion) -> tuple[Joint, ...]:
        """Return the fixed mounting of the arm on its link."""
        return (Joint(f"{self.name}_mount", "fixed", self.on, self.name, (0.0, 0.0), self.angle_rad),)

    def balance(self, wrenches: Wrenches) -> None:
        """Pass force and moment to the link that carries the arm."""
        force, moment = wrenches.on(self.name)
        wrenches.transmitted[self.name] = -moment
        wrenches.add(self.on, force, moment)
