"""Crank: a link that turns with a shaft about a fixed point."""

from __future__ import annotations

from dataclasses import dataclass

from textile_twin_core.errors import MachineError
from textile_twin_core.mechanism.group import MAIN_SHAFT, PlainGroup, check_finite, check_length
from textile_twin_core.mechanism.joint import Joint, pivot
from textile_twin_core.mechanism.motion import Circle, LinkMotion, Motion, PointMotion
from textile_twin_core.mechanism.vector import unit_direction
from textile_twin_core.mechanism.wrenches import Wrenches


@dataclass(frozen=True)
class Crank(PlainGroup):
    """A crank of `length_m` from the fixed point `at` to the point `end`.

    Its angle is that of the shaft `driven_by` plus `phase_rad`.
    """

    name: str
    at: str
    end: str
    length_m: float
    phase_rad: float = 0.0
    driven_by: str = MAIN_SHAFT

    def __post_init__(self) -> None:
        check_length(self.length_m, f"crank '{self.name}': length_m")
        check_finite(self.phase_rad, f"crank '{self.name}': phase_rad")

    def solve(self, motion: Motion) -> None:
        """Add the crank and its end point."""
        centre = motion.point(self.at, self.name)
        if not centre.is_fixed:
            raise MachineError(f"crank '{self.name}': point '{self.at}' must be fixed to the ground")
        shaft = motion.rotation(self.driven_by, self.name)
        half = shaft.half.rotated(*unit_direction(self.phase_rad / 2.0))
        direction = shaft.direction.rotated(*unit_direction(self.phase_rad))
        p, q, r = shaft.first, shaft.second, self.length_m
        normal = direction.turned_left()
        end = PointMotion(
            position=centre.position + r * direction,
            first=(r * p) * normal,
            second=(r * q) * normal - (r * (p * p)) * direction,
            speed_squared=(r * r) * (p * p),
            speed_product=(r * r) * (p * q),
            circle=Circle(centre.fixed_position(), r, half, shaft),
        )
        motion.add_point(self.end, end, self.name)
        angle = shaft.angle + self.phase_rad
        motion.add_link(LinkMotion(self.name, self.at, self.end, r, direction, p, q, angle), self.name)

    @property
    def pins(self) -> tuple[str, ...]:
        """The crank's centre."""
        return (self.at,)

    def joints(self, motion: Motion) -> tuple[Joint, ...]:
        """Return the turning joint at the crank's centre."""
        return (pivot(motion, self.name, self.at),)

    def balance(self, wrenches: Wrenches) -> None:
        """Pass the force to the centre and the moment to the shaft."""
        force, moment = wrenches.on(self.name)
        wrenches.add_reaction(self.at, -force)
        wrenches.add_torque(self.driven_by, moment)
