"""Measuring chain as parameters: errors of the angle that repeat with the turn, and filters of the torque sensor."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from textile_twin_core.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from textile_twin_core.compiling import compiled
from textile_twin_core.inference.parameter import ECCENTRIC, FILTERS, MOTION, OF_LOAD, ModelParameter
from textile_twin_core.machine.torque_filter import TorqueFilter

TURN = 2.0 * math.pi
_PERIOD_S, _POINTS_A_TURN = 1e-3, 360
"""Longest step of the even grid on which torque is filtered, and its fewest points in a turn at working speed."""
GRID_SPREAD = 0.3
"""Spread of a step of the load on the grid, in its steps."""
_SHARPENED = 1.0 / 12.0 + 0.5 * GRID_SPREAD**2
_WARM_S = 0.5
"""Time before a run's first sample from which its filters start."""
_BREAK = 20.0
"""Interval between samples, in usual ones, that begins a new run."""
_SETTLING = 0.25
"""Largest share of a run in which a filter settles; a high pass starts from the mean of the coming torques."""
_BESIDE = 3
"""Points of the grid on either side of a sample on which its reading depends without a filter."""
_NO_FILTER = 1e-7
_BELOW_LOW_PASS = 0.9
"""Largest corner of a high pass, over that of the low pass."""
_CACHED = 2

State = tuple[FloatArray, FloatArray, FloatArray]


def torque_filter(values: Mapping[str, float]) -> TorqueFilter:
    """Return the filter of the torque sensor with these values of the parameters.

    A search may try a high pass above the low pass, which no sensor has: its corner is brought below that of the low
    pass.
    """
    first, second, high = (values[name] if values[name] > _NO_FILTER else 0.0 for name in FILTERS)
    if first or second:
        high = min(high, _BELOW_LOW_PASS / (TURN * (second or first)))
    if second:
        return TorqueFilter(low_pass_hz=1.0 / (TURN * second), low_pass_order=2, high_pass_hz=high)
    return TorqueFilter(low_pass_s=first, high_pass_hz=high)


class AngleRipple:
    """Errors of the angle by order: readings exceed the angle by sum a_k cos(k q) + b_k sin(k q), to first order.

    q is the record's angle, which counts the shaft's turns before direction and zero. Each order has a parameter for
    the cosine, and one for the sine that follows it.

    Args:
        parameters: of the measurement; others than those of the ripple are left out.
        shaft_per_encoder: turns of the shaft in a turn of the encoder.
        speed_rad_s: working speed; the ripple that loads cause is inverse to the squared speed over this one.
    """

    def __init__(self, parameters: Sequence[ModelParameter], shaft_per_encoder: float, speed_rad_s: float) -> None:
        own = [p.name for p in parameters if not p.leader and (p.name in ECCENTRIC or p.name.startswith(MOTION))]
        self.names = tuple((name, f"{name}.sine") for name in own)
        self._orders = tuple(
            (1.0 + ECCENTRIC.index(name)) / shaft_per_encoder
            if name in ECCENTRIC
            else float(name.removeprefix(MOTION).removesuffix(OF_LOAD))
            for name in own
        )
        self._of_load = tuple(name.endswith(OF_LOAD) for name in own)
        # amplitudes of the encoder are in its own angle
        self._factors = tuple(shaft_per_encoder if name in ECCENTRIC else 1.0 for name in own)
        self._speed = speed_rad_s
        self._cached: list[tuple[FloatArray, list[ComplexArray]]] = []

    def _waves(self, theta: FloatArray) -> list[ComplexArray]:
        """Waves exp(i k theta) (m,) of each order; cached, since states are evaluated many times."""
        for known, waves in self._cached:
            if known is theta:
                return waves
        first, powers = np.exp(1j * theta), dict[int, ComplexArray]()
        highest = max((int(order) for order in self._orders), default=0)
        wave = np.ones_like(first)
        for k in range(1, highest + 1):
            wave = wave * first
            powers[k] = wave
        waves = [powers[int(k)] if k == int(k) else np.exp(1j * k * theta) for k in self._orders]
        self._cached = [*self._cached[-_CACHED:], (theta, waves)]
        return waves

    def corrected(self, values: Mapping[str, float], state: State) -> State:
        """Return the state (m,) of the record's angle without the errors of these values."""
        theta, omega, alpha = state
        sizes: list[Any] = [
            factor * (values[cosine] - 1j * values[sine])
            for factor, (cosine, sine) in zip(self._factors, self.names, strict=True)
        ]
        if not any(sizes):
            return state
        slower = self._slower(omega)
        sizes = [
            size * slower if of_load and size else size for size, of_load in zip(sizes, self._of_load, strict=True)
        ]
        error = sum(size * wave for size, wave in zip(sizes, self._waves(theta), strict=True) if np.any(size))
        first, second = np.zeros_like(theta), np.zeros_like(theta)
        for size, order, wave in zip(sizes, self._orders, self._waves(theta), strict=True):
            if np.any(size):
                turned = order * size * wave
                first -= turned.imag
                second -= order * turned.real
        return theta - np.real(error), omega * (1.0 - first), alpha * (1.0 - first) - second * omega**2

    def _slower(self, omega: FloatArray) -> FloatArray:
        return np.asarray((self._speed / np.maximum(np.abs(omega), 0.2 * abs(self._speed))) ** 2)

    def slopes(self, state: State, by: State, asked: Collection[str]) -> dict[str, FloatArray]:
        """Slopes (m,) of a torque by the amplitudes asked for, from those by angle, speed and acceleration."""
        theta, omega, alpha = state
        by_theta, by_omega, by_alpha = by
        accelerated, rate_per_order = by_alpha * omega**2, by_omega * omega + by_alpha * alpha
        out = {}
        slower = self._slower(omega) if any(self._of_load) else 1.0
        rows = zip(self.names, self._orders, self._factors, self._of_load, self._waves(theta), strict=True)
        for (cosine, sine), order, factor, of_load, wave in rows:
            if cosine not in asked:
                continue
            level, rate = factor * (order**2 * accelerated - by_theta), factor * order * rate_per_order
            if of_load:
                level, rate = level * slower, rate * slower
            out[cosine] = level * wave.real + rate * wave.imag
            out[sine] = level * wave.imag - rate * wave.real
        return out


