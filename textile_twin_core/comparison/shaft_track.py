"""Motion of the shaft over a record: estimated once from the encoder, interpolated at any time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
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
_SPREAD = 1.2
_CREEP, _OTHER_WAY = 0.05, 0.05
"""Share of the fast speed below which the shaft creeps; share of the time in which one that rocks turns each way."""
_PAUSE = 20.0
"""A turn this many times longer than the median one contains a stop."""


@dataclass(frozen=True)
class ShaftTrack:
    """States of the shaft over time, (n,) each, with interpolation between them.

    Attributes:
        time_s: increasing, from the record's origin.
        theta_rad, omega_rad_s, alpha_rad_s2: the shaft's state there.
        longest_s: longer intervals are gaps.
        slips: slips of the encoder.
        pitch_errors_rad: of a toothed wheel's edges, configured or estimated from this record; else empty.
        unsure_s: times of the states left out because their acceleration is too uncertain for a torque.
    """

    time_s: FloatArray
    theta_rad: FloatArray
    omega_rad_s: FloatArray
    alpha_rad_s2: FloatArray
    longest_s: float
    slips: int = 0
    pitch_errors_rad: tuple[float, ...] = ()
    unsure_s: FloatArray = field(default_factory=lambda: np.empty(0))

    @cached_property
    def turns(self) -> float:
        """Number of turns along the path of the shaft, forward and backward, standstills left out."""
        along = np.abs(np.diff(self.theta_rad))[np.abs(self.omega_rad_s[1:]) > _CREEP * self.fast_rad_s]
        return max(float(along.sum()), float(np.ptp(self.theta_rad))) / TURN

    @cached_property
    def rocks(self) -> bool:
        """True if the shaft turns a share of the time in each direction."""
        omega = self.omega_rad_s[np.abs(self.omega_rad_s) > _CREEP * self.fast_rad_s]
        share = float(np.mean(omega > 0.0)) if omega.size else 0.0
        return _OTHER_WAY < share < 1.0 - _OTHER_WAY

    @cached_property
    def fast_rad_s(self) -> float:
        """Fast end of its speeds (see `fast_speed`)."""
        return fast_speed(self.omega_rad_s)

    @cached_property
    def at_one_speed(self) -> bool:
        """True if the mean speeds of whole turns are so similar that a delay acts as a zero of the encoder.

        The third fastest turn is then at most 1.2 times as fast as the third slowest, or there are too few turns. For a
        shaft that rocks a delay acts as a zero that changes its sign with the direction.
        """
        if self.rocks:
            return False
        edges = np.flatnonzero(np.diff(np.floor(self.theta_rad / TURN)) != 0.0)
        spans = np.sort(np.diff(self.time_s[edges]))
        # A shaft at standstill where a turn ends may tremble across that angle; such turns are too short.
        spans = spans[2.0 * self.fast_rad_s * spans > TURN]
        spans = spans[spans < _PAUSE * np.median(spans)] if spans.size else spans
        return spans.size < _FEWEST or bool(spans[-3] <= _SPREAD * spans[2])

    def between(self, first_s: float, last_s: float) -> ShaftTrack:
        """Return the track from one time to another; all of it if too little lies between."""
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

    @cached_property
    def gaps(self) -> tuple[BoolArray, BoolArray]:
        """Masks (n - 1,) of the intervals without angles, and of those without a certain acceleration."""
        step = np.diff(self.time_s)
        beside = np.searchsorted(self.unsure_s, self.time_s)
        apart, angles = step > self.longest_s, step <= self.longest_s * (np.diff(beside) + 1)
        return apart & ~angles, apart & angles

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
        """Return angle, speed and acceleration at times (m,), and true where states on both sides have no gap between.

        Angle and speed by the cubic through both ends' values and slopes, acceleration by a straight line.
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
    """Mask of states with an acceleration too uncertain for a torque, as of a shaft creeping between encoder steps.

    Its sigma exceeds the usual one by far, and a tenth of the squared fast speed, to which torques of inertia scale.
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
        encoder: its ratio and the errors of its readings; direction and zero are applied by the caller.

    Raises RecordingError when no state can be estimated.
    """
    ratio = encoder.ratio
    estimator = create_estimator("smooth", **encoder_settings(replace(encoder, direction=1, zero_rad=0.0)))
    speeds = None if velocities is None else encoder.true_speed(angle_rad, velocities) * ratio
    blocks = estimator.step(stamps_ns, encoder.true_angle(angle_rad) * ratio, speeds)
    states = [part for part in (blocks, estimator.finish()) if len(part)]
    if not states:
        raise RecordingError(f"too few shaft angles for a motion; {estimator.report.text()}")
    report = estimator.report
    return replace(track_of(states, origin_ns), slips=report.jumps, pitch_errors_rad=report.pitch_errors_rad)


def track_of(states: Sequence[ShaftStates], origin_ns: int, direction: int = 1, zero_rad: float = 0.0) -> ShaftTrack:
    """Make a track of the shaft's states over a whole record, estimated at its own stamps in ns.

    Undoes the encoder's direction and zero (as angle of the shaft) used in the estimation. Raises RecordingError if
    too few states are usable.
    """
    stamps = np.concatenate([np.asarray(part.stamps, np.int64) for part in states])
    theta = np.concatenate([part.theta_rad for part in states])
    omega = np.concatenate([part.omega_rad_s for part in states])
    alpha = np.concatenate([part.alpha_rad_s2 for part in states])
    good = np.isfinite(theta) & np.isfinite(omega) & np.isfinite(alpha)
    good[1:] &= np.diff(stamps) > 0
    unsure = good & _unsure(omega, np.concatenate([part.covariance[:, 2, 2] for part in states]))
    good &= ~unsure
    if np.count_nonzero(good) < _FEWEST:
        raise RecordingError(f"too few shaft angles for a motion: {np.count_nonzero(good)} states are usable")
    time = (stamps[good] - origin_ns) * 1e-9
    longest = GAP_PERIODS * usual_step(np.diff(time))
    theta, omega, alpha = direction * theta[good] + zero_rad, direction * omega[good], direction * alpha[good]
    return ShaftTrack(time, theta, omega, alpha, longest, unsure_s=(stamps[unsure] - origin_ns) * 1e-9)
