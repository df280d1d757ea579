"""Cam and follower: a plate cam moves a roller or a flat face, which swings or slides, by any law of motion."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, at_least, atan2, const, cos, select, sin, sqrt
from textile_twin_core.mechanism.crank import Crank
from textile_twin_core.mechanism.extremes import smallest_value
from textile_twin_core.mechanism.group import MAIN_SHAFT, Closure, ContactForce, PlainGroup, check_finite, check_length
from textile_twin_core.mechanism.joint import Joint, guide, pivot
from textile_twin_core.mechanism.law_strokes import Stroke, law_of_strokes
from textile_twin_core.mechanism.law_table import LiftTable
from textile_twin_core.mechanism.motion import LinkMotion, Motion, PointMotion, Sliding
from textile_twin_core.mechanism.motion_law import MotionLaw
from textile_twin_core.mechanism.transmission import Transmission
from textile_twin_core.mechanism.vector import Vector, unit_direction
from textile_twin_core.mechanism.wrenches import Wrenches


@dataclass(frozen=True)
class SecondRoller:
    """Roller of a conjugate cam on the same follower, by its position along the link and across it to the left [m]."""

    place_m: tuple[float, float]
    radius_m: float


@dataclass(frozen=True)
class CamContact:
    """Contact of cam and follower in the frame of the cam's axis, with the cam at unit speed.

    Attributes:
        point: centre of the roller, or contact point of a flat face [m].
        surface: contact point on the cam [m].
        normal: unit vector from the cam to the follower.
        velocity: velocity of the follower's point per unit of lift; reversed where `lifts` is -1.
        radius: radius of curvature of the cam [m]; positive where the cam is convex.
        margin: margin against undercutting; 0 at its limit.
        lifts: +1 for the roller that lifts the follower, -1 for the one that returns it.
    """

    point: Vector
    surface: Vector
    normal: Vector
    velocity: Vector
    radius: Expr
    margin: Expr
    lifts: float = 1.0

    @property
    def push(self) -> Expr:
        """Work of a unit contact force per unit of motion away from the cam."""
        return self.normal.dot(self.velocity)

    @property
    def pressure_angle(self) -> Expr:
        """Angle from the follower's motion to the normal, counter-clockwise [rad]."""
        return atan2(self.velocity.cross(self.normal), self.push)


