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

from textile_twin_core.arrays import BoolArray, ComplexArray, FloatArray
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
    def is_smooth(self) -> bool:
        """True with a low pass, whose output never jumps."""
        return bool(self.low_pass_s or self.low_pass_hz)

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

    @property
    def shortest_s(self) -> float:
        """Time constant of the quickest mode [s]; infinite without a filter."""
        return min((1.0 / abs(pole) for pole, _ in self.modes), default=math.inf)

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
        rows = np.ascontiguousarray(values.reshape(values.shape[0], -1).T)
        out = np.empty_like(rows)
        poles, weights = self._modes_in_arrays
        decays = np.exp(poles * period_s)
        shares: ComplexArray = np.array([_mean_decay(p * period_s) for p, _ in self.modes])
        _filter(rows, decays, shares, weights, self.gain_at_zero, bool(self.high_pass_hz), out)
        return out.T.reshape(values.shape)

    def apply_to_cubics(self, step_s: FloatArray, cubics: FloatArray, gap: BoolArray) -> FloatArray:
        """Filter a piecewise cubic function of time, exactly; the function may jump from a piece to the next.

        It starts as `apply` does. Behind a gap, the low pass starts again; the high pass keeps its mean.

        Args:
            step_s: (p,) lengths of the pieces [s].
            cubics: (4, p) torque at the start and the end of each piece, and its slopes there.
            gap: (p,) true for pieces in which the function is unknown.

        Returns:
            (4, p) values and slopes of the filtered function, in the same order.
        """
        if self.is_identity:
            return cubics
        out = np.empty_like(cubics)
        poles, weights = self._modes_in_arrays
        _filter_cubics(step_s, cubics, gap, poles, weights, self.gain_at_zero, bool(self.high_pass_hz), out)
        return out

    @property
    def _modes_in_arrays(self) -> tuple[ComplexArray, ComplexArray]:
        poles: ComplexArray = np.array([pole for pole, _ in self.modes])
        weights: ComplexArray = np.array([weight for _, weight in self.modes])
        return poles, weights

    def session(self) -> FilterSession:
        """Begin a stream of single values."""
        return FilterSession(self)


class FilterSession:
    """Filter of a stream of values with uneven stamps, each interval with its exact exponentials.

    The first value starts all modes at rest, so a high pass starts with an output of zero. The numbers are those of
    `TorqueFilter.apply` on the same samples once both have settled.

    Attributes:
        value: input at the latest sample; NaN before the first.
        behind: state of each mode less the input there.
    """

    def __init__(self, torque_filter: TorqueFilter) -> None:
        self._filter, self._modes = torque_filter, torque_filter.modes
        self.reset()

    def reset(self) -> None:
        """Forget the state; the next value starts the stream again."""
        self.value = math.nan
        self.behind: tuple[complex, ...] = (0.0j,) * len(self._modes)

    def resumed(self, value: float, behind: tuple[complex, ...]) -> FilterSession:
        """Return another session of the same filter that continues from a sample."""
        session = FilterSession(self._filter)
        session.value, session.behind = value, behind
        return session

    @property
    def is_identity(self) -> bool:
        """True without a filter."""
        return self._filter.is_identity

    @property
    def output(self) -> float:
        """Filtered value at the latest sample; NaN before the first."""
        total = self._filter.gain_at_zero * self.value
        for (_, weight), behind in zip(self._modes, self.behind, strict=True):
            total += (weight * behind).real
        return total

    def step(self, interval_s: float, value: float) -> float:
        """Advance over an interval in which the input changes linearly to `value`, and return the output at its end.

        Args:
            interval_s: time since the value before [s]; not used for the first one.
            value: true torque at the end of the interval.
        """
        if math.isnan(self.value):
            self.value = value
            return self.output
        rise, advanced = value - self.value, []
        for (pole, _), behind in zip(self._modes, self.behind, strict=True):
            exponent = pole * interval_s
            advanced.append(cmath.exp(exponent) * behind - rise * _mean_decay(exponent))
        self.value, self.behind = value, tuple(advanced)
        return self.output

    def jump(self, value: float) -> float:
        """Change the input to `value` at once, and return the output after it."""
        if math.isnan(self.value):
            return self.step(0.0, value)
        rise = value - self.value
        self.value, self.behind = value, tuple(behind - rise for behind in self.behind)
        return self.output

    def restart(self, value: float) -> float:
        """Go on behind a gap: the low pass starts at rest at `value`, the high pass keeps its mean."""
        rise = value - self.value
        kept = self.behind[-1] - rise if self._filter.high_pass_hz and not math.isnan(rise) else 0.0j
        self.value, self.behind = value, (*(0.0j for _ in self.behind[:-1]), *([kept] if self.behind else []))
        return self.output

    def take(self, intervals_s: Iterable[float], values: Iterable[float]) -> list[float]:
        """Take several samples, and return the outputs."""
        return [self.step(interval, value) for interval, value in zip(intervals_s, values, strict=True)]