class EvenGrid:
    """Even grids of time over the runs of a record's samples, on which filters act.

    Args:
        sample_s: (m,) increasing times of the samples.
        speed_rad_s: working speed of the shaft.
    """

    def __init__(self, sample_s: FloatArray, speed_rad_s: float) -> None:
        self.period_s = min(_PERIOD_S, TURN / _POINTS_A_TURN / max(abs(speed_rad_s), 1e-3))
        step = np.diff(sample_s)
        breaks = np.flatnonzero(step > max(_BREAK * float(np.median(step)), _WARM_S)) + 1
        first, last = np.concatenate([[0], breaks]), np.concatenate([breaks, [sample_s.size]])
        parts: list[FloatArray] = []
        self._runs: list[slice] = []
        self._begin = np.empty(sample_s.size, np.int64)
        begin = 0
        for low, high in zip(first.tolist(), last.tolist(), strict=True):
            start = float(sample_s[low]) - _WARM_S
            count = math.ceil((float(sample_s[high - 1]) - start) / self.period_s) + 2
            parts.append(np.asarray(start + self.period_s * np.arange(count), np.float64))
            self._runs.append(slice(begin, begin + count))
            self._begin[low:high] = begin
            begin += count
        self.time_s: FloatArray = np.concatenate(parts)
        self._before = np.clip(np.searchsorted(self.time_s, sample_s), 1, self.time_s.size - 1) - 1
        within: FloatArray = np.clip((sample_s - self.time_s[self._before]) / self.period_s, 0.0, 1.0)
        self._place = self._before + within

    def through(self, chosen: TorqueFilter, values: FloatArray) -> FloatArray:
        """Filter values (g,) or (k, g) on the grid."""
        if chosen.is_identity:
            return values
        # the filter takes its input as linear between the points, which smooths it, as does the spread of its steps
        rows = np.atleast_2d(values)
        sharp = np.empty(rows.shape)
        _sharpen(rows, _SHARPENED, sharp)
        found = [chosen.apply(self.period_s, sharp[:, run].T).T for run in self._runs]
        return (found[0] if len(found) == 1 else np.concatenate(found, 1)).reshape(values.shape)

    @property
    def begin_s(self) -> list[float]:
        """Begin of each run, to a tenth of a second."""
        return [round(float(self.time_s[run.start]), 1) for run in self._runs]

    def starts(self, high_pass_hz: float) -> FloatArray:
        """Return the response of a high pass at the samples (m, runs) to a unit step at each run's begin."""
        first = np.array([run.start for run in self._runs])
        since = self.at_samples(self.time_s)[:, None] - np.array(self.begin_s)
        return np.where(self._begin[:, None] == first, np.exp(-TURN * high_pass_hz * np.maximum(since, 0.0)), 0.0)

    def at_samples(self, values: FloatArray, late_s: float = 0.0, chosen: IntArray | None = None) -> FloatArray:
        """Interpolate values on the grid (g,) or (k, g) at the samples less a time, or at the chosen ones of them."""
        place = self._place if chosen is None else self._place[chosen]
        place = np.clip(place - late_s / self.period_s, 1.0, self.time_s.size - 2.001)
        found = np.empty((*values.shape[:-1], place.size))
        _interpolate(np.atleast_2d(values), place, np.atleast_2d(found))
        return found

    def settled(self, chosen: TorqueFilter, good: BoolArray) -> BoolArray:
        """Mask (m,) of the samples whose reading depends on usable points of the grid (g,) alone."""
        longest = max(run.stop - run.start for run in self._runs)
        reach = min(math.ceil(chosen.settling_s / self.period_s) + 1, int(_SETTLING * longest))
        bad = np.cumsum(np.concatenate([[0], ~good]))
        after = self._before + 1
        first = np.maximum(after - max(reach, _BESIDE), self._begin)
        last = np.minimum(after + _BESIDE - 1, self.time_s.size - 1)
        return np.asarray((bad[last + 1] == bad[first]) & (after - self._begin >= reach))


@compiled
def _sharpen(values: FloatArray, share: float, out: FloatArray) -> None:
    """Subtract a share of the second differences of series (k, n)."""
    for each in range(values.shape[0]):
        last = values.shape[1] - 1
        out[each, 0], out[each, last] = values[each, 0], values[each, last]
        for k in range(1, last):
            bend = values[each, k + 1] - 2.0 * values[each, k] + values[each, k - 1]
            out[each, k] = values[each, k] - share * bend


@compiled
def _interpolate(values: FloatArray, place: FloatArray, out: FloatArray) -> None:
    """Interpolate series (k, n) at places between their points by cubic convolution (Keys 1981)."""
    for k in range(place.size):
        at = int(place[k])
        u = place[k] - at
        v = 1.0 - u
        before, low, high, after = (
            -0.5 * u * v**2,
            v * (1.0 + u - 1.5 * u**2),
            u * (1.0 + v - 1.5 * v**2),
            -0.5 * v * u**2,
        )
        for each in range(values.shape[0]):
            row = values[each]
            out[each, k] = before * row[at - 1] + low * row[at] + high * row[at + 1] + after * row[at + 2]