@dataclass(frozen=True)
class CamFollower(PlainGroup):
    """A cam `cam` on the fixed axis `at`, and a follower that swings about `pivot` or slides in a guide.

    The cam's angle is that of the shaft `driven_by` plus `phase_rad`. The cam's link reaches from the axis to `mark` on
    its base circle. The point `end` is the centre of the roller.

    A swinging follower is a link of `length_m` from the fixed point `pivot` to `end`, on the named `side` of the line
    from `at` to `pivot`. With a flat face (`face` "flat") the link is parallel to the face, which lies `offset_m` from
    the pivot towards the cam.

    A sliding follower reaches from `end` by `length_m` along `guide_direction` to `tip`. Its guide passes the axis at
    `offset_m`, to the left of its direction. A flat face is perpendicular to the link.

    The lift [m or rad] is 0 on the base circle and positive away from it; `strokes` or a `table` give it over the cam's
    angle. A `second` roller on a conjugate cam, fixed to the first cam, returns the follower, and either cam carries
    the load. With one roller, only declared loads such as a spring press the follower onto the cam.

    Pressure angle and curvature follow from the follower's velocity and acceleration relative to the cam.

    Raises:
        MachineError: where the cam is undercut, that is, where a roller is larger than the radius of its centre's path
            or the radius under a flat face is negative.

    References:
        Norton, Cam Design and Manufacturing Handbook, 2nd ed. 2009, chapter 7: the same quantities for each kind of
        cam.
    """

    cam: str
    follower: str
    at: str
    mark: str
    end: str
    base_radius_m: float
    length_m: float
    strokes: tuple[Stroke, ...] = ()
    table: LiftTable | None = None
    pivot: str | None = None
    side: Literal["left", "right"] = "left"
    guide_direction: tuple[float, float] | None = None
    tip: str | None = None
    offset_m: float = 0.0
    face: Literal["roller", "flat"] = "roller"
    roller_radius_m: float = 0.0
    second: SecondRoller | None = None
    phase_rad: float = 0.0
    driven_by: str = MAIN_SHAFT

    def __post_init__(self) -> None:
        what = f"cam '{self.name}'"
        check_length(self.base_radius_m, f"{what}: base_radius_m")
        check_length(self.length_m, f"{what}: length_m")
        check_finite(self.offset_m, f"{what}: offset_m")
        if (self.pivot is None) == (self.guide_direction is None) or self._slides != (self.tip is not None):
            raise MachineError(f"{what}: give a pivot, for a follower that swings, or guide_direction and tip")
        if self.guide_direction is not None and not 0.0 < math.hypot(*self.guide_direction) < math.inf:
            raise MachineError(f"{what}: guide_direction must be a finite vector that is not zero")
        if not 0.0 <= self.roller_radius_m < math.inf or (self._is_flat and self.roller_radius_m > 0.0):
            raise MachineError(f"{what}: roller_radius_m must be 0 (an edge) or a length, and left out of a flat face")
        if self.second is not None:
            check_length(self.second.radius_m, f"{what}: radius_m of the second roller")
            if self._is_flat:
                raise MachineError(f"{what}: a second roller needs a first one, not a flat face")
        if (self.table is None) == (not self.strokes):
            raise MachineError(f"{what}: give either strokes or a table")
        _ = self.law

    @property
    def name(self) -> str:
        """The group's name in messages."""
        return f"{self.cam}-{self.follower}"

    @property
    def pins(self) -> tuple[str, ...]:
        """Axis of the cam, pivot of the follower and centre of its roller."""
        return (self.at, *(() if self.pivot is None else (self.pivot,)), *(() if self._is_flat else (self.end,)))

    @cached_property
    def law(self) -> MotionLaw:
        """The lift over the cam's angle."""
        try:
            return law_of_strokes(self.strokes) if self.table is None else self.table.law
        except MachineError as error:
            raise MachineError(f"cam '{self.name}': {error}") from None

    @property
    def _slides(self) -> bool:
        return self.pivot is None

    @property
    def _is_flat(self) -> bool:
        return self.face == "flat"

    @property
    def _sense(self) -> float:
        """+1 where a swinging follower lifts counter-clockwise, -1 otherwise."""
        return -1.0 if self.side == "left" else 1.0

    @property
    def _crank(self) -> Crank:
        return Crank(self.cam, self.at, self.mark, self.base_radius_m, self.phase_rad, self.driven_by)

    def solve(self, motion: Motion) -> None:
        """Add cam and follower, their points, the pressure angle, the radius of curvature and the cam's outline."""
        self._crank.solve(motion)
        cam = motion.links[self.cam]
        p, q = cam.first, cam.second
        lift, slope, bend = self.law.over(cam.direction)
        first, second = slope * p, bend * (p * p) + slope * q
        direction = self._direction(motion, lift)
        if self.tip is not None:
            axis = motion.points[self.at].position
            end = axis + self.offset_m * direction.turned_left() + (self._base_position(motion) + lift) * direction
            motion.add_point(self.end, PointMotion.sliding(end, direction, first, second), self.name)
            tip = PointMotion.sliding(end + self.length_m * direction, direction, first, second)
            zero = const(0.0)
            slides = Sliding(first)
            link = LinkMotion(self.follower, self.end, self.tip, self.length_m, direction, zero, zero, sliding=slides)
            motion.add_point(self.tip, tip, self.name)
        else:
            assert self.pivot is not None
            turning = self._sense * first, self._sense * second
            link = LinkMotion(self.follower, self.pivot, self.end, self.length_m, direction, *turning)
            motion.add_point(self.end, link.end_motion(motion.points[self.pivot]), self.name)
        motion.add_link(link, self.name)
        for contact, ending in zip(self._contacts(motion), ("", "_second"), strict=False):
            motion.quantities |= {
                f"pressure_angle_{self.follower}{ending}_rad": contact.pressure_angle,
                f"curvature_radius_{self.cam}{ending}_m": contact.radius,
                f"outline_{self.cam}{ending}_x_m": cam.direction.dot(contact.surface),
                f"outline_{self.cam}{ending}_y_m": cam.direction.cross(contact.surface),
            }

    def _base_position(self, motion: Motion) -> float:
        """Compute the follower's position on the base circle.

        For a sliding follower: the distance of `end` from the axis along the guide [m]. For a swinging follower: the
        angle at the pivot between arm and cam axis; with a flat face, the angle between the face's normal and the line
        of centres [rad].
        """
        reach = self.base_radius_m + self.roller_radius_m
        if self.pivot is None:
            if abs(self.offset_m) >= reach and not self._is_flat:
                raise MachineError(f"cam '{self.name}': offset_m must be smaller than base circle and roller together")
            return reach if self._is_flat else math.sqrt((reach - self.offset_m) * (reach + self.offset_m))
        distance = self._centres(motion)[0]
        if self._is_flat:
            share = (reach + self.offset_m) / distance
        else:
            share = (self.length_m**2 + distance**2 - reach**2) / (2.0 * self.length_m * distance)
        if not -1.0 < share < 1.0:
            raise MachineError(f"cam '{self.name}': the follower cannot lie on the base circle; change its lengths")
        return math.acos(share)

    def _centres(self, motion: Motion) -> tuple[float, float]:
        """Compute length [m] and angle [rad] of the line from the cam's axis to the pivot."""
        assert self.pivot is not None
        (ox, oy), (cx, cy) = (motion.fixed_point(name, self.name) for name in (self.at, self.pivot))
        if (ox, oy) == (cx, cy):
            raise MachineError(f"cam '{self.name}': '{self.at}' and '{self.pivot}' are one point; set them apart")
        return math.hypot(cx - ox, cy - oy), math.atan2(cy - oy, cx - ox)

    def _direction(self, motion: Motion, lift: Expr) -> Vector:
        """Express the direction of the follower's link at a lift."""
        if self.guide_direction is not None:
            norm = math.hypot(*self.guide_direction)
            return Vector.of(self.guide_direction[0] / norm, self.guide_direction[1] / norm)
        line, base, sense = self._centres(motion)[1], self._base_position(motion), self._sense
        on_base = line - sense * (base + math.pi / 2.0) if self._is_flat else line + math.pi + sense * base
        return Vector(cos(lift), sense * sin(lift)).rotated(*unit_direction(on_base))

    def _contacts(self, motion: Motion) -> Iterator[CamContact]:
        """Yield each contact, first the one that lifts the follower."""
        cam, link = motion.links[self.cam], motion.links[self.follower]
        lift, slope, bend = self.law.over(cam.direction)
        if self._is_flat:
            yield self._flat_contact(motion, lift, slope, bend)
            return
        start = motion.points[link.start].position - motion.points[self.at].position
        rollers = [((0.0 if self._slides else self.length_m, 0.0), self.roller_radius_m, 1.0)]
        if self.second is not None:
            rollers.append((self.second.place_m, self.second.radius_m, -1.0))
        for (along, across), radius, lifts in rollers:
            lever = along * link.direction + across * link.direction.turned_left()
            moves = link.direction if self._slides else self._sense * lever.turned_left()
            bend_vector = bend * moves if self._slides else bend * moves - (slope * slope) * lever
            yield _roller_contact(start + lever, slope * moves, bend_vector, lifts * moves, radius, lifts)

    def _flat_contact(self, motion: Motion, lift: Expr, slope: Expr, bend: Expr) -> CamContact:
        """Locate the contact of a flat face by the support function of the cam.

        The support function is the distance of the face from the axis, over the direction of its normal.
        """
        link, axis = motion.links[self.follower], motion.points[self.at].position
        if self._slides:
            normal = link.direction
            distance, rate = self.base_radius_m + lift, -slope
            point = distance * normal + rate * normal.turned_left()
            return CamContact(point, point, normal, normal, distance + bend, distance + bend)
        normal = self._sense * link.direction.turned_left()
        arm = motion.points[link.start].position - axis
        swing, swing_rate = self._sense * slope, self._sense * bend
        turning = swing - 1.0  # rate of the normal relative to the cam, per unit of cam angle
        away, beside = arm.dot(normal), arm.dot(normal.turned_left())
        distance = away - self.offset_m
        rate = swing * beside / turning
        second = (swing_rate * beside - swing * swing * away - rate * swing_rate) / (turning * turning)
        point = distance * normal + rate * normal.turned_left()
        radius = distance + second
        return CamContact(point, point, normal, self._sense * (point - arm).turned_left(), radius, radius)

    def closures(self, motion: Motion) -> tuple[Closure, ...]:
        """Require a cam without undercut and a pressure angle below 90 degrees."""
        found = []
        undercut = f"has a cam '{self.cam}' that is undercut"
        remedy = "take a larger base circle, a smaller roller or a longer stroke"
        cuts = "the flat face" if self._is_flat else "the roller"
        for contact in self._contacts(motion):
            scale = self.base_radius_m if self._is_flat else 1.0
            found.append(Closure(f"{cuts} cuts it away", contact.margin, scale, undercut, "it begins", remedy))
            lever = 1.0 if self._slides else self.length_m
            jams, how = f"jams the follower '{self.follower}'", "the pressure angle comes to 90 deg"
            beside = remedy if contact.lifts > 0.0 else "the second roller lies across the cam's axis from the first"
            found.append(Closure(how, contact.push, lever, jams, "it begins", beside))
        return tuple(found)

    def transmission(self, motion: Motion, smallest: Sequence[float]) -> Transmission:
        """Take the transmission angle as a right angle less the pressure angle of the first contact."""
        angle = next(self._contacts(motion)).pressure_angle
        largest_angle = -smallest_value(-angle, motion.range_rad)[1]
        smallest_angle = smallest_value(angle, motion.range_rad)[1]
        value, radius = smallest[0], self.roller_radius_m
        margin = value if self._is_flat else radius * value / (1.0 - value) if value < 1.0 else math.inf
        return Transmission(
            min(max(margin, 0.0), self.base_radius_m), (math.pi / 2.0 - largest_angle, math.pi / 2.0 - smallest_angle)
        )

    @property
    def contact_forces(self) -> tuple[ContactForce, ...]:
        """One force, lost where the follower lifts off; with conjugate cams two forces that alternate."""
        force, lift_off = f"contact_force_{self.follower}", f"{self.follower}_lifts_off"
        if self.second is None:
            return (ContactForce(f"{force}_N", lift_off),)
        return ContactForce(f"{force}_N", lift_off), ContactForce(f"{force}_second_N", f"{lift_off}_second")

    def transmission_cosine(self, motion: Motion) -> Expr:
        """Express the sine of the pressure angle of the first contact."""
        return sin(next(self._contacts(motion)).pressure_angle)

    def joints(self, motion: Motion) -> tuple[Joint, ...]:
        """Return the turning joint of the cam and the turning or sliding joint of the follower."""
        if self.pivot is not None:
            return pivot(motion, self.cam, self.at), pivot(motion, self.follower, self.pivot)
        x, y = motion.fixed_point(self.at, self.name)
        along = motion.links[self.follower].direction
        ux, uy = along.x.value, along.y.value
        origin = x - self.offset_m * uy, y + self.offset_m * ux
        return pivot(motion, self.cam, self.at), guide(self.follower, origin, (ux, uy))

    def balance(self, wrenches: Wrenches) -> None:
        """Solve the frictionless contact force along the follower's motion, and the reactions of pivot or guide."""
        motion = wrenches.motion
        along = motion.links[self.follower].direction
        (cam_force, cam_moment), (force, moment) = wrenches.on(self.cam), wrenches.on(self.follower)
        load = force.dot(along) if self._slides else self._sense * moment
        contacts = list(self._contacts(motion))
        needed = [-(contact.lifts * load) / contact.push for contact in contacts]
        if self.second is not None:
            first, zero = at_least(needed[0], 0.0), const(0.0)
            needed = [select(first, needed[0], zero), select(first, zero, needed[1])]
        pressed = Vector.of(0.0, 0.0)
        torque = cam_moment
        for pressing, size, contact in zip(self.contact_forces, needed, contacts, strict=True):
            wrenches.contacts[pressing.output] = size
            pressed += size * contact.normal
            torque = torque - size * contact.point.cross(contact.normal)
        if not self._is_flat:
            wrenches.reactions[self.end] = needed[0] * contacts[0].normal  # unchanged by later links on this point
        if self.pivot is not None:
            wrenches.add_reaction(self.pivot, -pressed - force)
        else:
            wrenches.guide_reactions[self.follower] = -(pressed + force).dot(along.turned_left())
            lever = motion.points[self.end].position - motion.points[self.at].position
            for size, contact in zip(needed, contacts, strict=True):
                moment += size * (contact.point - lever).cross(contact.normal)
            wrenches.transmitted[self.follower] = -moment
        wrenches.add_reaction(self.at, pressed - cam_force)
        wrenches.add_torque(self.driven_by, torque)


def _roller_contact(
    centre: Vector, first: Vector, second: Vector, velocity: Vector, radius: float, lifts: float
) -> CamContact:
    """Locate the contact of a roller from the derivatives of its centre, whose path on the cam runs clockwise."""
    along = first - centre.turned_left()
    bend_vector = second + centre - 2.0 * along.turned_left()
    speed = sqrt(along.dot(along))
    normal = (1.0 / speed) * along.turned_left()
    turning = bend_vector.cross(along)
    cubed = speed * speed * speed
    margin = 1.0 - radius * (turning / cubed)
    return CamContact(centre, centre - radius * normal, normal, velocity, cubed / turning - radius, margin, lifts)
