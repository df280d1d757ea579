"""Four-bar linkage in half-angle form: a dyad on a crank with a fixed ground joint, and its derivatives.

With phi from the ground line to the crank, c = cos(phi/2), s = sin(phi/2), a = 4 g l1: P = P0 + a c^2 and Q = Q0 + a
s^2 are Heron's factors (2 l2 l3 sin mu = sqrt(P Q) = R), and D^2 = Q + (l2 - l3)^2 is the squared distance of the outer
joints. The line of the outer joints turns at l1 (2 g s^2 - (g - l1)) / D^2 per unit of crank angle. Coupler and rocker
turn relative to that line at tau (E -+ 1) with E = (l2^2 - l3^2) / D^2 and tau = g l1 sin(phi) / R.

The derivative tau' = g l1 (Q0 c^2 P - P0 s^2 Q) / R^3 keeps full precision near a change point, where P0 or Q0 is small
and the textbook forms divide rounding errors by each other. The constants of all sums are rounded once, which also
keeps precision where the rods are much longer than the crank.

Where P0 = Q0 = 0 (parallelogram, kite) all links lie in one line twice a turn. The smooth continuation through these
change points has R = +-a c s, which changes sign there instead of touching zero, and tau = +-1/2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from textile_twin_core.errors import MachineError
from textile_twin_core.expression import Expr, const, sqrt, square
from textile_twin_core.expression.real import exact, rounded
from textile_twin_core.mechanism.crank_pivot import CrankPivot
from textile_twin_core.mechanism.motion import Rotation
from textile_twin_core.mechanism.vector import Vector

_SAME = 1e-14


@dataclass(frozen=True)
class Rates:
    """First and second derivatives of the angles of two links."""

    first: tuple[Expr, Expr]
    second: tuple[Expr, Expr]


@dataclass(frozen=True)
class FourBar(CrankPivot):
    """A crank on a circle, a fixed far joint and the lengths of coupler and rocker; `side` is +1 left, -1 right.

    With `passing` the linkage moves smoothly through its change points; `side` then refers to phi between 0 and pi.

    Raises:
        MachineError: for `passing` if the links do not lie in one line twice a turn.
    """

    coupler: float
    rocker: float
    side: float
    passing: bool = False

    def __post_init__(self) -> None:
        if not self.passing:
            return
        if not self.passing_branches:
            raise MachineError(
                "a passing branch needs links that come into one line twice a turn, as a parallelogram (rocker as "
                "long as the crank, coupler as the ground) or a kite (coupler as the crank, rocker as the ground); "
                f"crank, coupler, rocker and ground are {self.circle.radius:g}, {self.coupler:g}, {self.rocker:g} and "
                f"{self.ground_length:g} m: choose 'left' or 'right'"
            )
        if self.side < 0.0 and self._neighbours_equal:
            raise MachineError(
                "on this side the coupler lies folded on the crank and the rocker stands still; choose 'left_passing'"
            )

    @property
    def _opposite_sides_equal(self) -> bool:
        return _same(self.rocker, self.circle.radius) and _same(self.coupler, self.ground_length)

    @property
    def _neighbours_equal(self) -> bool:
        return _same(self.coupler, self.circle.radius) and _same(self.rocker, self.ground_length)

    @property
    def passing_branches(self) -> tuple[str, ...]:
        """Branches that move smoothly through change points; empty if the links lie in one line only once a turn."""
        if self._neighbours_equal:
            return ("left_passing",)
        return ("left_passing", "right_passing") if self._opposite_sides_equal else ()

    @property
    def is_parallelogram(self) -> bool:
        """True if the rocker stays parallel to the crank over the whole turn."""
        return self.passing and self.side > 0.0 and self._opposite_sides_equal

    @property
    def parallel_directions(self) -> tuple[Vector, Vector]:
        """Directions of coupler and rocker of a parallelogram."""
        x, y = self._ground_direction
        crank = Rotation(self.circle.half, self.circle.shaft.angle, const(1.0), const(0.0))
        return Vector.of(x / self.ground_length, y / self.ground_length), crank.direction

    @property
    def grashof(self) -> str:
        """Grashof class of the linkage; a difference within rounding counts as a change point."""
        lengths = {
            "crank-rocker": self.circle.radius,
            "double-rocker": self.coupler,
            "rocker-crank": self.rocker,
            "double-crank": self.ground_length,
        }
        shortest, *middle, longest = sorted(lengths.values())
        surplus = math.fsum((*middle, -shortest, -longest))
        if abs(surplus) <= _SAME * longest:
            return "change point"
        if surplus < 0.0:
            return "triple-rocker"
        return min(lengths, key=lambda name: lengths[name])

    @property
    def _lengths(self) -> tuple[Any, Any, Any, Any]:
        """Exact lengths of ground, crank, coupler and rocker [m]; their differences vanish near change points."""
        return *self.exact_lengths, exact(self.coupler), exact(self.rocker)

    @property
    def shares(self) -> tuple[Expr, Expr]:
        """The factors 1 - E and 1 + E, each (D^2 -+ (l2^2 - l3^2)) / D^2."""
        g, l1, l2, l3 = self._lengths
        swing, inverse = self.swing, self.swing / self.distance_squared
        less, more = (rounded((g - l1) ** 2 + sign * (l2**2 - l3**2)) for sign in (-1, 1))
        squared = square(self.half_angle[1])
        return (squared + less / swing) * inverse, (squared + more / swing) * inverse

    @property
    def heron_constants(self) -> tuple[float, float]:
        """The constants P0 and Q0 [m^2], rounded once; their factors vanish near change points."""
        if self.passing:
            return 0.0, 0.0
        g, l1, l2, l3 = self._lengths
        return rounded((l2 + l3 - l1 - g) * (l2 + l3 + l1 + g)), rounded((g + l3 - l1 - l2) * (g + l2 - l1 - l3))

    @property
    def heron_factors(self) -> tuple[Expr, Expr]:
        """Heron's factors P and Q [m^2]."""
        (c, s), (p0, q0) = self.half_angle, self.heron_constants
        swing = self.swing
        return swing * (c * c + p0 / swing), swing * (s * s + q0 / swing)

    @property
    def root(self) -> Expr:
        """The root R [m^2]; its sign is the branch."""
        if self.passing:
            c, s = self.half_angle
            return (self.side * self.swing) * (c * s)
        stretched, folded = self.heron_factors
        return self.side * sqrt(stretched * folded)

    def _relative_rate(self) -> tuple[Expr, Expr]:
        """The rate tau and its derivative with respect to the crank angle."""
        if self.passing:
            return const(self.side * 0.5), const(0.0)
        swing = self.side * self.ground_length * self.circle.radius
        (c, s), (p0, q0) = self.half_angle, self.heron_constants
        stretched, folded = self.heron_factors
        inverse = 1.0 / sqrt(stretched * folded)
        bend = q0 * (c * c) * stretched - p0 * (s * s) * folded
        return (2.0 * swing) * (c * s * inverse), swing * (bend * (inverse * (inverse * inverse)))

    def rates(self) -> Rates:
        """Derivatives of the angles of coupler and rocker with respect to the crank angle."""
        l1, l2, l3, g, rise = self.circle.radius, self.coupler, self.rocker, self.ground_length, self.rise
        (c, s), (less, more), swing = self.half_angle, self.shares, self.swing
        inverse = swing / self.distance_squared
        line = 0.5 * ((s * s - 2.0 * l1 * rise / swing) * inverse)
        tau, tau_slope = self._relative_rate()
        growth = c * s * inverse  # (D^2)' / D^2
        bend = growth * (inverse * (0.5 * rise * (g + l1) / swing - ((l2 - l3) * (l2 + l3) / swing) * tau))
        if l2 >= l3:  # E >= 0: the smaller share belongs to the coupler and is not lost beside the larger one
            first, second = line - tau * less, bend - tau_slope * less
            return Rates((first, first + 2.0 * tau), (second, second + 2.0 * tau_slope))
        first, second = line + tau * more, bend + tau_slope * more
        return Rates((first - 2.0 * tau, first), (second - 2.0 * tau_slope, second))


def _same(a: float, b: float) -> bool:
    """Return whether two lengths differ by no more than the rounding of coordinates."""
    return abs(a - b) <= _SAME * max(a, b)
