"""Prescribed motion of the driven element, in pieces whose Taylor series are known exactly."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from textile_twin_core.arrays import FloatArray


@dataclass(frozen=True)
class Section:
    """One analytic section of a law of motion: x(s) = sum_k polynomial[k] s^k + amplitude sin(frequency s + phase)."""

    polynomial: tuple[float, ...] = (0.0,)
    amplitude: float = 0.0
    frequency: float = 0.0
    phase: float = 0.0

    @property
    def still(self) -> bool:
        """Whether it is a dwell."""
        return len(self.polynomial) == 1 and not self.amplitude

    def value(self, s: float, derivative: int = 0) -> float:
        """The law or its derivative with respect to s."""
        total = 0.0
        for power in range(len(self.polynomial) - 1, derivative - 1, -1):
            total = total * s + self.polynomial[power] * math.perm(power, derivative)
        if self.amplitude:
            angle = self.frequency * s + self.phase + derivative * math.pi / 2
            total += self.amplitude * self.frequency**derivative * math.sin(angle)
        return total


_RADII = (10.0, 5.0, 20.0, 3.0)
IDENTITY = Section((0.0, 1.0))


@dataclass(frozen=True)
class DrivePiece:
    """The driven element between two times: x(t) = section(argument(t - start)), `argument` a polynomial in seconds."""

    start_s: float
    end_s: float
    section: Section
    argument: tuple[float, ...]

    def taylor(self, time_s: float, span_s: float, order: int) -> FloatArray:
        """Coefficients (order+1,) of x(time + u span) in powers of u [m], exact to rounding."""
        result = np.zeros(order + 1)
        if self.section.still:
            result[0] = self.section.polynomial[0]
            return result
        inner = _shift(self.argument, time_s - self.start_s, span_s)
        composed = _compose_polynomial(self.section.polynomial, inner, order)
        result[: composed.size] = composed
        if self.section.amplitude:
            result += self.section.amplitude * _sine_series(self.section, inner, order)
        return result

    def reach_s(self, time_s: float, longest_s: float, order: int, error: float) -> float:
        """How far, at most `longest_s`, the series from here may reach, cut after u^order: its error is at most `error`
        times the way that the element makes.

        By Cauchy's estimate: on a circle `radius` times as large as the step the motion is no larger than the sum
        of its parts' sizes says, and what is cut off falls with radius^(order+1). A quintic between noisy samples,
        whose terms are large and nearly cancel, needs shorter steps than its speed tells.
        """
        section = self.section
        exact = (len(section.polynomial) - 1) * (len(self.argument) - 1) <= order
        if section.still or (exact and not section.amplitude):
            return longest_s
        at, *inner = moved(self.argument, time_s - self.start_s)
        outer = moved(section.polynomial, at)[1:]

        def size(span: float) -> float:
            swing = _size(inner, span)
            sine = abs(section.amplitude) * math.expm1(min(abs(section.frequency) * swing, 600.0))
            return sine + _size(outer, swing)

        reach = longest_s
        while True:
            allowed = error * size(reach)
            if any(size(radius * reach) <= allowed * radius ** (order + 1) for radius in _RADII):
                return reach
            reach *= 0.8

    def state(self, time_s: float) -> tuple[float, float, float]:
        """Position [m], velocity [m/s] and acceleration [m/s^2] at a time."""
        x, v, half_a = self.taylor(time_s, 1.0, 2).tolist()
        return x, v, 2.0 * half_a


def _size(coefficients: Sequence[float], span: float) -> float:
    """Bound of c1 s + c2 s^2 + ... on the circle of radius `span`."""
    total = 0.0
    for coefficient in reversed(coefficients):
        total = (total + abs(coefficient)) * span
    return total


class Drive(Protocol):
    """A prescribed motion that can be cut into pieces, one after the other without a gap in time or position."""

    def pieces(self, start_s: float, end_s: float) -> Iterator[DrivePiece]:
        """The pieces that cover [start, end] in order, the first beginning at start, the last ending at end."""
        ...


def hermite_piece(start_s: float, start: Sequence[float], end_s: float, end: Sequence[float]) -> DrivePiece:
    """The quintic that has the given value, velocity and acceleration at both ends of a time interval."""
    return DrivePiece(start_s, end_s, IDENTITY, quintic(end_s - start_s, start, end))


def quintic(span_s: float, start: Sequence[float], end: Sequence[float]) -> tuple[float, ...]:
    """Coefficients, lowest first, of the quintic in time with value, velocity, acceleration given at both ends."""
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


def moved(polynomial: Sequence[float], offset: float) -> tuple[float, ...]:
    """Coefficients of p(offset + t) in powers of t, by repeated synthetic division."""
    result = list(polynomial)
    for start in range(len(result) - 1):
        for power in range(len(result) - 2, start - 1, -1):
            result[power] += offset * result[power + 1]
    return tuple(result)


def _shift(polynomial: Sequence[float], offset: float, span: float) -> list[float]:
    """Coefficients of p(offset + u span) in powers of u, trailing terms that cannot be told from zero dropped."""
    shifted = list(moved(polynomial, offset))
    factor = 1.0
    for power in range(len(shifted)):
        shifted[power] *= factor
        factor *= span
    floor = 1e-18 * max(abs(c) for c in shifted)
    while len(shifted) > 1 and abs(shifted[-1]) <= floor:
        shifted.pop()
    return shifted


def _compose_polynomial(outer: Sequence[float], inner: Sequence[float], order: int) -> FloatArray:
    """Coefficients of outer(inner(u)), cut after u^order."""
    total = np.array([outer[-1]])
    for coefficient in reversed(outer[:-1]):
        total = np.convolve(total, inner)[: order + 1]
        total[0] += coefficient
    return total


def _sine_series(section: Section, inner: Sequence[float], order: int) -> FloatArray:
    """Coefficients (order+1,) of sin(frequency inner(u) + phase)."""
    w = section.frequency
    sine = [0.0] * (order + 1)
    cosine = [0.0] * (order + 1)
    angle = w * inner[0] + section.phase
    sine[0] = math.sin(angle)
    cosine[0] = math.cos(angle)
    slopes = [w * power * coefficient for power, coefficient in enumerate(inner)][1:]
    for k in range(order):
        s = 0.0
        c = 0.0
        for back, slope in enumerate(slopes[: k + 1]):
            s += slope * cosine[k - back]
            c -= slope * sine[k - back]
        sine[k + 1] = s / (k + 1)
        cosine[k + 1] = c / (k + 1)
    return np.array(sine)
