"""Motion of a mechanism over the shaft angle: points and links with first and second derivatives.

Every quantity h is a function of the shaft angle theta alone. With its derivatives h' and h'', its time derivatives are
h' omega and h'' omega^2 + h' alpha. The functions are closed-form expressions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, const
from textile_twin_core.expression.real import number_of
from textile_twin_core.mechanism.vector import ZERO, Vector

FULL_TURN = (0.0, 2.0 * math.pi)
"""Range of the shaft angle for machines that rotate fully [rad]."""


class UnknownPartError(MachineError):
    """A group refers to a point or link that no earlier group has made."""


@dataclass(frozen=True)
class Rotation:
    """A turning shaft: its half-angle direction, angle and derivatives with respect to theta.

    The half angle keeps small distances from 0 and 180 degrees exact (sin = 2 s c, cos = (c - s)(c + s)).
    """

    half: Vector
    angle: Expr
    first: Expr
    second: Expr

    @property
    def direction(self) -> Vector:
        """The unit vector at the shaft's angle."""
        c, s = self.half.x, self.half.y
        return Vector((c - s) * (c + s), 2.0 * (s * c))


@dataclass(frozen=True)
class Circle:
    """Path of a crank's end: centre, radius, the half-angle direction of the crank, and the shaft that turns it.

    Groups mounted on the crank use it for their half-angle forms.
    """

    centre: tuple[float, float]
    radius: float
    half: Vector
    shaft: Rotation


@dataclass(frozen=True)
class PointMotion:
    """A point: its position and the derivatives by the shaft's angle.

    Attributes:
        position: position [m].
        first, second: first and second derivative by theta [m].
        speed_squared: |first|^2, in the shortest form that the group knows.
        speed_product: first . second, likewise.
        circle: for a point on a crank.
        along: unit vector, for a point that moves on a line.

    Examples:
        >>> from textile_twin_core.expression import const
        >>> from textile_twin_core.mechanism.motion import PointMotion
        >>> from textile_twin_core.mechanism.vector import Vector
        >>> along = Vector.of(1.0, 0.0)
        >>> PointMotion.sliding(Vector.of(0.2, 0.0), along, const(0.05), const(0.0)).first.x.value
        0.05
    """

    position: Vector
    first: Vector
    second: Vector
    speed_squared: Expr
    speed_product: Expr
    circle: Circle | None = None
    along: Vector | None = None

    @classmethod
    def fixed(cls, x: float, y: float) -> PointMotion:
        """Return a point of the ground."""
        return cls(Vector.of(x, y), ZERO, ZERO, const(0.0), const(0.0))

    @classmethod
    def sliding(cls, position: Vector, along: Vector, first: Expr, second: Expr) -> PointMotion:
        """Return a point that moves on a line, given the derivatives of its distance along the line."""
        return cls(position, first * along, second * along, first * first, first * second, along=along)

    @property
    def is_fixed(self) -> bool:
        """True if the point belongs to the ground."""
        return self.first.is_zero

    def fixed_position(self) -> tuple[float, float]:
        """Return the coordinates of a fixed point [m]."""
        return number_of(self.position.x), number_of(self.position.y)


@dataclass(frozen=True)
class Sliding:
    """A slider's motion in its guide: the derivative of its position along its own direction, and the guide's link.

    `on` is None if the guide is on the ground.
    """

    first: Expr
    on: str | None = None


@dataclass(frozen=True)
class LinkMotion:
    """A link from one point to another: its direction, and the derivatives of its angle by the shaft's angle.

    Attributes:
        name: name of the link.
        start, end: names of its points.
        length: length [m].
        direction: unit vector from start to end.
        first, second: first and second derivative of the link's angle by theta.
        angle: the angle itself [rad], where it is known, as on a turning shaft.
        sliding: where the link slides along its own direction.

    Examples:
        >>> import textile_twin_core as ttc
        >>> ttc.machines.tufting().linkage.solved.links["l2"].length  # [m]
        0.138
    """

    name: str
    start: str
    end: str
    length: float
    direction: Vector
    first: Expr
    second: Expr
    angle: Expr | None = None
    sliding: Sliding | None = None

    def end_motion(self, start: PointMotion) -> PointMotion:
        """Compute the motion of the link's end from that of its start."""
        r, u, p, q = self.length, self.direction, self.first, self.second
        normal = u.turned_left()
        first = start.first + (r * p) * normal
        second = start.second + (r * q) * normal - (r * (p * p)) * u
        if start.is_fixed:
            speed_squared, speed_product = (r * r) * (p * p), (r * r) * (p * q)
        else:
            speed_squared, speed_product = first.dot(first), first.dot(second)
        return PointMotion(start.position + r * u, first, second, speed_squared, speed_product)


