"""Filter between the true torque of the shaft and the reading of its sensor: a low pass, a high pass, or both.

The filter is a sum of modes, one per pole p, since its poles are distinct:

    H(f) = H(0) + sum_i g_i (m_i(f) - 1),   m_i(f) = -p_i / (2 pi i f - p_i)

Each mode follows the input u by xi' = p (xi - u). Over a step h in which u is linear, d = xi - u advances exactly by

    d <- exp(p h) d - (u_1 - u_0) expm1(p h) / (p h)

and the output is H(0) u + sum_i Re(g_i d_i). `TorqueFilter.apply` runs the recursion over an even grid,
`FilterSession` from stamp to stamp. tests/machines/test_torque_filter.py compares with scipy.signal.

References:
    Franklin, G. F., Powell, J. D., Workman, M. L.: Digital Control of Dynamic Systems, 3rd ed., 1998, section 6.3
    (triangle-hold equivalent).
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import ComplexArray, FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.machine.sensors import TorqueSensor

SETTLED = 1e-3
"""Fraction of a wrong initial state that remains after `settling_s`."""


@dataclass(frozen=True)
class TorqueFilter:
    """Filter of a torque sensor; its arguments are those of `TorqueSensor`.

    Attributes:
        low_pass_s: time constant of a first-order low pass [s]; 0 for none.
        low_pass_hz: corner of a low pass instead [Hz]; 0 for none.
        low_pass_order: order of the low pass with this corner: 1, or 2 for a Butterworth filter.
        high_pass_hz: corner of a first-order high pass [Hz]; 0 for none.

    Raises:
        MachineError: for impossible values.

    Examples:
        >>> from textile_twin_core.machine import TorqueFilter
        >>> round(float(abs(TorqueFilter(low_pass_hz=20.0, low_pass_order=2).response(20.0))), 4)
        0.7071
    """

    low_pass_s: float = 0.0
    low_pass_hz: float = 0.0
    low_pass_order: int = 1
    high_pass_hz: float = 0.0

    def __post_init__(self) -> None:
        TorqueSensor(
            low_pass_s=self.low_pass_s,
            low_pass_hz=self.low_pass_hz,
            low_pass_order=self.low_pass_order,
            high_pass_hz=self.high_pass_hz,
        )

    @classmethod
    def of(cls, sensor: TorqueSensor) -> TorqueFilter:
        """Return the filter of a torque sensor."""
        return cls(sensor.low_pass_s, sensor.low_pass_hz, sensor.low_pass_order, sensor.high_pass_hz)

    @property
    def is_identity(self) -> bool:
        """True without a low and a high pass."""
        return not (self.low_pass_s or self.low_pass_hz or self.high_pass_hz)

    @property
    def gain_at_zero(self) -> float:
        """Response H(0) to a constant torque: 0 behind a high pass, else 1."""
        return 0.0 if self.high_pass_hz else 1.0

    @cached_property
    def modes(self) -> tuple[tuple[complex, complex], ...]:
        """Pole [1/s] and weight of each mode; of a pair of conjugates one, with twice its weight."""
        blocking, corner = -2.0 * math.pi * self.high_pass_hz, self._low_pass_rad_s
        if not corner:
            return ((complex(blocking), -1.0 + 0.0j),) if blocking else ()
        if self.low_pass_order == 1:
            poles = [complex(-corner)]
        else:
            poles = [corner * cmath.exp(0.75j * math.pi), corner * cmath.exp(-0.75j * math.pi)]
        numerator = math.prod(-p for p in poles)  # of a low pass with a gain of 1
        if blocking:
            poles.append(complex(blocking))
        out = []
        for p in poles:
            if p.imag < 0.0:
                continue
            residue = numerator * (p if blocking else 1.0) / math.prod(p - q for q in poles if q != p)
            out.append((p, (2.0 if p.imag else 1.0) * residue / -p))
        return tuple(out)

    @property
    def _low_pass_rad_s(self) -> float:
        return 1.0 / self.low_pass_s if self.low_pass_s else 2.0 * math.pi * self.low_pass_hz

    @property
    def settling_s(self) -> float:
        """Time after which less than 1e-3 of a wrong initial state remains [s]; 0 without a filter."""
        return max((math.log(abs(g) * len(self.modes) / SETTLED) / -p.real for p, g in self.modes), default=0.0)

    def response(self, frequency_hz: npt.ArrayLike) -> ComplexArray:
        """Evaluate the complex frequency response at frequencies (n,) or a single one [Hz]."""
        s = 2.0j * math.pi * np.asarray(frequency_hz, dtype=np.float64)
        result: ComplexArray = np.ones_like(s)
        if corner := self._low_pass_rad_s:
            ratio = s / corner
            result /= 1.0 + ratio if self.low_pass_order == 1 else 1.0 + math.sqrt(2.0) * ratio + ratio**2
        if self.high_pass_hz:
            result *= s / (s + 2.0 * math.pi * self.high_pass_hz)
        return result

    def apply(self, period_s: float, values: FloatArray) -> FloatArray:
        """Filter samples on an even grid, exactly for an input that is linear between them.

        The low pass starts at rest at the first value. The high pass starts from the mean of the coming values,
        weighted by its own exponential. Both are linear in the values. After values that are not finite, the low pass
        starts again from the next value; the high pass keeps its mean.

        Args:
            period_s: the grid's step [s].
            values: (n,) or (n, k) true torques, or k columns at once.

        Returns:
            The filtered values, of the same shape; NaN where the input is not finite.
        """
        values = np.asarray(values, dtype=np.float64)
        if self.is_identity or not values.size:
            return values.copy()
        columns = np.ascontiguousarray(values.reshape(values.shape[0], -1))
        poles: ComplexArray = np.array([pole for pole, _ in self.modes])
        weights: ComplexArray = np.array([weight for _, weight in self.modes])
        out = np.empty_like(columns)
        _filter(columns, poles * period_s, weights, self.gain_at_zero, bool(self.high_pass_hz), out)
        return out.reshape(values.shape)

    def session(self) -> FilterSession:
        """Begin a stream of single values."""
        return FilterSession(self)


class FilterSession:
    """Filter of a stream of values with uneven stamps, each interval with its exact exponentials.

    The first value starts all modes at rest, so a high pass starts with an output of zero. The numbers are those of
    `TorqueFilter.apply` on the same samples once both have settled.
    """

    def __init__(self, torque_filter: TorqueFilter) -> None:
        self._modes, self._gain = torque_filter.modes, torque_filter.gain_at_zero
        self.reset()

    def reset(self) -> None:
        """Forget the state; the next value starts the stream again."""
        self._value = math.nan
        self._behind = [0.0j] * len(self._modes)

    @property
    def output(self) -> float:
        """Filtered value at the latest sample; NaN before the first."""
        return self._gain * self._value + sum((g * d).real for (_, g), d in zip(self._modes, self._behind, strict=True))

    def step(self, interval_s: float, value: float) -> float:
        """Advance over an interval in which the input changes linearly to `value`, and return the output at its end.

        Args:
            interval_s: time since the value before [s]; of no account for the first one.
            value: true torque at the end of the interval.
        """
        if math.isnan(self._value):
            self._value = value
            return self.output
        rise = value - self._value
        self._behind = [_advanced(p * interval_s, d, rise) for (p, _), d in zip(self._modes, self._behind, strict=True)]
        self._value = value
        return self.output

    def jump(self, value: float) -> float:
        """Change the input to `value` at once, and return the output after it."""
        if math.isnan(self._value):
            return self.step(0.0, value)
        rise = value - self._value
        self._behind = [d - rise for d in self._behind]
        self._value = value
        return self.output

    def take(self, intervals_s: Iterable[float], values: Iterable[float]) -> list[float]:
        """Take several samples, and return the outputs."""
        return [self.step(interval, value) for interval, value in zip(intervals_s, values, strict=True)]


def _advanced(exponent: complex, behind: complex, rise: float) -> complex:
    """Advance xi - u of a mode over a step with p h = `exponent` in which the input rises linearly."""
    decay = cmath.exp(exponent)
    return decay * behind - rise * _mean_decay(exponent, decay)


def _mean_decay(exponent: complex, decay: complex) -> complex:
    """Evaluate expm1(x) / x for x = `exponent`, exactly near zero, too."""
    if abs(exponent) > 0.5:
        return (decay - 1.0) / exponent
    total = term = 1.0 + 0.0j
    for k in range(2, 16):
        term *= exponent / k
        total += term
    return total


@compiled
def _filter(
    values: FloatArray, exponents: ComplexArray, weights: ComplexArray, gain: float, blocking: bool, out: FloatArray
) -> None:
    """Filter columns on an even grid; with `blocking`, the last mode is that of the high pass."""
    rows, columns = values.shape
    modes = exponents.size
    decays = np.exp(exponents)
    shares = np.ones(modes, np.complex128)
    for m in range(modes):
        if abs(exponents[m]) > 0.5:
            shares[m] = (decays[m] - 1.0) / exponents[m]
        else:
            term = 1.0 + 0.0j
            for k in range(2, 16):
                term *= exponents[m] / k
                shares[m] += term
    behind = np.empty(modes, np.complex128)
    for column in range(columns):
        mean, before = 0.0, np.nan
        if blocking:  # the low pass with the corner of the high pass, backwards from the end
            behind[0] = 0.0
            for row in range(rows - 1, -1, -1):
                value = values[row, column]
                if not np.isfinite(value):
                    continue
                if np.isfinite(before):
                    behind[0] = decays[modes - 1] * behind[0] - (value - before) * shares[modes - 1]
                before = value
            mean = before + behind[0].real
        before = np.nan
        for row in range(rows):
            value = values[row, column]
            if not np.isfinite(value):
                if np.isfinite(before) and blocking:
                    mean = before + behind[modes - 1].real
                before = np.nan
                out[row, column] = np.nan
                continue
            if np.isfinite(before):
                rise = value - before
                for m in range(modes):
                    behind[m] = decays[m] * behind[m] - rise * shares[m]
            else:
                for m in range(modes):
                    behind[m] = 0.0
                if blocking:
                    behind[modes - 1] = mean - value
            before = value
            total = gain * value
            for m in range(modes):
                total += (weights[m] * behind[m]).real
            out[row, column] = total
