"""Measured torque and the torque expected under given settings of the sensors: the record for the fits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.shaft_track import TURN, ShaftTrack
from textile_twin_core.comparison.torque_terms import Terms, TorqueTerms
from textile_twin_core.inference import blocks
from textile_twin_core.inference.record import Ripple
from textile_twin_core.inference.robust import robust_scale

_MOST_SAMPLES = 8000
REST_SHARE = 0.05
"""Share of the fast end of the speeds below which the shaft counts as standing still."""
_ONE_SPEED = 0.08
_JUMP_GUARD_S = 0.001
"""Samples this close to a discontinuity of the load may lie on either side of it."""
_BLOCKS_A_TURN = 10.0
_PARTS = 32
"""Points in a sample's interval over which the load is averaged."""
_RUNS, _RUN_S = 4, 4.0
"""Number and length [s] of the runs in which torque is filtered over time."""
_ORDERS = 12
"""Highest order of the shaft in `best_periodic`."""


@dataclass(frozen=True)
class Settings:
    """Settings of encoder and torque sensor, and additions to the machine.

    measured(t) = gain * torque(t - late) + offset with late = delay + drift * (t - middle of the time in which the
    shaft turns); the shaft's angle is direction * ratio * (angle of the track) - zero.

    Attributes:
        direction, ratio: factors on the track's own.
        zero_rad: in shaft angle.
        gain, offset_Nm, delay_s: of the torque sensor. drift: growth of the delay in seconds per second.
        load: factor on the declared loads. constant_Nm, viscous_Nms: friction added to the declared one.
        inertia_kgm2: of the shaft, added to the declared one.
    """

    direction: int = 1
    ratio: float = 1.0
    zero_rad: float = 0.0
    gain: float = 1.0
    offset_Nm: float = 0.0
    delay_s: float = 0.0
    drift: float = 0.0
    load: float = 1.0
    constant_Nm: float = 0.0
    viscous_Nms: float = 0.0
    inertia_kgm2: float = 0.0

    def changed(self, values: Mapping[str, float]) -> Settings:
        """Return a copy with other values of some continuous settings."""
        return replace(self, **dict[str, Any](values))


@dataclass(frozen=True)
class States:
    """States of the shaft at the measured samples under some settings, (m,) each.

    good: true where usable. sudden: true where a discontinuity of the load is so close that its side is uncertain.
    """

    theta: FloatArray
    omega: FloatArray
    alpha: FloatArray
    terms: Terms
    good: BoolArray
    sudden: BoolArray


