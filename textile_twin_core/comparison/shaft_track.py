"""The shaft's motion over a record, as the encoder tells it: estimated once, read at any time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.alignment import GAP_PERIODS, fast_speed, usual_step
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine.sensors import Encoder
from textile_twin_core.shaft import ShaftStates, create_estimator
from textile_twin_core.twin.session import encoder_settings

TURN = 2.0 * math.pi
_UNSURE, _STILL = 0.1, 0.005
_FEWEST = 8
_INFORMATIVE_TURNS = 1.0
_ALIKE = 0.05
REST_SHARE = 0.05
"""Share of the fast speed below which the shaft counts as standing still."""


@dataclass(frozen=True)
class ShaftTrack:
    """States of the shaft over time, (n,) each, and how far apart they may be interpolated.

    Attributes:
        time_s: increasing, from the record's origin.
        theta_rad, omega_rad_s, alpha_rad_s2: the shaft's state there.
        longest_s: longer intervals are gaps.
        leaps: of the angle as no shaft makes them.
        pitch_errors_rad: of a toothed wheel's edges, as told or as this record's motion tells them; else empty.
    """

    time_s: FloatArray
    theta_rad: FloatArray
    omega_rad_s: FloatArray
    alpha_rad_s2: FloatArray
    longest_s: float
    leaps: int = 0
    pitch_errors_rad: tuple[float, ...] = ()

    @property
    def turns(self) -> float:
        """Turns of the shaft from one extreme of its angle to the other."""
        return float(np.ptp(self.theta_rad)) / TURN

    @cached_property
    def fast_rad_s(self) -> float:
        """The fast end of its speeds (see `fast_speed`)."""
        return fast_speed(self.omega_rad_s)

    @cached_property
    def at_one_speed(self) -> bool:
        """Whether the shaft's speed varies too little for a delay to be distinguishable from a zero of the encoder.

        A zero shifts the angle by a constant, a delay by speed times delay. Beside a free zero the delay is therefore
        known from the variance of the mean speed per revolution. That variance, as a share of the mean square, times
        the revolutions made, is the number of revolutions that would give a phase alone equally well. The delay needs
        `_INFORMATIVE_TURNS` of them; speeds within `_ALIKE` of the mean do not count.
        """
        turning = np.abs(self.omega_rad_s) > REST_SHARE * self.fast_rad_s
        turn = np.floor(self.theta_rad[turning] / TURN).astype(np.int64)
        if turn.size == 0:
            return True
        step = np.minimum(np.gradient(self.time_s), self.longest_s)[turning]
        moved = self.omega_rad_s[turning] * step
        _, place = np.unique(2 * turn + (moved < 0.0), return_inverse=True)
        span, way = np.bincount(place, step), np.bincount(place, moved)
        speed = way / span
        away = speed - way.sum() / span.sum()
        square = float(span @ speed**2)
        away[away**2 * span.sum() < _ALIKE**2 * square] = 0.0
        return float(span @ away**2) / square * float(np.abs(way).sum()) < _INFORMATIVE_TURNS * TURN

    def between(self, first_s: float, last_s: float) -> ShaftTrack:
        """The track from one time to another; all of it where too little lies between."""
        low, high = np.searchsorted(self.time_s, [first_s, last_s]).tolist()
        part = slice(max(low - 1, 0), high + 1)
        if high - low < _FEWEST:
            return self
        return replace(
            self,
            time_s=self.time_s[part],
            theta_rad=self.theta_rad[part],
            omega_rad_s=self.omega_rad_s[part],
            alpha_rad_s2=self.alpha_rad_s2[part],
        )

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
        """Angle, speed, acceleration at times (m,), and where there is a state on either side without a gap.

        Angle and speed by the cubic through both ends' values and slopes, acceleration by the straight line.
        """
        after = np.clip(np.searchsorted(self.time_s, time_s, side="right"), 1, self.time_s.size - 1)
        before = after - 1
        step = self.time_s[after] - self.time_s[before]
        good = (time_s >= self.time_s[0]) & (time_s <= self.time_s[-1]) & (step <= self.longest_s)
        u = np.clip((time_s - self.time_s[before]) / step, 0.0, 1.0)
        a0, a1 = self.alpha_rad_s2[before], self.alpha_rad_s2[after]
        w0, w1 = self.omega_rad_s[before], self.omega_rad_s[after]
        theta = _cubic(u, step, self.theta_rad[before], self.theta_rad[after], w0, w1)
        return theta, _cubic(u, step, w0, w1, a0, a1), a0 + u * (a1 - a0), good


def _cubic(
    u: FloatArray, step: FloatArray, y0: FloatArray, y1: FloatArray, d0: FloatArray, d1: FloatArray
) -> FloatArray:
    """Hermite's cubic at share u of a step, from values and slopes at its ends."""
    v, rise = 1.0 - u, y1 - y0
    return y0 + u * rise + u * v * (v * (d0 * step - rise) - u * (d1 * step - rise))


