"""Load knocks in a record: the drive's response, and where in a residual it shows."""

from __future__ import annotations

import numpy as np
from scipy.signal import fftconvolve

from textile_twin_core.arrays import FloatArray

WIDE = (0.10, 0.16, 0.18)
NARROW = (0.04, 0.08, 0.06)
"""Window of the matched filter before and after a knock, and the least distance of two finds [s]."""
CERTAIN = 6.0
"""In standard deviations: what a matched filter must show before it is taken for a knock."""


def response(after: FloatArray, time_constant: float) -> FloatArray:
    """Angle, speed, acceleration, (3, ...), at times `after` a unit impulse on w'' = -2 w'/T - w/T^2; 0 before it."""
    d = np.maximum(after, 0.0) / time_constant
    fade = np.exp(-d)
    angle = time_constant**2 * (1.0 - (1.0 + d) * fade)
    return np.stack([angle, time_constant * d * fade, np.where(after >= 0.0, (1.0 - d) * fade, 0.0)])


def response_slopes(after: FloatArray, time_constant: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """At times from the impulse on: the response's angle, its speed, and the angle's derivative by log T."""
    d = after / time_constant
    fade = np.exp(-d)
    square = time_constant**2
    return (
        square * (1.0 - (1.0 + d) * fade),
        time_constant * d * fade,
        square * (2.0 - (2.0 + 2.0 * d + d * d) * fade),
    )


def find_knocks(
    time: FloatArray,
    residual: FloatArray,
    sigma: float,
    time_constant: float,
    most: int,
    window_s: tuple[float, float, float] = WIDE,
) -> FloatArray:
    """Knocks that stand out of a residual.

    A matched filter: the response with what a slow drift (a cubic over the window) could explain taken out of it.

    Args:
        time: (n,) [s].
        residual: (n,) of the phase [rad].
        sigma: its standard deviation where nothing happens.
        time_constant: of the response [s].
        most: how many to return at most, the surest first.
        window_s: `WIDE`, the surer, or `NARROW`, which tells two knocks apart that follow each other closely.

    Returns:
        (m, 2) time [s] and size [rad/s^2], in the order of time.
    """
    step = float(np.median(np.diff(time)))
    grid = np.arange(time[0], time[-1], step)
    even = np.interp(grid, time, residual)
    lead, tail = max(int(window_s[0] / step), 4), max(int(window_s[1] / step), 6)
    if grid.size < lead + tail + 1 or sigma <= 0.0:
        return np.zeros((0, 2))
    window = np.asarray(np.arange(-lead, tail + 1) * step, dtype=np.float64)
    shape = response(window, time_constant)[0]
    scaled = window / window[-1]
    drift = np.stack([scaled**k for k in range(4)], axis=1)
    shape = shape - drift @ np.linalg.lstsq(drift, shape, rcond=None)[0]
    power = float(shape @ shape)
    match = fftconvolve(even, shape[::-1], mode="valid")  # place i: knock at grid[i + lead]
    strength = np.abs(match) / (sigma * np.sqrt(power))
    found: list[tuple[float, float]] = []
    apart = max(int(window_s[2] / step), 1)
    strength = strength.copy()
    while len(found) < most:
        best = int(np.argmax(strength))
        if strength[best] < CERTAIN:
            break
        found.append((float(grid[best + lead]), float(match[best] / power)))
        strength[max(best - apart, 0) : best + apart + 1] = 0.0
    return np.array(sorted(found)).reshape(-1, 2)
