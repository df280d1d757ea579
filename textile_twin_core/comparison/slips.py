"""Slips of the encoder, detected as discontinuities of the shaft's track, and the parts between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.shaft_track import ShaftTrack

_LEAST_RAD = 0.02
"""Smallest slip: change of the angle beyond that by the speeds on either side."""
_LATE = 5
"""Readings beside a slip that belong to neither part."""


def slips_of(track: ShaftTrack) -> FloatArray:
    """Slip of the angle (n - 1,) from each state to the next [rad]; 0 without a slip, and over gaps.

    When the encoder slips, the estimator follows the angle but keeps the speed, so that the two disagree.
    """
    if track.slips == 0:
        return np.zeros(max(track.time_s.size - 1, 0))
    step, omega, alpha = np.diff(track.time_s), track.omega_rad_s, track.alpha_rad_s2
    turned = step * (0.5 * (omega[1:] + omega[:-1]) - step * np.diff(alpha) / 12.0)
    beyond = np.diff(track.theta_rad) - turned
    return np.where((np.abs(beyond) > _LEAST_RAD) & (step <= track.longest_s), beyond, 0.0)


def without_turns(track: ShaftTrack, encoder_turn_rad: float) -> ShaftTrack:
    """Remove slips by whole turns of the encoder, of shaft angle `encoder_turn_rad` each, from the track.

    A wrapped angle that was not recognised as such, as after one in another unit, slips once a turn.
    """
    slips = slips_of(track)
    turns = np.rint(slips / encoder_turn_rad)
    turns[np.abs(slips - turns * encoder_turn_rad) > _LEAST_RAD] = 0.0
    if not turns.any():
        return track
    theta = track.theta_rad.copy()
    theta[1:] -= encoder_turn_rad * np.cumsum(turns)
    return replace(track, theta_rad=theta)


def parts_between(track: ShaftTrack) -> list[tuple[float, float]]:
    """First and last times [s] of the parts of a track between its slips.

    A slip is detected some readings late, so the readings beside it belong to neither part.
    """
    at = np.flatnonzero(slips_of(track))
    first = np.concatenate([[0], np.minimum(at + 1 + _LATE, track.time_s.size - 1)])
    last = np.concatenate([at - _LATE, [track.time_s.size - 1]])
    return [(float(track.time_s[a]), float(track.time_s[b])) for a, b in zip(first, last, strict=True) if b > a]
