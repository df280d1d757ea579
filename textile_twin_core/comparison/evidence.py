"""Measured torque beside the shaft's track: the record for the fits."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.shaft_track import TURN, ShaftTrack
from textile_twin_core.inference import blocks
from textile_twin_core.inference.elastic_torque import LinearisedTorque
from textile_twin_core.inference.record import Ripple

_MOST_SAMPLES = 8000
REST_SHARE = 0.05
"""Share of the fast end of the speeds below which the shaft counts as standing still."""
_BLOCKS_A_TURN, _FEWEST_BLOCKS = 10.0, 4.0
"""Averages in a turn at working speed: usual number, and fewest."""
_FEWEST_IN_A_BLOCK = 8.0
"""Samples of an average, where a turn has enough."""
_RUNS, _RUN_S = 4, 4.0
"""Number and length [s] of the runs in which torque is filtered over time."""


@dataclass(frozen=True)
class Evidence:
    """Measured torque (m,) over time [s], and the shaft's track.

    slips: time [s] and size [rad] of slips of the angle; the track begins or ends at one of them.
    at_ends_Nm: measured torques at an end of the sensor's range, left out of the others.
    block_s: width of the block averages (see `in_blocks`), or 0.
    encoder_turn_rad: shaft angle of one turn of the encoder.
    ripple: of the motion, and its uncertainty (see `uncertain_ripple`).
    predicted: torque of an elastic shaft; None for a rigid one.
    stuck: time [s] in which a stopped sensor repeated a torque, which is left out, and its values [N m].
    """

    time_s: FloatArray
    torque_Nm: FloatArray
    track: ShaftTrack
    middle_s: float
    slips: tuple[tuple[float, float], ...] = ()
    at_ends_Nm: FloatArray = field(default_factory=lambda: np.empty(0))
    block_s: float = 0.0
    encoder_turn_rad: float = TURN
    ripple: Ripple = field(default_factory=Ripple)
    predicted: LinearisedTorque | None = None
    stuck: tuple[float, FloatArray] = field(default_factory=lambda: (0.0, np.empty(0)))
    slow_rad_s: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "slow_rad_s", REST_SHARE * self.track.fast_rad_s)

    def thinned(self, most: int = _MOST_SAMPLES) -> Evidence:
        """Take at most `most` samples, evenly over the time at which the shaft turns."""
        _, omega, _, good = self.track.at(self.time_s)
        turning = np.flatnonzero(good & (np.abs(omega) > self.slow_rad_s))
        if self.block_s and turning.size:
            turning = turning[blocks.fewer(turning.size, self.block_s / float(np.median(np.diff(self.time_s))), most)]
        elif turning.size > most:
            turning = turning[np.linspace(0, turning.size - 1, most).astype(np.int64)]
        return replace(self, time_s=self.time_s[turning], torque_Nm=self.torque_Nm[turning])

    def in_runs(self) -> Evidence:
        """Take samples in a few runs over the time at which the shaft turns, in which torque is filtered over time."""
        _, omega, _, good = self.track.at(self.time_s)
        turning = self.time_s[good & (np.abs(omega) > self.slow_rad_s)]
        if turning.size < _RUNS or self.time_s[-1] - self.time_s[0] <= _RUNS * _RUN_S:
            return self
        inside = np.zeros(self.time_s.size, np.bool_)
        for k in range(_RUNS):
            start = float(turning[k * turning.size // _RUNS])
            inside |= (self.time_s >= start) & (self.time_s <= start + _RUN_S)
        return replace(self, time_s=self.time_s[inside], torque_Nm=self.torque_Nm[inside])

    def in_blocks(self, whole_turns: bool = False) -> Evidence:
        """Return a copy that is fitted by averages over a tenth of a turn, or a turn, at working speed.

        Averages of few samples are wider, up to a quarter of a turn, since a step between two samples is uncertain.
        """
        turn = TURN / abs(self.working_speed())
        samples = _FEWEST_IN_A_BLOCK * float(np.median(np.diff(self.time_s)))
        width = turn if whole_turns else max(turn / _BLOCKS_A_TURN, min(samples, turn / _FEWEST_BLOCKS))
        return replace(self, block_s=width)

    def weighed(self, values: FloatArray, good: BoolArray) -> tuple[FloatArray, BoolArray]:
        """Return values (m, k) at the samples or their block averages, as fitted, and a mask of the usable ones."""
        if not self.block_s:
            return values, good
        return blocks.means((self.time_s - self.time_s[0]) / self.block_s, values, good)

    def working_speed(self) -> float:
        """Usual speed of the shaft [rad/s]: the fast mode of the speeds of its turns.

        With the sign of the way it turns most; a shaft that rocks has its mean speed along the path.
        """
        turning = np.abs(self.track.omega_rad_s) > self.slow_rad_s
        if not turning.any():
            return math.nan
        along = self.track.omega_rad_s[turning]
        omega = _mean_of_turn(self.track.theta_rad[turning], np.abs(along))
        count, edges = np.histogram(omega, bins=20)
        place = int(np.argmax(count))
        inside = (omega >= edges[place]) & (omega <= edges[place + 1])
        return math.copysign(float(np.median(omega[inside])), float(np.sum(along)))

    def turns_in_both_directions(self) -> bool:
        """Return true if the shaft turns a share of the time in each direction."""
        return self.track.rocks


def turns_gone(theta: FloatArray) -> IntArray:
    """Number of each sample's turn (n,), from 0, along the total path of the shaft, forward or backward."""
    gone = np.cumsum(np.abs(np.diff(theta, prepend=theta[:1])))
    return np.asarray(np.floor((np.mod(theta[:1], TURN) + gone) / TURN), np.int64)


def _mean_of_turn(theta: FloatArray, omega: FloatArray) -> FloatArray:
    """Mean speed (n,) of each sample's turn, within which the speed may swing with the torque."""
    turn = turns_gone(theta)
    return np.asarray((np.bincount(turn, omega) / np.maximum(np.bincount(turn), 1))[turn])
