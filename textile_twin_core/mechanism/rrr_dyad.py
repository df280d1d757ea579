"""RRR dyad: coupler and rocker, two links with three turning joints (Assur group of class II, first kind).

Triangle of the code: `a` (from_point) and `c` (ground) are the outer joints, the end is the apex; l2 and l3 are the
lengths of coupler and rocker, u2 and u3 their directions from `a` and `c` to the end. Lengths are in metres, in the
machine's fixed frame. Each `Expr` is a formula over theta, built once per machine and evaluated at each sample:
closed forms need no iteration and have exact derivatives. `check_assembly` raises MachineError where a closure opens.
tests/mechanism/test_hard_cases.py compares with 60 digits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, const, sqrt
from textile_twin_core.mechanism.four_bar import FourBar, Rates
from textile_twin_core.mechanism.group import Closure, PlainGroup, check_length
from textile_twin_core.mechanism.joint import Joint, pivot
from textile_twin_core.mechanism.motion import LinkMotion, Motion, PointMotion, Rotation
from textile_twin_core.mechanism.transmission import Transmission, transmission_angles
from textile_twin_core.mechanism.vector import Vector
from textile_twin_core.mechanism.wrenches import Wrenches

Branch = Literal["left", "right", "left_passing", "right_passing"]


@dataclass(frozen=True)
class RRRDyad(PlainGroup):
    """A coupler and a rocker that meet in a new point.

    A parallelogram or kite on a crank reaches two change points per turn. All links lie in one line there, and the
    motion can continue on two branches. With "left_passing" or "right_passing" it continues smoothly: a parallelogram
    remains a parallelogram ("left_passing"), and an antiparallelogram remains crossed ("right_passing"). The end then
    changes sides at the change points; the named side holds for the crank's half turn to the left of the ground link.
    Joint forces are undetermined at the change points.

    The triangle's area comes from the two factors of Heron's formula, P = (l2 + l3)^2 - D^2 and Q = D^2 - (l2 - l3)^2
    with D the distance of the outer joints. On a crank both come from the half angle (see `four_bar`).

    Attributes:
        coupler: link from `from_point` to `end`.
        rocker: link from `ground` to `end`.
        from_point: an earlier point.
        ground: the point on which the rocker turns.
        end: name of the new point.
        lengths_m: lengths of coupler and rocker [m].
        branch: side of the line from `from_point` to `ground` on which the end lies; it stays the same over the motion.

    Raises:
        MachineError: for lengths that are not positive.

    Examples:
        >>> from textile_twin_core.mechanism import RRRDyad
        >>> RRRDyad("l2", "l3", "A", "C", "B", (0.2, 0.23)).branch
        'left'
    """

    coupler: str
    rocker: str
    from_point: str
    ground: str
    end: str
    lengths_m: tuple[float, float]
    branch: Branch = "left"

    def __post_init__(self) -> None:
        for link, length in zip((self.coupler, self.rocker), self.lengths_m, strict=True):
            check_length(length, f"dyad '{self.name}': length of '{link}'")
        if self.branch not in get_args(Branch):
            known = ", ".join(get_args(Branch))
            raise MachineError(f"dyad '{self.name}': branch must be one of {known}, not {self.branch!r}")

    @property
    def name(self) -> str:
        """The group's name in messages."""
        return f"{self.coupler}-{self.rocker}"

    @property
    def pins(self) -> tuple[str, ...]:
        """The outer joints, and the joint between the links."""
        return self.from_point, self.ground, self.end

    def solve(self, motion: Motion) -> None:
        """Add coupler, rocker and the joint between them."""
        a, c = motion.point(self.from_point, self.name), motion.point(self.ground, self.name)
        self._check_apart(a, c)
        four_bar = self._four_bar(a, c)
        if self._passes and four_bar is None:
            raise MachineError(
                f"dyad '{self.name}': branch '{self.branch}' needs a crank at '{self.from_point}' and a fixed point "
                f"at '{self.ground}'; choose 'left' or 'right'"
            )
        if four_bar is not None and four_bar.is_parallelogram:
            u2, u3 = four_bar.parallel_directions
            shaft, zero = four_bar.circle.shaft, const(0.0)
            rates = Rates((zero, shaft.first), (zero, shaft.second))
        else:
            u2, u3 = self._directions(a, c)
            rates = self._rates(a, c, u2, u3) if four_bar is None else _driven(four_bar.rates(), four_bar.circle.shaft)
        l2, l3 = self.lengths_m
        coupler = LinkMotion(self.coupler, self.from_point, self.end, l2, u2, rates.first[0], rates.second[0])
        rocker = LinkMotion(self.rocker, self.ground, self.end, l3, u3, rates.first[1], rates.second[1])
        end = rocker.end_motion(c)
        if four_bar is not None and four_bar.is_parallelogram:  # later groups may use the rocker as a crank
            end = replace(end, circle=replace(four_bar.circle, centre=c.fixed_position(), radius=l3))
        motion.add_link(coupler, self.name)
        motion.add_link(rocker, self.name)
        motion.add_point(self.end, end, self.name)

    def _check_apart(self, a: PointMotion, c: PointMotion) -> None:
        """Raise MachineError if the outer joints, or the axes of crank and rocker, coincide."""
        if self.from_point == self.ground:
            raise MachineError(f"dyad '{self.name}': from and ground are one point, '{self.ground}'; name two")
        axis = a.fixed_position() if a.is_fixed else None if a.circle is None else a.circle.centre
        if c.is_fixed and axis == c.fixed_position():
            what = f"from '{self.from_point}'" if a.is_fixed else f"the axis about which from '{self.from_point}' turns"
            raise MachineError(
                f"dyad '{self.name}': {what} and ground '{self.ground}' coincide at ({axis[0]:g}, {axis[1]:g}) m;"
                " put them apart"
            )

    def _directions(self, a: PointMotion, c: PointMotion) -> tuple[Vector, Vector]:
        """Express u2 and u3 by the apex over the line d from `a` to `c`: its foot lies at (1 + share) / 2 of d."""
        (l2, l3), four_bar, squared = self.lengths_m, self._four_bar(a, c), self.distance_squared(a, c)
        if four_bar is None:
            share = ((l2 - l3) * (l2 + l3)) / squared
            less, more = 1.0 - share, 1.0 + share
        else:
            less, more = four_bar.shares
        d, frame = c.position - a.position, (1.0, 0.0)
        if four_bar is not None and four_bar.ends_nearly_meet:
            d = four_bar.apart
        elif four_bar is not None:  # in the frame of the ground line d is a function of the crank's half angle alone
            d, frame = four_bar.apart_from_ground_line, four_bar.ground_direction
        along, normal = self.root(a, c) * (1.0 / squared), d.turned_left()
        u2 = ((0.5 / l2) * more) * d + ((0.5 / l2) * along) * normal
        u3 = ((0.5 / l3) * along) * normal - ((0.5 / l3) * less) * d
        return u2.rotated(*frame), u3.rotated(*frame)

    def _four_bar(self, a: PointMotion, c: PointMotion) -> FourBar | None:
        if a.circle is None or not c.is_fixed:
            return None
        try:
            return FourBar(a.circle, c.fixed_position(), *self.lengths_m, self._side, self._passes)
        except MachineError as error:
            raise MachineError(f"dyad '{self.name}': {error}") from None

    @property
    def _side(self) -> float:
        return 1.0 if self.branch.startswith("left") else -1.0

    @property
    def _passes(self) -> bool:
        return self.branch.endswith("passing")

    def _rates(self, a: PointMotion, c: PointMotion, u2: Vector, u3: Vector) -> Rates:
        """Solve the links' rates p and q by theta from a + l2 u2 = c + l3 u3, differentiated once and twice.

        The product of the first derivative with u3 removes the rocker's rate, that with u2 the coupler's.
        """
        l2, l3 = self.lengths_m
        inverse = 2.0 / self.root(a, c)  # 1 / (l2 l3 sin)
        stretched, folded = self.heron_factors(a, c)
        cosine = (0.25 / (l2 * l3)) * (stretched - folded)
        v, w = c.first - a.first, c.second - a.second
        p2 = (l3 * inverse) * v.dot(u3)
        p3 = (l2 * inverse) * v.dot(u2)
        a2, a3 = l2 * (p2 * p2), l3 * (p3 * p3)
        q2 = (l3 * inverse) * (w.dot(u3) + a2 * cosine - a3)
        q3 = (l2 * inverse) * (w.dot(u2) + a2 - a3 * cosine)
        return Rates((p2, p3), (q2, q3))

    def root(self, a: PointMotion, c: PointMotion) -> Expr:
        """Express 2 l2 l3 times the sine of the angle from coupler to rocker; its sign is the branch [m^2]."""
        four_bar = self._four_bar(a, c)
        if four_bar is not None:
            return four_bar.root
        stretched, folded = self.heron_factors(a, c)
        return self._side * sqrt(stretched * folded)

    def closures(self, motion: Motion) -> tuple[Closure, ...]:
        """Require outer joints that are neither too far apart nor too close."""
        stretched, folded = self.heron_factors(motion.points[self.from_point], motion.points[self.ground])
        scale = sum(self.lengths_m) ** 2
        return (
            Closure(f"'{self.coupler}' and '{self.rocker}' are stretched and too short", stretched, scale),
            Closure(f"'{self.coupler}' and '{self.rocker}' are folded and differ too much", folded, scale),
        )

    def transmission(self, motion: Motion, smallest: Sequence[float]) -> Transmission:
        """Return the range of the angle between coupler and rocker, and the distance to the position in one line."""
        stretched, folded = (max(value, 0.0) for value in smallest)
        (l2, l3), whole = self.lengths_m, 4.0 * self.lengths_m[0] * self.lengths_m[1]
        longest, shortest = l2 + l3, abs(l2 - l3)
        from_longest = stretched / (longest + math.sqrt(longest**2 - stretched))
        nearest = math.sqrt(shortest**2 + folded)
        from_shortest = folded / (shortest + nearest) if nearest else 0.0
        four_bar = self._four_bar(motion.points[self.from_point], motion.points[self.ground])
        return Transmission(
            min(from_longest, from_shortest),
            transmission_angles(stretched, folded, whole),
            None if four_bar is None else four_bar.grashof,
            self._passes,
            () if four_bar is None else four_bar.passing_branches,
        )

    def transmission_cosine(self, motion: Motion) -> Expr:
        """Express the cosine of the angle between coupler and rocker."""
        stretched, folded = self.heron_factors(motion.points[self.from_point], motion.points[self.ground])
        return (0.25 / (self.lengths_m[0] * self.lengths_m[1])) * (stretched - folded)

    def joints(self, motion: Motion) -> tuple[Joint, ...]:
        """Return the turning joints of coupler and rocker at the outer joints."""
        return pivot(motion, self.coupler, self.from_point), pivot(motion, self.rocker, self.ground)

    def balance(self, wrenches: Wrenches) -> None:
        """Solve the force between the links from the moments about the outer joints."""
        motion = wrenches.motion
        coupler, rocker = motion.links[self.coupler], motion.links[self.rocker]
        coupler_force, coupler_moment = wrenches.on(self.coupler)
        rocker_force, rocker_moment = wrenches.on(self.rocker)
        inverse = 2.0 / self.root(motion.points[self.from_point], motion.points[self.ground])
        joint = (rocker.length * coupler_moment * inverse) * rocker.direction + (
            coupler.length * rocker_moment * inverse
        ) * coupler.direction
        start = joint - coupler_force
        ground = -joint - rocker_force
        # force of the coupler on all other links, without those between the rocker and later groups at the pin
        wrenches.reactions[self.end] = joint
        wrenches.add_reaction(self.from_point, start)
        wrenches.add_reaction(self.ground, ground)
        wrenches.pull_on_point(self.from_point, -start)
        wrenches.pull_on_point(self.ground, -ground)

    def distance_squared(self, a: PointMotion, c: PointMotion) -> Expr:
        """Express the squared distance D^2 of the outer joints [m^2]."""
        four_bar = self._four_bar(a, c)
        if four_bar is not None:
            return four_bar.distance_squared
        d = c.position - a.position
        return d.dot(d)

    def heron_factors(self, a: PointMotion, c: PointMotion) -> tuple[Expr, Expr]:
        """Express P and Q [m^2]; both are positive where the dyad closes, P = 0 if stretched, Q = 0 if folded."""
        four_bar = self._four_bar(a, c)
        if four_bar is not None:
            return four_bar.heron_factors
        d = c.position - a.position
        distance = sqrt(d.dot(d))
        longest, shortest = sum(self.lengths_m), abs(self.lengths_m[0] - self.lengths_m[1])
        return (longest - distance) * (longest + distance), (distance - shortest) * (distance + shortest)


def _driven(rates: Rates, shaft: Rotation) -> Rates:
    """Convert derivatives with respect to the crank angle to derivatives with respect to theta."""
    p, q = shaft.first, shaft.second
    (p2, p3), (q2, q3) = rates.first, rates.second
    return Rates((p2 * p, p3 * p), (q2 * (p * p) + p2 * q, q3 * (p * p) + p3 * q))
