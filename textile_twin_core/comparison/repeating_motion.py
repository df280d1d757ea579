"""Repeating or slow part of the shaft's motion: instruments against errors of its acceleration."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.comparison.shaft_track import TURN, ShaftTrack

_HIGHEST = 6
_SAMPLES_A_WAVE = 4.0
_FEWEST = 64


def repeating_motion(
    track: ShaftTrack, cycle_turns: int, slow_rad_s: float, excess_rad: FloatArray | None = None
) -> ShaftTrack:
    """Replace speed and acceleration of a track by their mean over a cycle and a ripple that repeats with the angle.

    The estimated acceleration of a track has errors, which make least squares underestimate the inertia (attenuation,
    Fuller 1987, section 1.1). A motion averaged over a cycle, or repeated over a record, is nearly free of the errors
    of single samples: slopes taken there are instruments (for inverse dynamics Janot, Vandanjon and Gautier 2014).
    The ripple has orders up to 6 of the turn: a part proportional to the speed (from a changing inertia), a part
    proportional to its inverse (from a torque), and the ripple of the readings about the track.

    Args:
        track: as estimated. cycle_turns: turns after which the motion repeats.
        slow_rad_s: speed below which the shaft stands still; there, and with little motion, the track is unchanged.
        excess_rad: (n,) readings less the track's angle (see `excess_of`), nan without a reading.
    """
    moving = np.abs(track.omega_rad_s) > slow_rad_s
    slow, change, whole = _mean_motion(track, TURN * cycle_turns, moving)
    if np.count_nonzero(whole) < _FEWEST:
        return track
    usual = float(np.median(np.abs(slow[whole])))
    a_turn = TURN / (usual * float(np.median(np.diff(track.time_s))))
    orders = np.arange(1, int(min(_HIGHEST, a_turn / _SAMPLES_A_WAVE) * cycle_turns) + 1) / cycle_turns
    theta, omega = track.theta_rad, track.omega_rad_s
    energy = (slow[whole] / usual) ** 2
    waves = _waves(theta[whole], orders)
    columns = np.concatenate([waves * energy[:, None], waves], axis=1)
    found = np.linalg.lstsq(columns, energy * (omega[whole] / slow[whole] - 1.0), rcond=1e-9)[0]
    inertial, driven = np.split(found, 2)

    slow, change, theta = slow[moving], change[moving], theta[moving]
    size = inertial + driven * (usual / slow[:, None]) ** 2
    waves, slopes = _waves(theta, orders), _slopes(theta, orders)
    relative = 1.0 + np.einsum("ij,ij->i", waves, size)
    speed = slow * relative
    acceleration = change * relative + slow * speed * np.einsum("ij,ij->i", slopes, size)
    if excess_rad is not None:
        known = whole & np.isfinite(excess_rad)
        coefficients = np.linalg.lstsq(_waves(track.theta_rad[known], orders), excess_rad[known], rcond=1e-9)[0]
        acceleration -= speed**2 * (waves @ (np.tile(orders, 2) ** 2 * coefficients))
        speed *= 1.0 + slopes @ coefficients
    omega, alpha = omega.copy(), track.alpha_rad_s2.copy()
    omega[moving], alpha[moving] = speed, acceleration
    return replace(track, omega_rad_s=omega, alpha_rad_s2=alpha)


def excess_of(track: ShaftTrack, time_s: FloatArray, angle_rad: FloatArray, period_rad: float) -> FloatArray:
    """Logged angles less those of the track (n,), nan for a state without a reading; outliers are left out.

    Args:
        time_s, angle_rad: (m,) of the readings, in the track's time and sense; the angle wraps after `period_rad`
            or never.
    """
    out = np.full(track.time_s.size, np.nan)
    place = np.minimum(np.searchsorted(track.time_s, time_s), out.size - 1)
    same = track.time_s[place] == time_s
    apart = angle_rad[same] - track.theta_rad[place[same]]
    apart = np.remainder(apart + 0.5 * period_rad, period_rad) - 0.5 * period_rad
    wild = np.abs(apart) > 10.0 * np.median(np.abs(apart)) if apart.size else np.zeros(0, dtype=np.bool_)
    out[place[same]] = np.where(wild, np.nan, apart)
    return out


def _mean_motion(track: ShaftTrack, cycle: float, moving: BoolArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Mean speed over a cycle and its rate, where the shaft turns; and a mask of the means over a whole cycle."""
    slow, change = track.omega_rad_s.copy(), track.alpha_rad_s2.copy()
    whole = np.zeros(slow.size, dtype=np.bool_)
    pause = np.concatenate([[False], np.diff(track.time_s) > track.longest_s])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], moving, [False]]).astype(np.int8)))
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        cuts = [first, *(first + 1 + np.flatnonzero(pause[first + 1 : end])), end]
        for start, stop in pairwise(cuts):
            piece = slice(start, stop)
            if stop - start >= _FEWEST:
                slow[piece], whole[piece] = _mean_speed(track.time_s[piece], track.theta_rad[piece], cycle)
                change[piece] = np.gradient(slow[piece], track.time_s[piece])
    return slow, change, whole


def _mean_speed(time: FloatArray, theta: FloatArray, cycle: float) -> tuple[FloatArray, BoolArray]:
    """Mean speed over a cycle around each sample, over less at the ends, and a mask of the whole cycles."""
    sense = np.sign(theta[-1] - theta[0])
    angle = np.maximum.accumulate(sense * theta) + 1e-12 * np.arange(theta.size)
    inside = np.minimum(angle - angle[0], angle[-1] - angle)
    half = np.clip(inside, (angle[-1] - angle[0]) / theta.size, 0.5 * cycle)
    ends = [np.clip(angle + side * half, angle[0], angle[-1]) for side in (-1.0, 1.0)]
    before, after = (np.interp(end, angle, time) for end in ends)
    return sense * (ends[1] - ends[0]) / (after - before), inside >= 0.5 * cycle


def _waves(theta: FloatArray, orders: FloatArray) -> FloatArray:
    phase = np.outer(theta, orders)
    return np.concatenate([np.cos(phase), np.sin(phase)], axis=1)


def _slopes(theta: FloatArray, orders: FloatArray) -> FloatArray:
    phase = np.outer(theta, orders)
    return np.concatenate([-orders * np.sin(phase), orders * np.cos(phase)], axis=1)
