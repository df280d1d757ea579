"""Elliptic gear pair: two equal ellipses, each turning about a focus, that roll on each other."""

from __future__ import annotations

import math
from dataclasses import dataclass

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, at_least, atan2, const, real, select, sqrt
from textile_twin_core.mechanism.group import MAIN_SHAFT, PlainGroup, check_finite
from textile_twin_core.mechanism.joint import Joint, pivot
from textile_twin_core.mechanism.motion import LinkMotion, Motion, PointMotion, Rotation
from textile_twin_core.mechanism.vector import Vector, unit_direction
from textile_twin_core.mechanism.wrenches import Wrenches


@dataclass(frozen=True)
class GearMesh:
    """Contact of the pitch ellipses.

    The pitch radii [m] lie on the centre line; `along` is its unit vector from driver to driven gear. `steepness` is
    the tangent of the angle from the normal of the centre line, counter-clockwise, to the common tangent of the
    ellipses.
    """

    along: Vector
    driver_radius: Expr
    driven_radius: Expr
    steepness: Expr


@dataclass(frozen=True)
class EllipticGearPair(PlainGroup):
    """Gear `driver`, which turns with the shaft `driven_by` about the point `at`, and gear `driven` about `driven_at`.

    Half the distance of the two points is the major half axis a of both pitch ellipses; `axis_ratio` is k = b/a, and
    e^2 = 1 - k^2. Each gear is a link from its axis to its other focus, named in `ends`; its centroid is mid-link. The
    gear `driven` is a shaft as well, with the angle of its link, and turns opposite to the driver. `mesh` names the
    contact point of the ellipses, on the centre line. `phase_rad` is the driver's angle past the smallest ratio of the
    pair, at shaft angle 0. With the angles f1, f2 counted from the smallest ratio

        tan(f2/2) = (1 - e)/(1 + e) tan(f1/2),  df2/df1 = (1 - e^2)/(1 + e^2 + 2 e cos f1).

    The teeth press along the common tangent turned by `pressure_angle_rad` towards the gear that is pressed.

    References:
        Zhao, Ren and Chen 2011, Eq. 4: the same relation with an arc cosine.
    """

    driver: str
    driven: str
    at: str
    driven_at: str
    ends: tuple[str, str]
    axis_ratio: float
    phase_rad: float = 0.0
    mesh: str = "P"
    pressure_angle_rad: float = math.radians(20.0)
    driven_by: str = MAIN_SHAFT

    def __post_init__(self) -> None:
        check_finite(self.phase_rad, f"gears '{self.name}': phase_rad")
        if not 0.0 <= self.pressure_angle_rad < math.pi / 4:
            raise MachineError(
                f"gears '{self.name}': pressure_angle_rad must lie from 0 to pi/4, not {self.pressure_angle_rad!r}"
            )
        steepest = real.sin(self.pressure_angle_rad)
        if not steepest < self.axis_ratio <= 1.0:
            raise MachineError(
                f"gears '{self.name}': axis_ratio must lie above {steepest:.4g}, where the teeth would jam, "
                f"and not above 1, not {self.axis_ratio}"
            )

    @property
    def name(self) -> str:
        """The group's name in messages."""
        return f"{self.driver}-{self.driven}"

    @property
    def pins(self) -> tuple[str, ...]:
        """Both axes and the contact point of the teeth."""
        return self.at, self.driven_at, self.mesh

    @property
    def eccentricity(self) -> float:
        """Numerical eccentricity e of the pitch ellipses."""
        return real.sqrt((1.0 - self.axis_ratio) * (1.0 + self.axis_ratio))

    def driven_turn(self, driver_turn_rad: float) -> float:
        """Compute f2 at f1, both unwrapped and counted from the smallest ratio [rad]."""
        e = self.eccentricity
        c, s = real.cos(driver_turn_rad / 2.0), real.sin(driver_turn_rad / 2.0)
        return driver_turn_rad - 2.0 * real.atan2(2.0 * e * s * c, (1.0 + e) * c * c + (1.0 - e) * s * s)

    def solve(self, motion: Motion) -> None:
        """Add both gears, their other foci, the driven shaft and the contact point."""
        distance, line = self._centre_line(motion)
        shaft = motion.rotation(self.driven_by, self.name)
        half, e = self._half_turn(motion), self.eccentricity
        c, s = half.x, half.y
        near, far = (1.0 + e) * c, (1.0 - e) * s
        norm_squared = near * near + far * far
        norm = sqrt(norm_squared)
        ratio = (1.0 - e * e) / norm_squared
        growth = (4.0 * e) * (s * c) * ratio / norm_squared
        lead = shaft.angle + self.phase_rad
        lag = 2.0 * atan2((2.0 * e) * (s * c), (1.0 + e) * (c * c) + (1.0 - e) * (s * s))

        # At the smallest ratio both gears point along the centre line, from the driven axis to the driver's.
        towards_driver = line + math.pi
        turned = unit_direction(towards_driver / 2.0)
        p, q = shaft.first, shaft.second
        driver = Rotation(half.rotated(*turned), lead + towards_driver, p, q)
        driven_half = Vector(near / norm, -(far / norm)).rotated(*turned)
        driven = Rotation(driven_half, lag - lead + towards_driver, -(ratio * p), -(growth * (p * p) + ratio * q))
        motion.rotations[self.driven] = driven
        for gear, axis, end, rotation in (
            (self.driver, self.at, self.ends[0], driver),
            (self.driven, self.driven_at, self.ends[1], driven),
        ):
            direction, first, second = rotation.direction, rotation.first, rotation.second
            link = LinkMotion(gear, axis, end, e * distance, direction, first, second, rotation.angle)
            motion.add_link(link, self.name)
            motion.add_point(end, link.end_motion(motion.points[axis]), self.name)
        motion.add_point(self.mesh, self._touching_point(motion), self.name)

    def joints(self, motion: Motion) -> tuple[Joint, ...]:
        """Return the turning joints of both gears."""
        return pivot(motion, self.driver, self.at), pivot(motion, self.driven, self.driven_at)

    def balance(self, wrenches: Wrenches) -> None:
        """Solve the tooth force, on the loaded flank, from the driven gear's moment."""
        mesh = self.contact(wrenches.motion)
        driver_force, driver_moment = wrenches.on(self.driver)
        driven_force, driven_moment = wrenches.on(self.driven)
        load = driven_moment + wrenches.torque_on.pop(self.driven, const(0.0))
        across = load / mesh.driven_radius
        # the loaded flank turns the force away from the common tangent, so that it pushes the gears apart
        k = real.tan(self.pressure_angle_rad)
        pressing = (mesh.steepness - k) / (1.0 + k * mesh.steepness)
        other = (mesh.steepness + k) / (1.0 - k * mesh.steepness)
        slant = select(at_least(across, 0.0), pressing, other)
        tooth = across * (mesh.along.turned_left() - slant * mesh.along)
        wrenches.add_reaction(self.mesh, tooth)
        wrenches.add_reaction(self.driven_at, -tooth - driven_force)
        wrenches.add_reaction(self.at, tooth - driver_force)
        wrenches.add_torque(self.driven_by, driver_moment - mesh.driver_radius * across)

    def contact(self, motion: Motion) -> GearMesh:
        """Express the pitch radii and the common tangent over the motion."""
        distance, line = self._centre_line(motion)
        half, e = self._half_turn(motion), self.eccentricity
        c, s = half.x, half.y
        width = self._width(half)
        near, far = (1.0 + e) * c, (1.0 - e) * s
        radius = distance / 2.0
        return GearMesh(
            along=Vector.of(*unit_direction(line)),
            driver_radius=radius * (1.0 - e * e) / width,
            driven_radius=radius * (near * near + far * far) / width,
            steepness=(2.0 * e) * (s * c) / width,
        )

    def _touching_point(self, motion: Motion) -> PointMotion:
        mesh, shaft, e = self.contact(motion), motion.rotation(self.driven_by, self.name), self.eccentricity
        half, width = self._half_turn(motion), self._width(self._half_turn(motion))
        c, s = half.x, half.y
        slope = mesh.driver_radius * mesh.steepness
        bend = mesh.driver_radius * (e * ((1.0 + e) * (c * c) - (1.0 - e) * (s * s))) / (width * width)
        first = slope * shaft.first
        second = (bend + slope * mesh.steepness) * (shaft.first * shaft.first) + slope * shaft.second
        position = motion.points[self.at].position + mesh.driver_radius * mesh.along
        return PointMotion.sliding(position, mesh.along, first, second)

    def _half_turn(self, motion: Motion) -> Vector:
        """Express the direction of half the driver's angle from the smallest ratio."""
        shaft = motion.rotation(self.driven_by, self.name)
        return shaft.half.rotated(*unit_direction(self.phase_rad / 2.0))

    def _width(self, half: Vector) -> Expr:
        """Express 1 + e cos f1 without cancellation for a flat ellipse."""
        e = self.eccentricity
        return (1.0 + e) * (half.x * half.x) + (1.0 - e) * (half.y * half.y)

    def _centre_line(self, motion: Motion) -> tuple[float, float]:
        """Compute length and angle of the line from the driver's axis to the driven gear's [m, rad]."""
        axes = [motion.point(name, self.name) for name in (self.at, self.driven_at)]
        if not all(axis.is_fixed for axis in axes):
            raise MachineError(f"gears '{self.name}': '{self.at}' and '{self.driven_at}' must be fixed to the ground")
        (ox, oy), (ax, ay) = (axis.fixed_position() for axis in axes)
        distance = real.hypot(ax - ox, ay - oy)
        if distance == 0.0:
            raise MachineError(f"gears '{self.name}': '{self.at}' and '{self.driven_at}' are one point; set them apart")
        return distance, real.atan2(ay - oy, ax - ox)
