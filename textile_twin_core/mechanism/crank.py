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
    """A crank from a fixed point, at the angle of its shaft plus a phase.

    Attributes:
        name: name of the link.
        at: fixed point on the shaft's axis.
        end: name of the new point at the crank's end.
        length_m: length [m].
        phase_rad: angle of the crank where that of the shaft is 0 [rad].
        driven_by: shaft that carries the crank: the main shaft, or an earlier gear.

    Raises:
        MachineError: for a length that is not positive.

    Examples:
        >>> import textile_twin_core as ttc
        >>> from textile_twin_core.mechanism import Crank
        >>> machine = ttc.Machine("disc", points={"O": (0.0, 0.0)}, groups=(Crank("l1", "O", "A", 0.05),))
        >>> round(ttc.compile(machine, ["point_A_x_m"]).evaluate(0.0)["point_A_x_m"], 3)  # [m]
        0.05
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