@dataclass
class Motion:
    """All points, links and rotations solved so far, by name, in the order of the groups.

    A group reads what stands before it with `point` and `link`, and adds its own with `add_point` and `add_link`.

    Attributes:
        points: points by name.
        links: links by name.
        rotations: turning shafts by name.
        quantities: further results of the groups, such as a pressure angle, by output name.
        range_rad: range of the shaft angle over which the motion is used [rad].

    Examples:
        >>> import textile_twin_core as ttc
        >>> sorted(ttc.machines.tufting().linkage.solved.links)[:2]
        ['l1', 'l2']
    """

    points: dict[str, PointMotion] = field(default_factory=dict)
    links: dict[str, LinkMotion] = field(default_factory=dict)
    rotations: dict[str, Rotation] = field(default_factory=dict)
    quantities: dict[str, Expr] = field(default_factory=dict)
    range_rad: tuple[float, float] = FULL_TURN

    @property
    def turns_fully(self) -> bool:
        """True if the range is a full turn, over which every quantity except an unwrapped angle is periodic."""
        low, high = self.range_rad
        return high - low >= (1.0 - 1e-12) * 2.0 * math.pi

    def point(self, name: str, asked_by: str) -> PointMotion:
        """Return a known point. Raises UnknownPartError if no earlier group or ground point has the name."""
        try:
            return self.points[name]
        except KeyError:
            known = ", ".join(self.points)
            raise UnknownPartError(
                f"group '{asked_by}': no point '{name}' is known before it; known points: {known}"
            ) from None

    def link(self, name: str, asked_by: str) -> LinkMotion:
        """Return a known link. Raises UnknownPartError if no earlier group has it."""
        try:
            return self.links[name]
        except KeyError:
            known = ", ".join(self.links) or "none"
            raise UnknownPartError(
                f"group '{asked_by}': no link '{name}' is known before it; known links: {known}"
            ) from None

    def rotation(self, name: str, asked_by: str) -> Rotation:
        """Return a known turning shaft. Raises MachineError for an unknown name."""
        try:
            return self.rotations[name]
        except KeyError:
            known = ", ".join(self.rotations)
            raise MachineError(f"group '{asked_by}': no shaft '{name}'; known shafts: {known}") from None

    def add_point(self, name: str, point: PointMotion, made_by: str) -> None:
        """Add a new point. Raises MachineError if the name is taken."""
        if name in self.points:
            raise MachineError(f"group '{made_by}': point '{name}' exists already; give it another name")
        self.points[name] = point

    def fixed_point(self, name: str, asked_by: str) -> tuple[float, float]:
        """Return the coordinates [m] of a ground point. Raises MachineError for a point that moves."""
        point = self.point(name, asked_by)
        if not point.is_fixed:
            raise MachineError(f"group '{asked_by}': point '{name}' must be fixed to the ground")
        return point.fixed_position()

    def carrier(self, point: str) -> tuple[LinkMotion, float] | None:
        """Return the link on which a point lies and its distance from the link's start [m].

        This is the last link that ends at the point, such as the rocker after its coupler, or else the first that
        starts there. The result is None for a point of the ground.

        Raises:
            MachineError: for a point that belongs to no link, such as the mesh point of gears.
        """
        if self.points[point].is_fixed:
            return None
        ending = [link for link in self.links.values() if link.end == point]
        if ending:
            return ending[-1], ending[-1].length
        for link in self.links.values():
            if link.start == point:
                return link, 0.0
        raise MachineError(f"point '{point}' is fixed to no link: no force can act there, and nothing be mounted on it")

    def add_link(self, link: LinkMotion, made_by: str) -> None:
        """Add a new link. Raises MachineError if the name is taken."""
        if link.name in self.links:
            raise MachineError(f"group '{made_by}': link '{link.name}' exists already; give it another name")
        self.links[link.name] = link