@dataclass(frozen=True)
class Evidence:
    """Measured torque (m,) over time [s], the shaft's track, and the machine's parts of the torque.

    slips: time [s] and size [rad] of slips of the angle; the track begins or ends at one of them.
    at_ends_Nm: measured torques at an end of the sensor's range, left out of the others.
    block_s: width of the block averages (see `in_blocks`), or 0.
    speed_controlled: the drive is speed-controlled, so its torque is continuous where the load is not.
    encoder_turn_rad: shaft angle of one turn of the encoder.
    ripple: of the motion, and its uncertainty (see `uncertain_ripple`).
    """

    time_s: FloatArray
    torque_Nm: FloatArray
    track: ShaftTrack
    terms: TorqueTerms
    middle_s: float
    slips: tuple[tuple[float, float], ...] = ()
    at_ends_Nm: FloatArray = field(default_factory=lambda: np.empty(0))
    block_s: float = 0.0
    speed_controlled: bool = False
    encoder_turn_rad: float = TURN
    ripple: Ripple = field(default_factory=Ripple)
    slow_rad_s: float = field(init=False)
    _seen: dict[tuple[float, float], tuple[FloatArray, FloatArray, FloatArray, BoolArray]] = field(
        init=False, repr=False, compare=False, default_factory=dict
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "slow_rad_s", REST_SHARE * self.track.fast_rad_s)

    def thinned(self, most: int = _MOST_SAMPLES, at_one_speed: bool = False) -> Evidence:
        """Take at most `most` samples, evenly over the time at which the shaft turns, or turns at working speed."""
        theta, omega, _, good = self.track.at(self.time_s)
        wanted = np.abs(omega) > self.slow_rad_s
        turning = np.flatnonzero(good & wanted)
        if at_one_speed:
            away = _mean_of_turn(theta[turning], np.abs(omega[turning])) - abs(self.working_speed())
            turning = turning[np.abs(away) < _ONE_SPEED * abs(self.working_speed())]
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

    def in_blocks(self, speed_controlled: bool = False, whole_turns: bool = False) -> Evidence:
        """Return a copy that is fitted by averages over a tenth of a turn, or a turn, at working speed."""
        width = TURN / (1.0 if whole_turns else _BLOCKS_A_TURN) / abs(self.working_speed())
        return replace(self, block_s=width, speed_controlled=speed_controlled)

    def weighed(self, values: FloatArray, good: BoolArray) -> tuple[FloatArray, BoolArray]:
        """Return values (m, k) at the samples or their block averages, as fitted, and a mask of the usable ones."""
        if not self.block_s:
            return values, good
        return blocks.means((self.time_s - self.time_s[0]) / self.block_s, values, good)

    def scale(self, residual: FloatArray) -> float:
        """Scale of Huber's loss for a residual (m,) from `weighed`."""
        return blocks.scale(residual) if self.block_s else robust_scale(residual)

    def states(self, settings: Settings) -> States:
        """Evaluate the shaft and the parts of its torque at the instants of the samples less the delay."""
        theta, omega, alpha, good = self._at(settings.delay_s, settings.drift)
        turn = settings.direction * settings.ratio
        theta, omega, alpha = turn * theta - settings.zero_rad, turn * omega, turn * alpha
        # Friction sets in well below the speed from which samples count, so a small shift cannot switch all of it.
        slow = 0.5 * settings.ratio * self.slow_rad_s
        terms = self.terms.at(theta, omega, alpha, slow)
        usable = good & (np.abs(omega) > 1.2 * slow) & np.isfinite(terms.total)
        if self.speed_controlled:
            terms = self._with_mean_load(terms, theta, omega, alpha)
            return States(theta, omega, alpha, terms, usable, np.zeros_like(usable))
        sudden = self.terms.near_step(theta, omega, _JUMP_GUARD_S)
        # A block average holds both sides of a discontinuity and needs the samples just after it.
        return States(theta, omega, alpha, terms, usable if self.block_s else usable & ~sudden, sudden)

    def _with_mean_load(self, terms: Terms, theta: FloatArray, omega: FloatArray, alpha: FloatArray) -> Terms:
        """Average the load over each sample's interval: a speed-controlled drive smooths its discontinuities."""
        interval = float(np.median(np.diff(self.time_s)))
        beside = np.flatnonzero(self.terms.near_step(theta, omega, 0.5 * interval))
        shift = interval * ((np.arange(_PARTS) + 0.5) / _PARTS - 0.5)
        angles = (theta[beside, None] + omega[beside, None] * shift).ravel()
        speeds, rates = np.repeat(omega[beside], _PARTS), np.repeat(alpha[beside], _PARTS)
        load = terms.load.copy()
        load[beside] = self.terms.at(angles, speeds, rates, 0.0).load.reshape(-1, _PARTS).mean(axis=1)
        return replace(terms, load=load)

    def _at(self, delay_s: float, drift: float) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
        """Evaluate the track at the samples less the delay; cached, since dozens of zeros are tried."""
        if (delay_s, drift) not in self._seen:
            self._seen.clear()
            self._seen[delay_s, drift] = self.track.at(self.time_s - delay_s - drift * (self.time_s - self.middle_s))
        return self._seen[delay_s, drift]

    def expected(self, settings: Settings, states: States) -> FloatArray:
        """Expected reading of the torque sensor [N m]."""
        parts = states.terms
        torque = parts.mechanism + settings.load * parts.load + parts.friction
        torque = torque + settings.constant_Nm * parts.direction + settings.viscous_Nms * states.omega
        torque = torque + settings.inertia_kgm2 * states.alpha
        return settings.gain * torque + settings.offset_Nm

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


def best_periodic(evidence: Evidence, settings: Settings) -> float:
    """Share of the torque's mean square about its mean that J(theta) alpha + C(theta) omega^2 + G(theta) can explain.

    J, C and G are any functions with orders up to 12 (J: 4) of the shaft angle, by least squares.
    """
    states = evidence.states(settings)
    good = states.good
    theta, torque = states.theta[good], evidence.torque_Nm[good]
    omega = states.omega[good] / max(abs(evidence.working_speed()), 1e-300)
    alpha = states.alpha[good] / max(float(np.std(states.alpha[good])), 1e-300)
    waves = [np.ones_like(theta)]
    for order in range(1, _ORDERS + 1):
        waves += [np.cos(order * theta), np.sin(order * theta)]
    columns = [*waves, *(wave * omega**2 for wave in waves), *(wave * alpha for wave in waves[:9])]
    matrix = np.stack(columns, axis=1)
    found = np.linalg.lstsq(matrix, torque, rcond=1e-8)[0]
    residual = torque - matrix @ found
    freedom = max(torque.size - matrix.shape[1], 1)
    unexplained = float(residual @ residual) / freedom
    return float(1.0 - unexplained / max(float(np.var(torque)), 1e-300))
