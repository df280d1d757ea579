"""Gear pair: two round gears of any ratio, external or internal, on fixed axes or on a planet carrier.

Relative to the link that carries both axes the gears turn in the ratio of their teeth (Willis 1841), phi_2 - phi_c = k
(phi_1 - phi_c), with k = -z1/z2 for external and z1/z2 for internal teeth. Therefore phi_2 = (1 - k) phi_c + k phi_1,
and likewise for its derivatives.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, absolute, atan2, const, cos, real, sin, substitute
from textile_twin_core.mechanism.angles import full_turns, link_angle
from textile_twin_core.mechanism.group import MAIN_SHAFT, PlainGroup, check_finite, check_length
from textile_twin_core.mechanism.joint import Joint, pivot
from textile_twin_core.mechanism.linkage import THETA
from textile_twin_core.mechanism.motion import Circle, LinkMotion, Motion, PointMotion, Rotation
from textile_twin_core.mechanism.vector import Vector, unit_direction
from textile_twin_core.mechanism.wrenches import Wrenches


@dataclass(frozen=True)
class Turning:
    """An angle [rad] and its derivatives with respect to theta."""

    angle: Expr
    first: Expr
    second: Expr


_STILL = Turning(const(0.0), const(0.0), const(0.0))


@dataclass(frozen=True)
class CentreLine:
    """Line from the driver's axis to the driven gear's: length [m], unit vector, and angle of the carrying link."""

    length: float
    direction: Vector
    turning: Turning


@dataclass(frozen=True)
class PitchCircle:
    """Pitch circle of a gear: the link it is fixed to (None for a gear without a link), centre point and radius [m]."""

    link: str | None
    centre: str
    radius: float
    is_ring: bool


@dataclass(frozen=True)
class GearPair(PlainGroup):
    """A gear `driven` on the axis `driven_at`, meshing with a driving gear on the axis `at`.

    The driving gear is fixed to the earlier link `driver`, which turns about `at`. With "main_shaft" it sits on the
    main shaft; without a driver it stands still, as the sun or ring of a planetary gear. Both axes are fixed to the
    ground, or one link reaches from one axis to the other. `teeth` are the numbers of the driving and the driven gear;
    with `internal` the larger gear is a ring with internal teeth.

    The driven gear's link reaches from its axis to the new point `end`, by `length_m`. Its angle is `phase_rad` where
    the angles of driver and carrying link are 0. The gear `driven` is a shaft as well, for cranks. `mesh` names the
    point where the pitch circles touch. The tooth force acts at `pressure_angle_rad` to the common tangent and pushes
    the gears apart.

    A machine here is a periodic function of the main shaft's angle. A gear that makes no whole number of turns per
    revolution of the main shaft is therefore rejected.

    Raises:
        MachineError: for impossible teeth, lengths or pressure angle; when solved, for axes whose distance is not
            fixed, a gear without a drive, and turns that do not repeat with the main shaft.

    Examples:
        >>> planet = GearPair("planet", "O", "A", "D", 0.03, (60, 20), internal=True)  # in a ring that stands still
        >>> planet.ratio
        Fraction(3, 1)
    """

    driven: str
    at: str
    driven_at: str
    end: str
    length_m: float
    teeth: tuple[int, int]
    driver: str | None = None
    internal: bool = False
    phase_rad: float = 0.0
    mesh: str = "P"
    pressure_angle_rad: float = math.radians(20.0)

    def __post_init__(self) -> None:
        what = f"gears '{self.name}'"
        check_length(self.length_m, f"{what}: length_m")
        check_finite(self.phase_rad, f"{what}: phase_rad")
        if not all(0 < count < math.inf and count == int(count) for count in self.teeth):
            raise MachineError(f"{what}: teeth must be two whole numbers above 0, not {list(self.teeth)!r}")
        if self.internal and self.teeth[0] == self.teeth[1]:
            raise MachineError(f"{what}: a ring needs more teeth than the gear inside it, not {self.teeth[0]} as well")
        if not 0.0 <= self.pressure_angle_rad < math.pi / 4:
            raise MachineError(f"{what}: pressure_angle_rad must lie from 0 to pi/4, not {self.pressure_angle_rad!r}")
        if self.driver == self.driven:
            raise MachineError(f"{what}: driver and driven are one link; name two")

    @property
    def name(self) -> str:
        """The group's name in messages."""
        return self.driven if self.driver is None else f"{self.driver}-{self.driven}"

    @property
    def pins(self) -> tuple[str, ...]:
        """Axis of the driven gear, contact point of the teeth, and the axis of a gear on the main shaft."""
        return (*((self.at,) if self.driver == MAIN_SHAFT else ()), self.driven_at, self.mesh)

    @property
    def ratio(self) -> Fraction:
        """Speed of the driven gear over the driver's, both relative to the carrying link."""
        return Fraction(int(self.teeth[0]), self._driven_sign * int(self.teeth[1]))

    @property
    def _driven_sign(self) -> int:
        return 1 if self.internal else -1

    def pitch_radii(self, distance_m: float) -> tuple[float, float]:
        """Compute the signed distances of the axes from the mesh point along the line of centres [m].

        The direction from the driver's axis to the driven gear's is positive.
        """
        driver, driven = self.teeth[0], self._driven_sign * self.teeth[1]
        return distance_m * driver / (driver - driven), distance_m * driven / (driver - driven)

    def pitch_circles(self, motion: Motion) -> tuple[PitchCircle, PitchCircle]:
        """Return the pitch circles of the driving and the driven gear in a solved motion."""
        driver, driven = (abs(radius) for radius in self.pitch_radii(self.centre_line(motion).length))
        link = self.driver if self.driver in motion.links else None
        ring = self.internal and driver > driven, self.internal and driven > driver
        return PitchCircle(link, self.at, driver, ring[0]), PitchCircle(self.driven, self.driven_at, driven, ring[1])

    def solve(self, motion: Motion) -> None:
        """Add the driven gear, its end, its shaft and the mesh point."""
        line, driver = self.centre_line(motion), self._driver(motion)
        centre, k = motion.points[self.driven_at], self.ratio
        share, of_rest = float(k), float(1 - k)

        def mixed(of_carrier: Expr, of_driver: Expr) -> Expr:
            return of_rest * of_carrier + share * of_driver

        angle = mixed(line.turning.angle, driver.angle)
        p, q = mixed(line.turning.first, driver.first), mixed(line.turning.second, driver.second)
        if p.is_constant and p.value == 0.0:
            raise MachineError(
                f"gears '{self.name}': nothing turns the gear '{self.driven}'; name a driver, or put its axis on a "
                "link that turns"
            )
        turns = (1 - k) * full_turns(line.turning.angle, motion) + k * full_turns(driver.angle, motion)
        if turns.denominator != 1:
            raise MachineError(
                f"gears '{self.name}': '{self.driven}' makes {turns} turns while the main shaft turns once, so the "
                f"motion repeats only every {turns.denominator} turns; choose teeth that give whole turns, or a main "
                f"shaft that turns {turns.denominator} times slower, with this shaft as a gear on it and the "
                f"encoder's ratio 1/{turns.denominator}"
            )
        if not motion.turns_fully and k.denominator != 1:
            angle = substitute([angle], {THETA: _wrapped(motion)})[0]
        half = Vector(cos(0.5 * angle), sin(0.5 * angle)).rotated(*unit_direction(self.phase_rad / 2.0))
        shaft = Rotation(half, angle + self.phase_rad, p, q)
        link = LinkMotion(self.driven, self.driven_at, self.end, self.length_m, shaft.direction, p, q, shaft.angle)
        motion.rotations[self.driven] = shaft
        motion.add_link(link, self.name)
        end = link.end_motion(centre)
        if centre.is_fixed:
            circle = Circle(centre.fixed_position(), self.length_m, half, shaft)
            end = PointMotion(end.position, end.first, end.second, end.speed_squared, end.speed_product, circle)
        motion.add_point(self.end, end, self.name)
        motion.add_point(self.mesh, self._touching_point(motion, line), self.name)

    def _touching_point(self, motion: Motion, line: CentreLine) -> PointMotion:
        start, radius = motion.points[self.at], self.pitch_radii(line.length)[0]
        p, q = line.turning.first, line.turning.second
        return LinkMotion("", self.at, self.mesh, radius, line.direction, p, q).end_motion(start)

    def centre_line(self, motion: Motion) -> CentreLine:
        """Express the line between the axes. Raises MachineError if the distance of the axes is not fixed."""
        one, two = (motion.point(name, self.name) for name in (self.at, self.driven_at))
        if one.is_fixed and two.is_fixed:
            (ox, oy), (ax, ay) = one.fixed_position(), two.fixed_position()
            distance = real.hypot(ax - ox, ay - oy)
            if distance == 0.0:
                raise MachineError(
                    f"gears '{self.name}': '{self.at}' and '{self.driven_at}' are one point; set them apart"
                )
            return CentreLine(distance, Vector.of((ax - ox) / distance, (ay - oy) / distance), _STILL)
        for link in motion.links.values():
            if {link.start, link.end} == {self.at, self.driven_at}:
                direction = link.direction if link.start == self.at else -link.direction
                return CentreLine(link.length, direction, _turning(link, motion))
        raise MachineError(
            f"gears '{self.name}': no link reaches from '{self.at}' to '{self.driven_at}' to keep their distance; fix "
            "both to the ground, or name the two ends of one link"
        )

    def _driver(self, motion: Motion) -> Turning:
        if self.driver is None:
            return _STILL
        if self.driver not in motion.links:
            shaft = motion.rotation(self.driver, self.name)
            motion.fixed_point(self.at, self.name)
            return Turning(shaft.angle, shaft.first, shaft.second)
        link = motion.links[self.driver]
        if self.at not in (link.start, link.end):
            raise MachineError(
                f"gears '{self.name}': '{self.at}' is no end of '{self.driver}', so a gear on that link does not turn "
                f"about it; name '{link.start}' or '{link.end}'"
            )
        return _turning(link, motion)

    def joints(self, motion: Motion) -> tuple[Joint, ...]:
        """Return the turning joint of the driven gear."""
        return (pivot(motion, self.driven, self.driven_at),)

    def balance(self, wrenches: Wrenches) -> None:
        """Solve the tooth force from the driven gear's moment; its axis and the driver bear the reactions."""
        motion = wrenches.motion
        line = self.centre_line(motion)
        to_driver, to_driven = self.pitch_radii(line.length)
        force, moment = wrenches.on(self.driven)
        across = (moment + wrenches.torque_on.pop(self.driven, const(0.0))) * (-1.0 / to_driven)
        outward = -self._driven_sign * real.tan(self.pressure_angle_rad)
        tooth = across * line.direction.turned_left() + (outward * absolute(across)) * line.direction
        axis = -tooth - force
        wrenches.add_reaction(self.mesh, tooth)
        wrenches.add_reaction(self.driven_at, axis)
        wrenches.pull_on_point(self.driven_at, -axis)
        if self.driver in motion.links:
            link = motion.links[self.driver]
            start = motion.points[link.start].position
            lever = motion.points[self.at].position - start + to_driver * line.direction
            wrenches.add_at(link, lever, -tooth)
        elif self.driver is not None:
            wrenches.add_reaction(self.at, tooth)
            wrenches.add_torque(self.driver, -(to_driver * across))


def _turning(link: LinkMotion, motion: Motion) -> Turning:
    return Turning(link_angle(link, motion), link.first, link.second)


def _wrapped(motion: Motion) -> Expr:
    """Express the shaft angle wrapped to half a turn around the middle of a range shorter than a full turn."""
    middle = 0.5 * sum(motion.range_rad)
    theta = THETA - middle
    return atan2(sin(theta), cos(theta)) + middle
