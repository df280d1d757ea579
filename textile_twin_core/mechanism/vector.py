"""Plane vectors of expressions."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from textile_twin_core.expression import Expr, const, real
from textile_twin_core.expression.graph import Number, as_expr


@dataclass(frozen=True)
class Vector:
    """A vector of the plane.

    A vector rotated by declared angles stores its source, so that successive rotations combine into one.

    Attributes:
        x, y: components.
        source: vector before its rotation.
        turn: cosine and sine of the rotation.

    Examples:
        >>> from textile_twin_core.mechanism.vector import Vector
        >>> (Vector.of(1.0, 2.0) + Vector.of(0.5, 0.0)).x.value
        1.5
    """

    x: Expr
    y: Expr
    source: Vector | None = field(default=None, compare=False)
    turn: tuple[float, float] = field(default=(1.0, 0.0), compare=False)

    @classmethod
    def of(cls, x: Expr | Number, y: Expr | Number) -> Vector:
        """Build a vector from expressions or numbers."""
        return cls(as_expr(x), as_expr(y))

    def __add__(self, other: Vector) -> Vector:
        return Vector(self.x + other.x, self.y + other.y)

    def __sub__(self, other: Vector) -> Vector:
        return Vector(self.x - other.x, self.y - other.y)

    def __neg__(self) -> Vector:
        return Vector(-self.x, -self.y)

    def __rmul__(self, factor: Expr | Number) -> Vector:
        return Vector(factor * self.x, factor * self.y)

    def dot(self, other: Vector) -> Expr:
        """Compute the scalar product."""
        return self.x * other.x + self.y * other.y

    def cross(self, other: Vector) -> Expr:
        """Compute the z component of the vector product."""
        return self.x * other.y - self.y * other.x

    def turned_left(self) -> Vector:
        """Rotate the vector by +90 degrees."""
        return Vector(-self.y, self.x)

    def rotated(self, cosine: float, sine: float) -> Vector:
        """Rotate the vector by the angle with this cosine and sine."""
        if (cosine, sine) == (1.0, 0.0):
            return self
        source, (c, s) = self.source or self, self.turn
        c, s = c * cosine - s * sine, s * cosine + c * sine
        return Vector(c * source.x - s * source.y, s * source.x + c * source.y, source, (c, s))

    @property
    def is_zero(self) -> bool:
        """True if both components are the constant 0."""
        return self.x is ZERO.x and self.y is ZERO.y


ZERO = Vector(const(0.0), const(0.0))


def unit_direction(angle_rad: float) -> tuple[float, float]:
    """Compute cosine and sine of a declared angle, exact at whole multiples of 90 degrees."""
    if isinstance(angle_rad, real.Symbolic):
        return real.cos(angle_rad), real.sin(angle_rad)
    quarters = angle_rad / (math.pi / 2)
    if abs(quarters) < 1e6 and abs(quarters - round(quarters)) < 1e-15 * max(1.0, abs(quarters)):
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[round(quarters) % 4]
    return math.cos(angle_rad), math.sin(angle_rad)


def exact_length(x: Any, y: Any) -> Any:
    """Compute a vector's length to 60 digits, for differences of nearly equal lengths; accepts symbolic numbers."""
    if isinstance(x, real.Symbolic) or isinstance(y, real.Symbolic):
        return real.hypot(x, y)
    squared, scale = x * x + y * y, 1 << 240
    return Fraction(math.isqrt(squared.numerator * scale * scale // squared.denominator), scale)
