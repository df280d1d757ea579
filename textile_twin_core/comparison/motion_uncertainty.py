"""Uncertainty of the estimated motion by order of the turn: what the encoder's readings cannot exclude."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.repeating_motion import excess_of
from textile_twin_core.comparison.shaft_track import ShaftTrack
from textile_twin_core.inference.record import Ripple

_ORDERS = 60
_FEWEST = 256
_NEAR_SPEED = 0.3
"""Relative distance from the fast end of the speeds within which readings count."""


def uncertain_ripple(track: ShaftTrack, time_s: FloatArray, angle_rad: FloatArray, period_rad: float) -> Ripple:
    """Return the ripple of a track by order of the turn, and what the readings leave uncertain of it.

    An amplitude that the estimator left out shows in the readings less the track's angle; the readings determine it
    to sigma sqrt(2 / n). Empty where too few readings count, as for the edges of a toothed wheel.

    Args:
        track: the estimated motion.
        time_s, angle_rad: (m,) of the readings, in the track's time and sense; the angle wraps after `period_rad`
            or never.
        period_rad: angle of the shaft in a turn of the encoder.
    """
    excess = excess_of(track, time_s, angle_rad, period_rad)
    fast = np.abs(np.abs(track.omega_rad_s) - track.fast_rad_s) < _NEAR_SPEED * track.fast_rad_s
    counts = fast & np.isfinite(excess)
    number = np.count_nonzero(counts)
    if number < _FEWEST:
        return Ripple()
    error = excess[counts] - np.mean(excess[counts])
    alpha = track.alpha_rad_s2[counts]
    first = np.exp(-1j * track.theta_rad[counts])
    wave, missing, swing = np.ones_like(first), np.empty(_ORDERS), np.empty(_ORDERS)
    for k in range(_ORDERS):
        wave = wave * first
        missing[k] = math.sqrt(2.0) * abs(complex(np.mean(error * wave)))
        swing[k] = 2.0 * abs(complex(np.mean(alpha * wave)))
    return Ripple(np.hypot(missing, float(np.std(error)) * math.sqrt(2.0 / number)), swing)
