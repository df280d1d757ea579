"""Cam and follower: a plate cam that swings or slides a roller or a flat face, after any law of motion."""

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
    """The roller of a conjugate cam, on the same follower: at a place along its link and across it to the left [m]."""

    place_m: tuple[float, float]
    radius_m: float


@dataclass(frozen=True)
class CamContact:
    """Where a cam presses on the follower, relative to the cam's axis, as the cam turns at unit speed.

    point: the roller's centre, or where a flat face touches [m]; surface: where the cam is touched [m]; normal: unit
    vector from the cam to the follower; gives: how the follower's point there moves per unit of lift, or of `lifts`
    -1 against it; radius: of the cam's curvature there [m], positive where it bulges; spare: what vanishes where the
    cam would be undercut.
    """

    point: Vector
    surface: Vector
    normal: Vector
    gives: Vector
    radius: Expr
    spare: Expr
    lifts: float = 1.0

    @property
    def push(self) -> Expr:
        """Work of a unit force of contact per unit of motion away from the cam."""
        return self.normal.dot(self.gives)

    @property
    def pressure_angle(self) -> Expr:
        """From the follower's motion to the normal, counter-clockwise [rad]."""
        return atan2(self.gives.cross(self.normal), self.push)


@dataclass(frozen=True)
class CamFollower(PlainGroup):
    """A cam `cam` on the fixed axis `at`, and its follower: a link that swings about `pivot` or slides in a guide.

    The cam stands at the angle of the shaft `driven_by` plus `phase_rad`; its link reaches from the axis to `mark` on
    its base circle. A swinging follower is a link of `length_m` from the fixed point `pivot` to `end`, on the `side`
    of the line from `at` to `pivot` that is named. A sliding one reaches from `end` by `length_m` along
    `guide_direction` to `tip`; its guide passes the axis at `offset_m`, to the left of its direction. `end` is the
    centre of the roller; with a flat face (`face` "flat") the link of a swinging follower is parallel to the face,
    which lies `offset_m` from the pivot towards the cam, and that of a sliding one square to it.
    The lift [m or rad] is 0 on the base circle and grows away from it, by `strokes` or a `table` over the cam's
    angle. With a `second` roller on a conjugate cam, fixed to the first, the follower is moved both ways, and either
    cam presses as needed; without one nothing holds it on the cam but what is declared, such as a spring.

    Pressure angle and curvature follow from the follower's velocity and acceleration relative to the cam (Norton, Cam
    Design and Manufacturing Handbook, 2009, ch. 7 has them kind by kind). Raises MachineError where the cam would be
    undercut: where a roller is larger than the radius of its centre's path, or a flat face meets a radius below 0.
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
        """The cam's axis, the follower's pivot and the centre of its roller."""
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
        """1 where a swinging follower lifts counter-clockwise."""
        return -1.0 if self.side == "left" else 1.0

    @property
    def _crank(self) -> Crank:
        return Crank(self.cam, self.at, self.mark, self.base_radius_m, self.phase_rad, self.driven_by)

    def solve(self, motion: Motion) -> None:
        """Add cam and follower, their points, pressure angle, radius of curvature and the cam's outline."""
        self._crank.solve(motion)
        cam = motion.links[self.cam]
        p, q = cam.first, cam.second
        lift, slope, bend = self.law.over(cam.direction)
        first, second = slope * p, bend * (p * p) + slope * q
        direction = self._direction(motion, lift)
        if self.tip is not None:
            axis = motion.points[self.at].position
            end = axis + self.offset_m * direction.turned_left() + (self._rest(motion) + lift) * direction
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

    def _rest(self, motion: Motion) -> float:
        """Where the follower stands on the base circle.

        Of a sliding one the way of `end` from the axis along the guide [m]; of a swinging one, at the pivot, the angle
        between arm and axis, with a flat face that between the face's normal and the line of centres [rad].
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
        """Length [m] and angle [rad] of the line from the cam's axis to the pivot."""
        assert self.pivot is not None
        (ox, oy), (cx, cy) = (motion.fixed_point(name, self.name) for name in (self.at, self.pivot))
        if (ox, oy) == (cx, cy):
            raise MachineError(f"cam '{self.name}': '{self.at}' and '{self.pivot}' are one point; set them apart")
        return math.hypot(cx - ox, cy - oy), math.atan2(cy - oy, cx - ox)

    def _direction(self, motion: Motion, lift: Expr) -> Vector:
        """Of the follower's link."""
        if self.guide_direction is not None:
            norm = math.hypot(*self.guide_direction)
            return Vector.of(self.guide_direction[0] / norm, self.guide_direction[1] / norm)
        line, rest, sense = self._centres(motion)[1], self._rest(motion), self._sense
        at_rest = line - sense * (rest + math.pi / 2.0) if self._is_flat else line + math.pi + sense * rest
        return Vector(cos(lift), sense * sin(lift)).rotated(*unit_direction(at_rest))

    def _contacts(self, motion: Motion) -> Iterator[CamContact]:
        """Each contact, the lifting one first."""
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
            bends = bend * moves if self._slides else bend * moves - (slope * slope) * lever
            yield _roller_contact(start + lever, slope * moves, bends, lifts * moves, radius, lifts)

    def _flat_contact(self, motion: Motion, lift: Expr, slope: Expr, bend: Expr) -> CamContact:
        """Of the face's distance from the axis over the direction of its normal (the cam's support function)."""
        link, axis = motion.links[self.follower], motion.points[self.at].position
        if self._slides:
            normal = link.direction
            distance, rate = self.base_radius_m + lift, -slope
            point = distance * normal + rate * normal.turned_left()
            return CamContact(point, point, normal, normal, distance + bend, distance + bend)
        normal = self._sense * link.direction.turned_left()
        arm = motion.points[link.start].position - axis
        swing, swing_rate = self._sense * slope, self._sense * bend
        turning = swing - 1.0  # of the normal against the cam, per angle of the cam
        away, beside = arm.dot(normal), arm.dot(normal.turned_left())
        distance = away - self.offset_m
        rate = swing * beside / turning
        second = (swing_rate * beside - swing * swing * away - rate * swing_rate) / (turning * turning)
        point = distance * normal + rate * normal.turned_left()
        radius = distance + second
        return CamContact(point, point, normal, self._sense * (point - arm).turned_left(), radius, radius)

    def closures(self, motion: Motion) -> tuple[Closure, ...]:
        """The cam must not be undercut, and must press the follower on its way."""
        found = []
        undercut = f"has a cam '{self.cam}' that is undercut"
        remedy = "take a larger base circle, a smaller roller or a longer stroke"
        cuts = "the flat face" if self._is_flat else "the roller"
        for contact in self._contacts(motion):
            scale = self.base_radius_m if self._is_flat else 1.0
            found.append(Closure(f"{cuts} cuts it away", contact.spare, scale, undercut, "it begins", remedy))
            lever = 1.0 if self._slides else self.length_m
            jams, how = f"jams the follower '{self.follower}'", "the pressure angle comes to 90 deg"
            beside = remedy if contact.lifts > 0.0 else "the second roller lies across the cam's axis from the first"
            found.append(Closure(how, contact.push, lever, jams, "it begins", beside))
        return tuple(found)

    def transmission(self, motion: Motion, smallest: Sequence[float]) -> Transmission:
        """By the pressure angle of the first contact, which is a right angle less the transmission angle."""
        angle = next(self._contacts(motion)).pressure_angle
        most = -smallest_value(-angle, motion.range_rad)[1]
        least = smallest_value(angle, motion.range_rad)[1]
        value, radius = smallest[0], self.roller_radius_m
        spare = value if self._is_flat else radius * value / (1.0 - value) if value < 1.0 else math.inf
        return Transmission(min(max(spare, 0.0), self.base_radius_m), (math.pi / 2.0 - most, math.pi / 2.0 - least))

    @property
    def contact_forces(self) -> tuple[ContactForce, ...]:
        """One that is lost where the follower lifts off; of conjugate cams two that take turns."""
        force, lift_off = f"contact_force_{self.follower}", f"{self.follower}_lifts_off"
        if self.second is None:
            return (ContactForce(f"{force}_N", lift_off),)
        return ContactForce(f"{force}_N", lift_off), ContactForce(f"{force}_second_N", f"{lift_off}_second")

    def joints(self, motion: Motion) -> tuple[Joint, ...]:
        """The cam turns about its axis; the follower swings or slides."""
        if self.pivot is not None:
            return pivot(motion, self.cam, self.at), pivot(motion, self.follower, self.pivot)
        x, y = motion.fixed_point(self.at, self.name)
        along = motion.links[self.follower].direction
        ux, uy = along.x.value, along.y.value
        origin = x - self.offset_m * uy, y + self.offset_m * ux
        return pivot(motion, self.cam, self.at), guide(self.follower, origin, (ux, uy))

    def balance(self, wrenches: Wrenches) -> None:
        """The force of contact, without friction, balances the follower along its motion; what is left is borne."""
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
        for told, size, contact in zip(self.contact_forces, needed, contacts, strict=True):
            wrenches.contacts[told.output] = size
            pressed += size * contact.normal
            torque = torque - size * contact.point.cross(contact.normal)
        if not self._is_flat:
            wrenches.reactions[self.end] = needed[0] * contacts[0].normal  # what hangs there too does not change it
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
    centre: Vector, first: Vector, second: Vector, gives: Vector, radius: float, lifts: float
) -> CamContact:
    """Of a roller whose centre has these derivatives by the cam's angle: its path on the cam is run clockwise."""
    along = first - centre.turned_left()
    bends = second + centre - 2.0 * along.turned_left()
    speed = sqrt(along.dot(along))
    normal = (1.0 / speed) * along.turned_left()
    turning = bends.cross(along)
    cubed = speed * speed * speed
    spare = 1.0 - radius * (turning / cubed)
    return CamContact(centre, centre - radius * normal, normal, gives, cubed / turning - radius, spare, lifts)
