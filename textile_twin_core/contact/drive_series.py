"""Taylor series of the driven element's motion, and their range of accuracy."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import by_reference, compiled
from textile_twin_core.contact.polynomials import moved

_RADII = (10.0, 5.0, 20.0, 3.0)
_SHRINK = 0.8
_NEGLIGIBLE = 1e-18


@by_reference
class DriveTerms(NamedTuple):
    """One piece of the drive: x(t) = p(s) + amplitude sin(frequency s + phase), with s = argument(t - start)."""

    start_s: float
    end_s: float
    polynomial: FloatArray
    """p, power coefficients [m]"""
    wave: FloatArray
    """amplitude [m], frequency, phase"""
    argument: FloatArray
    """power coefficients in seconds past start"""


@compiled
def taylor(motion: DriveTerms, time_s: float, span_s: float, order: int) -> FloatArray:
    """Expand x(time + u span) in powers of u [m]: coefficients (order+1,), exact to rounding."""
    result = np.zeros(order + 1)
    inner = _argument(motion, time_s, span_s)
    _compose(motion.polynomial, inner, result)
    if motion.wave[0] != 0.0:
        _add_sine(motion.wave, inner, result)
    return result


@compiled
def _argument(motion: DriveTerms, time_s: float, span_s: float) -> FloatArray:
    """Expand the argument in powers of u, without trailing terms below rounding."""
    inner = moved(motion.argument, time_s - motion.start_s)
    factor = largest = 1.0
    for k in range(inner.size):
        inner[k] *= factor
        factor *= span_s
        largest = abs(inner[k]) if k == 0 else max(largest, abs(inner[k]))
    size = inner.size
    while size > 1 and abs(inner[size - 1]) <= _NEGLIGIBLE * largest:
        size -= 1
    return inner[:size].copy()


@compiled
def _compose(outer: FloatArray, inner: FloatArray, result: FloatArray) -> None:
    """Write outer(inner(u)), by Horner's rule on series truncated at the result's length."""
    known = 1
    result[0] = outer[outer.size - 1]
    for power in range(outer.size - 2, -1, -1):
        longer = min(known + inner.size - 1, result.size)
        for k in range(longer - 1, -1, -1):  # from the last term down, in place
            total = 0.0
            for back in range(min(inner.size, k + 1)):
                if k - back < known:
                    total += inner[back] * result[k - back]
            result[k] = total
        known = longer
        result[0] += outer[power]


@compiled
def _add_sine(wave: FloatArray, inner: FloatArray, result: FloatArray) -> None:
    """Add amplitude sin(frequency inner(u) + phase), with the coupled recurrence of sine and cosine."""
    amplitude, frequency, phase = wave[0], wave[1], wave[2]
    sine, cosine = np.zeros(result.size), np.zeros(result.size)
    angle = frequency * inner[0] + phase
    sine[0], cosine[0] = math.sin(angle), math.cos(angle)
    for k in range(result.size - 1):
        s = c = 0.0
        for power in range(1, min(inner.size, k + 2)):
            slope = frequency * power * inner[power]
            s += slope * cosine[k + 1 - power]
            c -= slope * sine[k + 1 - power]
        sine[k + 1] = s / (k + 1)
        cosine[k + 1] = c / (k + 1)
    for k in range(result.size):
        result[k] += amplitude * sine[k]


@compiled
def reach(motion: DriveTerms, time_s: float, longest_s: float, order: int, error: float) -> float:
    """Compute the span, at most `longest_s`, over which the truncated series is accurate.

    After u^order the truncation error is at most `error` times the distance moved by the element. The bound is Cauchy's
    estimate on a circle `radius` times as large as the step: the motion is bounded by the sum of its parts, and the
    truncated part falls with radius^(order+1). A quintic between noisy samples, whose large terms nearly cancel, needs
    shorter steps than its speed suggests.
    """
    still = motion.polynomial.size == 1
    exact = (motion.polynomial.size - 1) * (motion.argument.size - 1) <= order
    if motion.wave[0] == 0.0 and (still or exact):
        return longest_s
    inner = moved(motion.argument, time_s - motion.start_s)
    outer = moved(motion.polynomial, inner[0])
    span = longest_s
    for _ in range(1000):
        allowed = error * _size(outer, inner, motion.wave, span)
        for radius in _RADII:
            if _size(outer, inner, motion.wave, radius * span) <= allowed * radius ** (order + 1):
                return span
        span *= _SHRINK
    return span


@compiled
def _size(outer: FloatArray, inner: FloatArray, wave: FloatArray, span: float) -> float:
    """Bound the distance from here on the circle of radius `span`."""
    swing = _swing(inner, span)
    return _swing(outer, swing) + abs(wave[0]) * math.expm1(min(abs(wave[1]) * swing, 600.0))


@compiled
def _swing(coefficients: FloatArray, span: float) -> float:
    """Bound c1 s + c2 s^2 + ... on the circle of radius `span`."""
    total = 0.0
    for k in range(coefficients.size - 1, 0, -1):
        total = (total + abs(coefficients[k])) * span
    return total