def _mean_decay(exponent: complex) -> complex:
    """Evaluate expm1(x) / x for x = `exponent`, exactly near zero, too."""
    if abs(exponent) > 0.5:
        return (cmath.exp(exponent) - 1.0) / exponent
    total = term = 1.0 + 0.0j
    for k in range(2, 16):
        term *= exponent / k
        total += term
    return total


@compiled
def _filter(
    values: FloatArray,
    decays: ComplexArray,
    shares: ComplexArray,
    weights: ComplexArray,
    gain: float,
    blocking: bool,
    out: FloatArray,
) -> None:
    """Filter series (k, n) on an even grid; with `blocking`, the last mode is that of the high pass."""
    columns, rows = values.shape
    modes = decays.size
    behind = np.empty(modes, np.complex128)
    for each in range(columns):
        mean, before = 0.0, np.nan
        if blocking:  # the low pass with the corner of the high pass, backwards from the end, where it has the mean
            total, count = 0.0, 0
            for k in range(rows):
                if np.isfinite(values[each, k]):
                    total, count = total + values[each, k], count + 1
            behind[0] = 0.0
            for k in range(rows - 1, -1, -1):
                value = values[each, k]
                if not np.isfinite(value):
                    continue
                if np.isfinite(before):
                    behind[0] = decays[modes - 1] * behind[0] - (value - before) * shares[modes - 1]
                else:
                    behind[0] = total / count - value
                before = value
            mean = before + behind[0].real
        before = np.nan
        for k in range(rows):
            value = values[each, k]
            if not np.isfinite(value):
                if np.isfinite(before) and blocking:
                    mean = before + behind[modes - 1].real
                before = np.nan
                out[each, k] = np.nan
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
            out[each, k] = total


@compiled
def _phi(z: complex) -> tuple[complex, complex, complex, complex]:
    """Evaluate exp(z) and phi_k(z) = sum_j z^j / (j + k)! for k = 1, 2, 3."""
    if abs(z) < 1.0:
        third = term = 1.0 / 6.0 + 0.0j
        for j in range(1, 17):
            term *= z / (j + 3)
            third += term
        second = z * third + 0.5
        first = z * second + 1.0
        return z * first + 1.0, first, second, third
    decay = np.exp(z)
    first = (decay - 1.0) / z
    second = (first - 1.0) / z
    return decay, first, second, (second - 0.5) / z


@compiled
def _filter_cubics(
    steps: FloatArray,
    cubics: FloatArray,
    gap: BoolArray,
    poles: ComplexArray,
    weights: ComplexArray,
    gain: float,
    blocking: bool,
    out: FloatArray,
) -> None:
    """Filter a piecewise cubic; with `blocking`, the last mode is that of the high pass."""
    count, modes = steps.size, poles.size
    last = modes - 1
    behind = np.zeros(modes, np.complex128)
    if blocking:  # the low pass with the corner of the high pass, backwards from the end, where it has the mean
        total, lasted = 0.0, 0.0
        for i in range(count):
            if not gap[i]:
                total += 0.5 * steps[i] * (cubics[0, i] + cubics[1, i])
                lasted += steps[i]
        before = cubics[1, count - 1]
        behind[last] = total / lasted - before if lasted > 0.0 else 0.0
        for i in range(count - 1, -1, -1):
            behind[last] -= cubics[1, i] - before
            before = cubics[0, i]
            if gap[i]:
                behind[last] -= before - cubics[1, i]
            else:
                decay, first, second, third = _phi(poles[last] * steps[i])
                behind[last] = decay * behind[last] - (before - cubics[1, i]) * first
    before = cubics[0, 0]
    for i in range(count):
        start, end, start_slope, end_slope = cubics[0, i], cubics[1, i], cubics[2, i], cubics[3, i]
        for m in range(modes):
            behind[m] -= start - before
        out[0, i], out[2, i] = gain * start, gain * start_slope
        out[1, i], out[3, i] = gain * end, gain * end_slope
        rise = 6.0 * (end - start) / steps[i]
        linear, square = rise - 4.0 * start_slope - 2.0 * end_slope, 3.0 * (start_slope + end_slope) - rise
        for m in range(modes):
            out[0, i] += (weights[m] * behind[m]).real
            out[2, i] += (weights[m] * (poles[m] * behind[m] - start_slope)).real
            if gap[i]:
                behind[m] = behind[m] - (end - start) if blocking and m == last else 0.0j
            else:
                decay, first, second, third = _phi(poles[m] * steps[i])
                forced = start_slope * first + linear * second + 2.0 * square * third
                behind[m] = decay * behind[m] - steps[i] * forced
            out[1, i] += (weights[m] * behind[m]).real
            out[3, i] += (weights[m] * (poles[m] * behind[m] - end_slope)).real
        before = end
