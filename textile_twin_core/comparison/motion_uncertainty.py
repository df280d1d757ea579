"""What the encoder's readings say beside the estimated motion: its uncertainty by order of the turn, and its error."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.shaft_track import ShaftTrack
from textile_twin_core.inference.record import Ripple

_ORDERS = 60
_FEWEST = 256
_NEAR_SPEED = 0.3
"""Relative distance from the fast end of the speeds within which readings count."""


def uncertain_ripple(track: ShaftTrack, excess_rad: FloatArray) -> Ripple:
    """Return the ripple of a track by order of the turn, and what the readings leave uncertain of it.

    An amplitude that the estimator left out shows in the readings less the track's angle; the readings determine it
    to sigma sqrt(2 / n). Empty where too few readings count, as for the edges of a toothed wheel.

    Args:
        track: the estimated motion. excess_rad: (n,) readings less its angle (see `excess_of`), nan without one.
    """
    fast = np.abs(np.abs(track.omega_rad_s) - track.fast_rad_s) < _NEAR_SPEED * track.fast_rad_s
    counts = fast & np.isfinite(excess_rad)
    number = np.count_nonzero(counts)
    if number < _FEWEST:
        return Ripple()
    error = excess_rad[counts] - np.mean(excess_rad[counts])
    alpha = track.alpha_rad_s2[counts]
    first = np.exp(-1j * track.theta_rad[counts])
    wave, missing, swing = np.ones_like(first), np.empty(_ORDERS), np.empty(_ORDERS)
    for k in range(_ORDERS):
        wave = wave * first
        missing[k] = math.sqrt(2.0) * abs(complex(np.mean(error * wave)))
        swing[k] = 2.0 * abs(complex(np.mean(alpha * wave)))
    return Ripple(np.hypot(missing, float(np.std(error)) * math.sqrt(2.0 / number)), swing)


def near_readings(track: ShaftTrack, excess_rad: FloatArray, width_s: float) -> ShaftTrack:
    """Return a track whose angles have the mean excess of the readings within a width of time.

    Errors of an estimate repeat with the motion, as a ripple that lags in a run-up; those of readings do not, so they
    give no false delay where the torque follows the speed. They stay small in averages wider than this.
    """
    known = np.isfinite(excess_rad)
    sums = np.concatenate([[0.0], np.cumsum(np.where(known, excess_rad, 0.0))])
    counts = np.concatenate([[0], np.cumsum(known)])
    place = np.arange(track.time_s.size)
    first = np.searchsorted(track.time_s, track.time_s - 0.5 * width_s, side="left")
    last = np.searchsorted(track.time_s, track.time_s + 0.5 * width_s, side="right")
    half = np.minimum(place - first, last - 1 - place)  # as many to either side, so that a trend moves nothing
    first, last = place - half, place + half + 1
    mean = (sums[last] - sums[first]) / np.maximum(counts[last] - counts[first], 1)
    return replace(track, theta_rad=track.theta_rad + mean)
