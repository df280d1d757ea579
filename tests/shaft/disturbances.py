"""Random disturbances of a shaft's acceleration on a fine time grid."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter


def wander(rng: np.random.Generator, n: int, dt_s: float, time_s: float, size: float) -> np.ndarray:
    """(n,) an Ornstein-Uhlenbeck process of that correlation time and standard deviation, exact at the grid."""
    decay = np.exp(-dt_s / time_s)
    noise = rng.normal(0.0, size * np.sqrt(1.0 - decay**2), n)
    noise[0] = rng.normal(0.0, size)
    return np.asarray(lfilter([1.0], [1.0, -decay], noise))


def steps(rng: np.random.Generator, n: int, dt_s: float, rate_hz: float, size: float) -> np.ndarray:
    """(n,) a level with steps at random times to a new normal value; a step takes one interval of the grid."""
    leaps = rng.random(n) < rate_hz * dt_s
    levels = rng.normal(0.0, size, int(leaps.sum()) + 1)
    return np.asarray(levels[np.cumsum(leaps)])


def pulses(rng: np.random.Generator, n: int, dt_s: float, rate_hz: float, speed: float) -> np.ndarray:
    """(n,) half waves of a sine at random times, 4 ms to 0.3 s long, that each change the speed by about `speed`."""
    push = np.zeros(n)
    for start in rng.integers(0, n, rng.poisson(rate_hz * n * dt_s)):
        length = np.exp(rng.uniform(np.log(0.004), np.log(0.3)))
        count = min(int(length / dt_s) + 1, n - start)
        wave = np.sin(np.pi * np.arange(count) * dt_s / length)
        push[start : start + count] += rng.normal(0.0, speed) * np.pi / (2.0 * length) * wave
    return push
