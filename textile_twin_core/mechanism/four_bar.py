"""The dyad on a crank with fixed ground: the four-bar linkage in half-angle form, derivatives included.

With phi from the ground line to the crank, c = cos(phi/2), s = sin(phi/2), a = 4 g l1:
P = P0 + a c^2 and Q = Q0 + a s^2 are Heron's factors (2 l2 l3 sin mu = sqrt(P Q) = R), D^2 = Q + (l2 - l3)^2
is the distance of the outer joints squared. The line of the outer joints turns at 1/2 - (g^2 - l1^2) / (2 D^2)
per unit of the crank, and coupler and rocker turn against it at tau (E -+ 1) with E = (l2^2 - l3^2) / D^2,
tau = g l1 sin(phi) / R. Since tau' = g l1 (Q0 c^2 P - P0 s^2 Q) / R^3, neither speed nor acceleration loses
digits near a change point, where P0 or Q0 is small and the textbook forms divide rounding by rounding.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from textile_twin_core.expression import Expr, sqrt
from textile_twin_core.mechanism.motion import Circle


@dataclass(frozen=True)
class Rates:
    """First and second derivatives of two links' angles."""

    first: tuple[Expr, Expr]
    second: tuple[Expr, Expr]


@dataclass(frozen=True)
class FourBar:
    """A crank on a circle, a fixed far joint and the lengths of coupler and rocker; `side` is +1 left, -1 right."""

    circle: Circle
    ground: tuple[float, float]
    coupler: float
    rocker: float
    side: float

    @property
    def ground_length(self) -> float:
        """Distance of the fixed joints [m]."""
        return math.hypot(self.ground[0] - self.circle.centre[0], self.ground[1] - self.circle.centre[1])

    @property
    def half_angle(self) -> tuple[Expr, Expr]:
        """c and s."""
        angle = math.atan2(self.ground[1] - self.circle.centre[1], self.ground[0] - self.circle.centre[0])
        gc, gs, half = math.cos(angle / 2.0), math.sin(angle / 2.0), self.circle.half
        return gc * half.x + gs * half.y, gc * half.y - gs * half.x

    @property
    def heron_constants(self) -> tuple[float, float]:
        """P0 and Q0 [m^2]; their small factors are summed without rounding."""
        g, l1, l2, l3 = self.ground_length, self.circle.radius, self.coupler, self.rocker
        stretched = math.fsum((l2, l3, -l1, -g)) * math.fsum((l2, l3, l1, g))
        folded = math.fsum((g, l3, -l1, -l2)) * math.fsum((g, l2, -l1, -l3))
        return stretched, folded

    @property
    def heron_factors(self) -> tuple[Expr, Expr]:
        """P and Q [m^2]."""
        (c, s), (p0, q0) = self.half_angle, self.heron_constants
        swing = 4.0 * self.ground_length * self.circle.radius
        return swing * (c * c) + p0, swing * (s * s) + q0

    def rates(self) -> Rates:
        """Derivatives of the angles of coupler and rocker with respect to the crank's."""
        g, l1, l2, l3 = self.ground_length, self.circle.radius, self.coupler, self.rocker
        (c, s), (p0, q0) = self.half_angle, self.heron_constants
        stretched, folded = self.heron_factors
        cs = c * s
        inverse_root = 1.0 / sqrt(stretched * folded)
        inverse_distance = 1.0 / (folded + (l2 - l3) ** 2)
        shape = ((l2 - l3) * (l2 + l3)) * inverse_distance
        line = (0.5 * (g - l1) * (g + l1)) * inverse_distance

        tau = (2.0 * self.side * g * l1) * (cs * inverse_root)
        common = 0.5 - line + tau * shape
        growth = (4.0 * g * l1) * (cs * inverse_distance)  # (D^2)' / D^2
        bend = q0 * (c * c) * stretched - p0 * (s * s) * folded
        tau_slope = (self.side * g * l1) * (bend * (inverse_root * (inverse_root * inverse_root)))
        common_slope = line * growth + shape * (tau_slope - tau * growth)
        return Rates((common - tau, common + tau), (common_slope - tau_slope, common_slope + tau_slope))
