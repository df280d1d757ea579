"""Prescribed motion of the driven element, in pieces with exact Taylor series."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact import drive_series
from textile_twin_core.contact.drive_series import DriveTerms
from textile_twin_core.mechanism.motion_law import Section

IDENTITY = Section((0.0, 1.0))


@dataclass(frozen=True)
class DrivePiece:
    """Motion of the driven element between two times: x(t) = section(argument(t - start)), `argument` a polynomial."""

    start_s: float
    end_s: float
    section: Section
    argument: tuple[float, ...]

    @cached_property
    def motion(self) -> DriveTerms:
        """The piece as arrays."""
        return DriveTerms(
            float(self.start_s), float(self.end_s), *self.section.arrays, np.array(self.argument, dtype=float)
        )

    def taylor(self, time_s: float, span_s: float, order: int) -> FloatArray:
        """Expand x(time + u span) in powers of u [m]: coefficients (order+1,), exact to rounding."""
        return drive_series.taylor(self.motion, time_s, span_s, order)

    def state(self, time_s: float) -> tuple[float, float, float]:
        """Evaluate position [m], velocity [m/s] and acceleration [m/s^2] at a time."""
        x, v, half_a = self.taylor(time_s, 1.0, 2).tolist()
        return x, v, 2.0 * half_a


def quintic(span_s: float, start: Sequence[float], end: Sequence[float]) -> tuple[float, ...]:
    """Compute the coefficients, lowest first, of the quintic with value, velocity and acceleration at both ends."""
    x0, v0, a0 = start
    x1, v1, a1 = end
    h = span_s
    rest_x = x1 - x0 - h * (v0 + 0.5 * h * a0)
    rest_v = h * (v1 - v0 - h * a0)
    rest_a = h * h * (a1 - a0)
    return (
        x0,
        v0,
        0.5 * a0,
        (10.0 * rest_x - 4.0 * rest_v + 0.5 * rest_a) / h**3,
        (-15.0 * rest_x + 7.0 * rest_v - rest_a) / h**4,
        (6.0 * rest_x - 3.0 * rest_v + 0.5 * rest_a) / h**5,
    )
