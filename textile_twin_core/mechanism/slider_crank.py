"""Slider-crank linkage in half-angle form: rod and slider on a crank, and their derivatives.

With chi from the guide to the crank, a = cos(chi/2) - sin(chi/2) and b = cos(chi/2) + sin(chi/2), the rod's length
minus and plus its start's offset from the guide are L = L0 + r a^2 and M = M0 + r b^2. The rod's reach along the guide
is R = sqrt(L M), and it turns at -r a b / R. The derivative of that, -r (M0 a^2 L - L0 b^2 M) / (2 R^3), keeps full
precision near the change point of equal crank and rod, where L0 or M0 is small.
"""

from __future__ import annotations

from dataclasses import dataclass

from textile_twin_core.expression import Expr, real, sqrt
from textile_twin_core.expression.real import exact, rounded
from textile_twin_core.mechanism.motion import Circle
from textile_twin_core.mechanism.vector import exact_length


@dataclass(frozen=True)
class SliderCrank:
    """A crank on a circle, a rod's length and a guide (point, direction); `sense` +1 forward, -1 backward."""

    circle: Circle
    rod: float
    guide_point: tuple[float, float]
    axis: tuple[float, float]
    sense: float

    @property
    def half_angle_sums(self) -> tuple[Expr, Expr]:
        """The terms a and b."""
        c, s = self._turned_half()
        return c - s, c + s

    def _turned_half(self) -> tuple[Expr, Expr]:
        angle = real.atan2(self.axis[1], self.axis[0]) / 2.0
        gc, gs, half = real.cos(angle), real.sin(angle), self.circle.half
        return gc * half.x + gs * half.y, gc * half.y - gs * half.x

    @property
    def margins(self) -> tuple[float, float]:
        """The constants L0 and M0 [m], rounded once; the centre's offset is its distance to the left of the guide."""
        ax, ay = (exact(v) for v in self.axis)
        (cx, cy), (gx, gy) = self.circle.centre, self.guide_point
        x, y = exact(cx) - exact(gx), exact(cy) - exact(gy)
        offset, reach = (ax * y - ay * x) / exact_length(ax, ay), exact(self.rod) - exact(self.circle.radius)
        return rounded(reach - offset), rounded(reach + offset)

    @property
    def factors(self) -> tuple[Expr, Expr]:
        """The factors L and M [m]; both are positive where the rod reaches the guide."""
        (a, b), (less, more), r = self.half_angle_sums, self.margins, self.circle.radius
        return r * (a * a) + less, r * (b * b) + more

    @property
    def reach(self) -> Expr:
        """Extent of the rod along the guide, with the sign of the branch [m]."""
        less, more = self.factors
        return self.sense * sqrt(less * more)

    def rod_rates(self) -> tuple[Expr, Expr]:
        """Express the first and second derivative of the rod's angle with respect to the crank angle."""
        (a, b), (less0, more0), r = self.half_angle_sums, self.margins, self.circle.radius
        less, more = self.factors
        inverse = 1.0 / self.reach
        bend = more0 * (a * a) * less - less0 * (b * b) * more
        return -r * (a * b * inverse), (-0.5 * r) * (bend * (inverse * (inverse * inverse)))
