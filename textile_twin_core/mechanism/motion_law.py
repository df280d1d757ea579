"""Law of motion over one turn of a shaft or cam, in analytic sections, as numbers and as expressions."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.expression import Expr, at_least, atan2, const, cos, select, sin
from textile_twin_core.mechanism.vector import Vector

TURN = 2.0 * math.pi


@dataclass(frozen=True)
class Section:
    """Analytic section of a law of motion: x(s) = sum_k polynomial[k] s^k + amplitude sin(frequency s + phase)."""

    polynomial: tuple[float, ...] = (0.0,)
    amplitude: float = 0.0
    frequency: float = 0.0
    phase: float = 0.0

    def value(self, s: float, derivative: int = 0) -> float:
        """Evaluate the section or its derivative with respect to s."""
        total = 0.0
        for power in range(len(self.polynomial) - 1, derivative - 1, -1):
            total = total * s + self.polynomial[power] * math.perm(power, derivative)
        if self.amplitude:
            angle = self.frequency * s + self.phase + derivative * math.pi / 2
            total += self.amplitude * self.frequency**derivative * math.sin(angle)
        return total

    @cached_property
    def arrays(self) -> tuple[FloatArray, FloatArray]:
        """The polynomial as an array, and amplitude, frequency and phase of the sine as another."""
        return np.array(self.polynomial, dtype=float), np.array([self.amplitude, self.frequency, self.phase])


@dataclass(frozen=True)
class MotionLaw:
    """Position (a length [m] or an angle [rad]) over one turn of the shaft, in analytic sections.

    Section k holds from starts_rad[k] to starts_rad[k+1] (the last one to 2 pi), as a function of the angle past its
    start; the first section starts at 0. Wrapped and unwrapped angles are accepted.
    """

    name: str
    starts_rad: tuple[float, ...]
    sections: tuple[Section, ...]

    def evaluate(self, theta_rad: float, derivative: int = 0) -> float:
        """Evaluate the position at a shaft angle, or its derivative with respect to the angle."""
        angle = theta_rad % TURN
        k = bisect_right(self.starts_rad, angle) - 1
        return self.sections[k].value(angle - self.starts_rad[k], derivative)

    def width(self, k: int) -> float:
        """Return the width of section k [rad]."""
        end = self.starts_rad[k + 1] if k + 1 < len(self.starts_rad) else TURN
        return end - self.starts_rad[k]

    def over(self, direction: Vector) -> tuple[Expr, Expr, Expr]:
        """Express the position and its first and second derivative over the angle of a direction.

        The coefficients of the active section are looked up by a search among the starts, so that the cost is that of
        one section.
        """
        wrapped = atan2(direction.y, direction.x)
        angle = select(at_least(wrapped, 0.0), wrapped, wrapped + TURN)

        def chosen(of: Callable[[Section], float]) -> Expr:
            return _chosen([of(section) for section in self.sections], self.starts_rad, angle)

        past = angle - _chosen(self.starts_rad, self.starts_rad, angle)
        size = max(len(section.polynomial) for section in self.sections)
        powers = [chosen(lambda s, k=k: s.polynomial[k] if k < len(s.polynomial) else 0.0) for k in range(size)]  # type: ignore[misc]
        frequency = chosen(lambda section: section.frequency)
        amplitude = chosen(lambda section: section.amplitude)
        argument = frequency * past + chosen(lambda section: section.phase)
        wave, slope = amplitude * sin(argument), amplitude * frequency * cos(argument)
        return (
            _horner(powers, past) + wave,
            _horner([k * c for k, c in enumerate(powers)][1:], past) + slope,
            _horner([k * (k - 1) * c for k, c in enumerate(powers)][2:], past) - frequency * frequency * wave,
        )


def _chosen(values: Sequence[float], starts: Sequence[float], angle: Expr) -> Expr:
    """Select the value of the section that contains an angle, by bisection."""
    if all(value == values[0] for value in values):
        return const(values[0])
    middle = len(values) // 2
    below = _chosen(values[:middle], starts[:middle], angle)
    return select(at_least(angle, starts[middle]), _chosen(values[middle:], starts[middle:], angle), below)


def _horner(coefficients: Sequence[Expr], at: Expr) -> Expr:
    total = const(0.0)
    for coefficient in reversed(coefficients):
        total = total * at + coefficient
    return total
