"""Torque readings before any model: values that a slower clock repeats, and lines fixed in time such as mains hum."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.comparison.shaft_track import TURN

_FEWEST_RUNS, _REGULAR = 32, 1.5
"""Fewest runs of equal readings that show a slower clock, and the largest ratio of its long to its short runs."""
_STUCK_RUN, _STUCK_READINGS, _STUCK_TURN, _STUCK_VALUES = 20.0, 50, 0.5, 200
"""Least length of a run of equal readings that shows a sensor which stopped: over the usual run, in readings, and in
turns of the shaft meanwhile; fewest different values, since coarse readings stay equal by themselves."""
_LEAST_HZ, _BINS, _ABOVE = 5.0, 101, 40.0
"""Lowest frequency of a line; bins of the background beside it; least power over that background's median."""
_MOST_LINES = 6
_RATHER_TIME = 2.0
"""Least amplitude of a line over that of the nearest whole orders of the shaft, which a machine's torque follows."""


@dataclass(frozen=True)
class TimeLine:
    """A line of the torque fixed in time: frequency [Hz], and amplitudes of cosine and sine [N m] from time 0 on."""

    frequency_hz: float
    cosine_Nm: float
    sine_Nm: float

    @property
    def amplitude_Nm(self) -> float:
        """Amplitude [N m]."""
        return math.hypot(self.cosine_Nm, self.sine_Nm)

    def at(self, time_s: FloatArray) -> FloatArray:
        """Torque of the line at times (m,) [N m]."""
        phase = 2.0 * math.pi * self.frequency_hz * time_s
        return self.cosine_Nm * np.cos(phase) + self.sine_Nm * np.sin(phase)


def fresh_readings(time_s: FloatArray, torque_Nm: FloatArray) -> BoolArray:
    """Mask (m,) of the readings that a sensor renewed: the first of each run where a slower clock repeats values.

    Runs of a slower clock are equally long; those of a coarse step of the readings are not. All readings count where
    no slower clock shows.
    """
    new = np.concatenate([[True], torque_Nm[1:] != torque_Nm[:-1]])
    starts = np.flatnonzero(new)
    every = np.ones(torque_Nm.size, np.bool_)
    if starts.size < _FEWEST_RUNS or 2 * starts.size > torque_Nm.size:
        return every
    short, long = np.percentile(np.diff(time_s[starts]), [10.0, 90.0]).tolist()
    return new if long <= _REGULAR * short else every


def step_of(torque_Nm: FloatArray) -> float:
    """Resolution of the torque sensor [N m]; 0 where values hardly repeat."""
    values = np.unique(torque_Nm)
    return float(np.median(np.diff(values))) if 1 < values.size < 0.5 * torque_Nm.size else 0.0


def stuck_readings(torque_Nm: FloatArray, turned_rad: FloatArray) -> BoolArray:
    """Mask (m,) of the readings that stay equal while the shaft turns, as of a sensor or a driver that stopped.

    Args:
        torque_Nm: (m,) readings. turned_rad: (m,) path of the shaft until each.
    """
    starts = np.flatnonzero(np.concatenate([[True], torque_Nm[1:] != torque_Nm[:-1]]))
    if np.unique(torque_Nm).size < _STUCK_VALUES:
        return np.zeros(torque_Nm.size, np.bool_)
    lengths = np.diff(np.append(starts, torque_Nm.size))
    path = turned_rad[starts + lengths - 1] - turned_rad[starts]
    least = max(_STUCK_RUN * float(np.percentile(lengths, 99.0)), _STUCK_READINGS)
    return np.repeat((lengths >= least) & (path > _STUCK_TURN * TURN), lengths)


def time_lines(
    time_s: FloatArray, residual_Nm: FloatArray, theta_rad: FloatArray, speed_rad_s: float
) -> tuple[TimeLine, ...]:
    """Find lines fixed in time in a residual torque (m,) at increasing times, over the shaft's angle (m,).

    A line counts where its power exceeds the background and its amplitude that of the nearest whole orders of the
    shaft, so that a torque of the machine is no line.

    Args:
        time_s, residual_Nm, theta_rad: of the samples.
        speed_rad_s: working speed of the shaft.
    """
    found: list[TimeLine] = []
    own = residual_Nm - np.mean(residual_Nm)
    for _ in range(_MOST_LINES):
        line = _strongest(time_s, own, theta_rad, speed_rad_s)
        if line is None:
            break
        found.append(line)
        own = own - line.at(time_s)
    return tuple(found)


def _strongest(time: FloatArray, residual: FloatArray, theta: FloatArray, speed: float) -> TimeLine | None:
    step = float(np.median(np.diff(time)))
    place = np.rint((time - time[0]) / step).astype(np.int64)
    even = np.zeros(int(place[-1]) + 1)
    even[place] = residual
    power = np.abs(np.fft.rfft(even)) ** 2
    frequency = np.fft.rfftfreq(even.size, step)
    ratio = power / np.maximum(scipy.ndimage.median_filter(power, _BINS, mode="nearest"), 1e-300)
    ratio[frequency < _LEAST_HZ] = 0.0
    for peak in np.argsort(-ratio)[:_MOST_LINES].tolist():
        if ratio[peak] < _ABOVE:
            return None
        line = _fitted(time, residual, float(frequency[peak]), 1.0 / (even.size * step))
        order = round(abs(2.0 * math.pi * line.frequency_hz / speed))
        # a ripple of the speed spreads an order over its neighbours in time
        beside = max(_amplitude(residual, k * theta) for k in range(max(order - 2, 1), order + 3))
        if line.amplitude_Nm > _RATHER_TIME * beside:
            return line
    return None


def _fitted(time: FloatArray, residual: FloatArray, near_hz: float, width_hz: float) -> TimeLine:
    """Line of the largest amplitude near a frequency."""

    def lacking(hz: float) -> float:
        return -_amplitude(residual, 2.0 * math.pi * hz * time)

    bounds = near_hz - width_hz, near_hz + width_hz
    hz = float(scipy.optimize.minimize_scalar(lacking, bounds=bounds, method="bounded").x)
    phase = 2.0 * math.pi * hz * time
    cosine, sine = np.linalg.lstsq(np.stack([np.cos(phase), np.sin(phase)], 1), residual, rcond=None)[0].tolist()
    return TimeLine(hz, cosine, sine)


def _amplitude(values: FloatArray, phase: FloatArray) -> float:
    return 2.0 * float(np.abs(np.mean(values * np.exp(-1j * phase))))
