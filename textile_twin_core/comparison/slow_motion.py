"""Slow part of the shaft's acceleration: instruments for a motion that hardly repeats or depends on the torque."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from textile_twin_core.comparison.shaft_track import TURN, ShaftTrack


def slow_motion(track: ShaftTrack, order: float, slow_rad_s: float) -> ShaftTrack:
    """Smooth the acceleration of a track by a Gaussian that halves waves of an order of the turn.

    Errors of an estimated acceleration grow with the square of the frequency, so the slow part has hardly any.
    `order` is taken at the median speed above `slow_rad_s`; a track at standstill is returned unchanged.
    """
    moving = np.abs(track.omega_rad_s) > slow_rad_s
    if not moving.any():
        return track
    a_turn = TURN / (float(np.median(np.abs(track.omega_rad_s[moving]))) * float(np.median(np.diff(track.time_s))))
    # A Gaussian of deviation s samples passes exp(-2 (pi s f)^2) of a frequency f a sample.
    deviation = np.sqrt(0.5 * np.log(2.0)) * a_turn / (np.pi * order)
    return replace(track, alpha_rad_s2=scipy.ndimage.gaussian_filter1d(track.alpha_rad_s2, deviation))
