"""Signal of an encoder with a truth in closed form, for measuring shaft estimators."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray, IntArray

RATE_HZ = 500.0
JITTER_S = 20e-6
DROPPED = 0.05
ComplexArray = npt.NDArray[np.complex128]
STEADY, KNOCKS, MANY_ORDERS = LOADS = ("steady", "load knocks", "ripple of 12 orders")
_TURN = 2.0 * math.pi
_NODES, _NEGLIGIBLE = 256, 1e-18
_START_NS = 1_700_000_000_000_000_000
_RIPPLE = ((1, 0.02, 0.7), (2, 0.01, 2.1))
"""Orders of the shaft angle, with amplitude and phase."""
_MANY_ORDERS = (*_RIPPLE, *((k, 0.02 / k**2, 0.7 * k) for k in range(3, 13)))
"""Speed ripple of a load with steps in every turn: orders that fall as 1/k^2."""
_KNOCKS_PER_S, _KNOCK_SIZE, _KNOCK_S = 1.0, 0.015, 0.04
_NEWTON_STEPS = 8


@dataclass(frozen=True)
class ShaftMotion:
    """Shaft whose speed ripples with its angle and drops briefly after each shock of a load.

    omega = speed b(t) r(theta), with r = 1 + sum(a_k cos(k theta + p_k)) over the orders of the ripple. b is
    lowered after
    each shock at t_j by z d exp(1 - d), d = (t - t_j) / T: the response of a critically damped drive. The variables
    separate: the integral of 1/r over the angle, a Fourier series, equals that of `speed` b over time, in closed form.
    """

    speed_rad_s: float
    start_rad: float
    knocks_s: Sequence[float] = ()
    ripple: Sequence[tuple[int, float, float]] = _RIPPLE

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return angle [rad], speed [rad/s] and acceleration [rad/s^2] at times (n,) [s]."""
        level, slope, travel = np.ones_like(time_s), np.zeros_like(time_s), time_s.copy()
        for knock in self.knocks_s:
            d = np.maximum(time_s - knock, 0.0) / _KNOCK_S
            fall = _KNOCK_SIZE * np.exp(1.0 - d)
            level -= fall * d
            slope -= np.where(d > 0.0, fall * (1.0 - d) / _KNOCK_S, 0.0)
            travel -= _KNOCK_S * (math.e * _KNOCK_SIZE - fall * (1.0 + d))
        goal = self._clock(np.array([self.start_rad])) + self.speed_rad_s * travel
        theta = goal / self._slowness[0].real
        for _ in range(_NEWTON_STEPS):
            theta -= (self._clock(theta) - goal) * self._wave(theta)
        omega = self.speed_rad_s * level * self._wave(theta)
        alpha = self.speed_rad_s * slope * self._wave(theta) + self.speed_rad_s * level * self._wave(theta, 1) * omega
        return theta, omega, alpha

    def _wave(self, theta: FloatArray, derivative: int = 0) -> FloatArray:
        """Return the ripple r, or its derivative by the angle."""
        quarter = derivative * math.pi / 2.0
        terms = (a * k**derivative * np.cos(k * theta + phase + quarter) for k, a, phase in self.ripple)
        return np.asarray(sum(terms, np.full_like(theta, 1.0 - derivative)))

    @cached_property
    def _slowness(self) -> ComplexArray:
        """Fourier coefficients of 1/r from order 0 on; they are below rounding well before the last."""
        grid = np.linspace(0.0, _TURN, _NODES, endpoint=False)
        return np.asarray(np.fft.rfft(1.0 / self._wave(grid))[: _NODES // 4] / _NODES)

    def _clock(self, theta: FloatArray) -> FloatArray:
        """Return the integral of 1/r from angle 0 on."""
        orders = [(k, c) for k, c in enumerate(self._slowness) if k > 0 and abs(c) > _NEGLIGIBLE]
        terms = (2.0 / k * (c.real * np.sin(k * theta) + c.imag * (np.cos(k * theta) - 1.0)) for k, c in orders)
        return np.asarray(sum(terms, self._slowness[0].real * theta))


@dataclass(frozen=True)
class EncoderSignal:
    """Samples of an absolute encoder: counts, wrong stamps, lost samples; and the truth at the stamps."""

    motion: ShaftMotion
    stamps_ns: IntArray
    angles_rad: FloatArray

    @property
    def time_s(self) -> FloatArray:
        """(n,) time since the first possible sample [s]."""
        return np.asarray((self.stamps_ns - _START_NS) * 1e-9, dtype=np.float64)

    @cached_property
    def truth(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(n,) angle [rad], speed [rad/s], acceleration [rad/s^2] at the stamps."""
        return self.motion.at(self.time_s)


def encoder_signal(seed: int, speed_rad_s: float, bits: int, load: str, duration_s: float) -> EncoderSignal:
    """Simulate an encoder of `bits` bits per turn at `RATE_HZ`, with stamp jitter `JITTER_S` and a share
    `DROPPED` of losses.

    `load` is one of `LOADS`: speed ripple of two orders (steady), additional drops after shocks, one per second
    on average,
    or ripple of twelve orders.
    """
    rng = np.random.default_rng(seed)
    count = round(duration_s * RATE_HZ)
    hits = rng.uniform(0.0, duration_s, rng.poisson(duration_s * _KNOCKS_PER_S)) if load == KNOCKS else np.zeros(0)
    ripple = _MANY_ORDERS if load == MANY_ORDERS else _RIPPLE
    motion = ShaftMotion(speed_rad_s, rng.uniform(0.0, _TURN), hits.tolist(), ripple)
    kept = np.flatnonzero(rng.random(count) >= DROPPED)
    stamps = kept / RATE_HZ
    angles, _, _ = motion.at(stamps + rng.normal(0.0, JITTER_S, kept.size))
    step = _TURN / 2**bits
    stamps_ns = _START_NS + np.rint(stamps * 1e9).astype(np.int64)
    return EncoderSignal(motion, stamps_ns, np.rint(angles / step) % 2**bits * step)
