"""RRR dyad: coupler and rocker, two links with three turning joints (Assur group of class II, first kind)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, const, sqrt
from textile_twin_core.mechanism.group import Closure, check_length
from textile_twin_core.mechanism.motion import LinkMotion, Motion, PointMotion

Side = Literal["left", "right"]


@dataclass(frozen=True)
class RRRDyad:
    """A coupler from point `from_point` and a rocker from point `ground` that meet in the new point `end`.

    `lengths_m` are those of coupler and rocker; `branch` says on which side of the line from
    `from_point` to `ground` the end lies. The branch cannot change while the chain moves.

    The triangle's area comes from the two factors of Heron's formula,
    P = (l2 + l3)^2 - D^2 and Q = D^2 - (l2 - l3)^2 with D the distance of the outer joints,
    so that near a change point nothing cancels that the crank's half angle does not.
    """

    coupler: str
    rocker: str
    from_point: str
    ground: str
    end: str
    lengths_m: tuple[float, float]
    branch: Side = "left"

    def __post_init__(self) -> None:
        for link, length in zip((self.coupler, self.rocker), self.lengths_m, strict=True):
            check_length(length, f"dyad '{self.name}': length of '{link}'")
        if self.branch not in ("left", "right"):
            raise MachineError(f"dyad '{self.name}': branch must be 'left' or 'right', not {self.branch!r}")

    @property
    def name(self) -> str:
        """The group's name in messages."""
        return f"{self.coupler}-{self.rocker}"

    def solve(self, motion: Motion) -> None:
        """Add coupler, rocker and the joint between them."""
        a, c = motion.point(self.from_point, self.name), motion.point(self.ground, self.name)
        l2, l3 = self.lengths_m
        d = c.position - a.position
        stretched, folded = self.heron_factors(a, c)
        root = self.root(a, c)
        half_inverse = 0.5 / self.distance_squared(stretched, folded)
        along = half_inverse * root
        share = half_inverse * (l2 * l2 - l3 * l3)
        normal = d.turned_left()
        u2 = (1.0 / l2) * ((share + 0.5) * d + along * normal)
        u3 = (1.0 / l3) * ((share - 0.5) * d + along * normal)

        double_inverse = 2.0 / root  # 1 / (l2 l3 sin)
        cosine = (0.25 / (l2 * l3)) * (stretched - folded)
        v = c.first - a.first
        p2 = (l3 * double_inverse) * v.dot(u3)
        p3 = (l2 * double_inverse) * v.dot(u2)
        w = c.second - a.second
        a2, a3 = l2 * (p2 * p2), l3 * (p3 * p3)
        q2 = (l3 * double_inverse) * (w.dot(u3) + a2 * cosine - a3)
        q3 = (l2 * double_inverse) * (w.dot(u2) + a2 - a3 * cosine)

        coupler = LinkMotion(self.coupler, self.from_point, self.end, l2, u2, p2, q2)
        rocker = LinkMotion(self.rocker, self.ground, self.end, l3, u3, p3, q3)
        joint = rocker.end_motion(c)
        motion.add_link(coupler, self.name)
        motion.add_link(rocker, self.name)
        motion.add_point(self.end, joint, self.name)

    def root(self, a: PointMotion, c: PointMotion) -> Expr:
        """2 l2 l3 times the sine of the angle from coupler to rocker; its sign is the branch [m^2]."""
        stretched, folded = self.heron_factors(a, c)
        return (1.0 if self.branch == "left" else -1.0) * sqrt(stretched * folded)

    def closures(self, motion: Motion) -> tuple[Closure, ...]:
        """The dyad opens when its outer joints are too far apart or too close."""
        stretched, folded = self.heron_factors(motion.points[self.from_point], motion.points[self.ground])
        scale = sum(self.lengths_m) ** 2
        return (
            Closure(f"'{self.coupler}' and '{self.rocker}' are stretched and too short", stretched, scale),
            Closure(f"'{self.coupler}' and '{self.rocker}' are folded and differ too much", folded, scale),
        )

    def heron_factors(self, a: PointMotion, c: PointMotion) -> tuple[Expr, Expr]:
        """P and Q: both are positive where the dyad closes; P = 0 stretched, Q = 0 folded [m^2].

        On a crank about O with ground OC: P = (l2+l3-l1-g)(l2+l3+l1+g) + 4 g l1 cos^2(phi/2) and
        Q = (g-l1-l2+l3)(g-l1+l2-l3) + 4 g l1 sin^2(phi/2), phi from OC to the crank.
        """
        l2, l3 = self.lengths_m
        if a.circle is None or not c.is_fixed:
            d = c.position - a.position
            distance = sqrt(d.dot(d))
            return (
                ((l2 + l3) - distance) * ((l2 + l3) + distance),
                (distance - abs(l2 - l3)) * (distance + abs(l2 - l3)),
            )
        (cx, cy), (ox, oy) = c.fixed_position(), a.circle.centre
        g, l1 = math.hypot(cx - ox, cy - oy), a.circle.radius
        ground_angle = math.atan2(cy - oy, cx - ox)
        gc, gs = math.cos(ground_angle / 2.0), math.sin(ground_angle / 2.0)
        half = a.circle.half
        cosine, sine = gc * half.x + gs * half.y, gc * half.y - gs * half.x
        stretched = const((l2 + l3 - l1 - g) * (l2 + l3 + l1 + g)) + (4.0 * g * l1) * (cosine * cosine)
        folded = const((g - l1 - l2 + l3) * (g - l1 + l2 - l3)) + (4.0 * g * l1) * (sine * sine)
        return stretched, folded

    def distance_squared(self, stretched: Expr, folded: Expr) -> Expr:
        """D^2 from the smaller-rounding of the two factors [m^2]."""
        l2, l3 = self.lengths_m
        return folded + (l2 - l3) ** 2