def _unsure(omega: FloatArray, variance: FloatArray) -> BoolArray:
    """States whose acceleration is too unsure for a torque, as where a shaft creeps from one encoder step to the next.

    Beyond a tenth of the square of the fast speed, with which torques of inertia go, and well beyond the usual.
    """
    fast, sigma = fast_speed(omega), np.sqrt(variance)
    limit = max(_UNSURE * fast**2, 5.0 * float(np.nanmedian(sigma)))
    return np.asarray((sigma > limit) & (np.abs(omega) > _STILL * fast))


def shaft_track(
    stamps_ns: IntArray,
    angle_rad: FloatArray,
    velocities: FloatArray | None,
    *,
    origin_ns: int,
    encoder: Encoder,
) -> ShaftTrack:
    """Estimate the shaft's motion from the encoder's angles (n,) over the whole record.

    Args:
        stamps_ns: stamps of the angles, int64 ns.
        angle_rad: angles of the encoder, in radians, wrapped or not.
        velocities: the encoder's own speed where it has one [rad/s].
        origin_ns: the stamp at which time is zero.
        encoder: its ratio and what is known of its readings; direction and zero are left to the caller.

    Raises RecordingError when no state comes out.
    """
    ratio = encoder.ratio
    estimator = create_estimator("smooth", **encoder_settings(replace(encoder, direction=1, zero_rad=0.0)))
    blocks = estimator.step(stamps_ns, angle_rad * ratio, None if velocities is None else velocities * ratio)
    states = [part for part in (blocks, estimator.finish()) if len(part)]
    if not states:
        raise RecordingError(f"too few shaft angles for a motion; {estimator.report.text()}")
    report = estimator.report
    return replace(track_of(states, origin_ns), leaps=report.jumps, pitch_errors_rad=report.pitch_errors_rad)


def track_of(states: Sequence[ShaftStates], origin_ns: int, direction: int = 1, zero_rad: float = 0.0) -> ShaftTrack:
    """The track that states of the shaft give, those of a whole record that were estimated with its own stamps in ns.

    An encoder's direction and zero (as angle of the shaft) that the states were estimated with are taken back. Raises
    RecordingError where too few states are usable.
    """
    stamps = np.concatenate([np.asarray(part.stamps, np.int64) for part in states])
    theta = np.concatenate([part.theta_rad for part in states])
    omega = np.concatenate([part.omega_rad_s for part in states])
    alpha = np.concatenate([part.alpha_rad_s2 for part in states])
    good = np.isfinite(theta) & np.isfinite(omega) & np.isfinite(alpha)
    good &= ~_unsure(omega, np.concatenate([part.covariance[:, 2, 2] for part in states]))
    good[1:] &= np.diff(stamps) > 0
    if np.count_nonzero(good) < _FEWEST:
        raise RecordingError(f"too few shaft angles for a motion: {np.count_nonzero(good)} states are usable")
    time = (stamps[good] - origin_ns) * 1e-9
    longest = GAP_PERIODS * usual_step(np.diff(time))
    theta, omega, alpha = direction * theta[good] + zero_rad, direction * omega[good], direction * alpha[good]
    return ShaftTrack(time, theta, omega, alpha, longest)
