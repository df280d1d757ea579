"""Vector from a crank's end to a fixed pivot in half-angle form, exact where the two nearly coincide.

With phi from the ground line to the crank, c = cos(phi/2), s = sin(phi/2), g the length of the ground line and r that
of the crank, the squared distance is D^2 = (g - r)^2 + 4 g r s^2. In the frame turned by phi/2 from the ground line the
vector from the crank's end to the pivot is ((g - r) c, -(g + r) s). Neither cancels where g is close to r.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from textile_twin_core.expression import Expr, real, square
from textile_twin_core.expression.real import exact, rounded
from textile_twin_core.mechanism.motion import Circle
from textile_twin_core.mechanism.vector import Vector, exact_length

_CLOSE = 0.1


@dataclass(frozen=True)
class CrankPivot:
    """A crank on a circle and a fixed point of the ground [m]."""

    circle: Circle
    ground: tuple[float, float]

    @property
    def _ground_direction(self) -> tuple[float, float]:
        return self.ground[0] - self.circle.centre[0], self.ground[1] - self.circle.centre[1]

    @property
    def ground_length(self) -> float:
        """Distance of the fixed joints [m]."""
        return real.hypot(*self._ground_direction)

    @property
    def exact_lengths(self) -> tuple[Any, Any]:
        """Lengths of ground line and crank as exact fractions [m]."""
        (cx, cy), (gx, gy) = self.circle.centre, self.ground
        return exact_length(exact(gx) - exact(cx), exact(gy) - exact(cy)), exact(self.circle.radius)

    @property
    def half_angle(self) -> tuple[Expr, Expr]:
        """The cosine c and sine s of half the crank angle."""
        x, y = self._ground_direction
        angle = real.atan2(y, x)
        gc, gs, half = real.cos(angle / 2.0), real.sin(angle / 2.0), self.circle.half
        return gc * half.x + gs * half.y, gc * half.y - gs * half.x

    @property
    def rise(self) -> float:
        """Length of the ground line less that of the crank [m]."""
        g, crank = self.exact_lengths
        return rounded(g - crank)

    @property
    def swing(self) -> float:
        """The product 4 g r [m^2]."""
        return 4.0 * self.ground_length * self.circle.radius

    @property
    def apart(self) -> Vector:
        """Vector from the crank's end to the fixed joint [m], free of cancellation."""
        g, crank = self.exact_lengths
        x, y = self._ground_direction
        angle = real.atan2(y, x) / 2.0
        (c, s), middle = self.half_angle, self.circle.half.rotated(real.cos(angle), real.sin(angle))
        along, across = self.rise * c, rounded(g + crank) * s
        return Vector(along * middle.x + across * middle.y, along * middle.y - across * middle.x)

    @property
    def apart_from_ground_line(self) -> Vector:
        """Vector from the crank's end to the fixed joint, in the frame with x along the ground line [m]."""
        (c, s), crank = self.half_angle, self.circle.radius
        return Vector(self.ground_length - crank * (c * c - s * s), (-2.0 * crank) * (c * s))

    @property
    def ground_direction(self) -> tuple[float, float]:
        """Cosine and sine of the ground line's angle."""
        x, y = self._ground_direction
        return x / self.ground_length, y / self.ground_length

    @property
    def ends_nearly_meet(self) -> bool:
        """True if the crank's end comes close to the fixed joint."""
        return abs(self.rise) < _CLOSE * self.ground_length

    @property
    def distance_squared(self) -> Expr:
        """Squared distance D^2 of crank end and fixed joint [m^2]."""
        return self.swing * (square(self.half_angle[1]) + self.rise**2 / self.swing)
