"""Measured torque beside the torque that any settings of the sensors would give: the record as the fits use it."""

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
from textile_twin_core.inference.robust import robust_scale

_MOST_SAMPLES = 8000
REST_SHARE = 0.05
"""Of the fast end of the speeds: below it the shaft counts as at rest."""
_ONE_SPEED = 0.08
_JUMP_GUARD_S = 0.001
"""Samples this near to a jump of the load cannot tell its side."""
_BLOCKS_A_TURN = 10.0
_PARTS = 32
"""Of a sample's interval, over which the load is averaged."""


@dataclass(frozen=True)
class Settings:
    """Encoder, torque sensor, and what is added to the machine.

    measured(t) = gain * torque(t - late) + offset with late = delay + drift * (t - middle of the time in which the
    shaft turns); the shaft's angle is direction * ratio * (angle of the track) - zero.

    Attributes:
        direction, ratio: beside the track's own.
        zero_rad: in shaft angle.
        gain, offset_Nm, delay_s: of the torque sensor. drift: seconds by which the delay grows each second.
        load: factor on the declared loads. constant_Nm, viscous_Nms: friction beside the declared one.
        inertia_kgm2: of the shaft beside the declared one.
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
        """The same with other values for some of the continuous settings."""
        return replace(self, **dict[str, Any](values))


@dataclass(frozen=True)
class States:
    """The shaft's states at the measured samples under some settings, (m,) each.

    good: where they can be used. sudden: where a jump of the load is too near to tell its side.
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

    leaps: time [s] and size [rad] of leaps of the angle, of which the track ends or begins at one.
    at_ends_Nm: measured torques at an end of their sensor's range, which are not among the others.
    block_s: width of blocks (see `in_blocks`), or 0.
    governed: the torque follows the speed, so that it makes no jump with the load.
    """

    time_s: FloatArray
    torque_Nm: FloatArray
    track: ShaftTrack
    terms: TorqueTerms
    middle_s: float
    leaps: tuple[tuple[float, float], ...] = ()
    at_ends_Nm: FloatArray = field(default_factory=lambda: np.empty(0))
    block_s: float = 0.0
    governed: bool = False
    rest_rad_s: float = field(init=False)
    _seen: dict[tuple[float, float], tuple[FloatArray, FloatArray, FloatArray, BoolArray]] = field(
        init=False, repr=False, compare=False, default_factory=dict
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "rest_rad_s", REST_SHARE * self.track.fast_rad_s)

    def thinned(self, most: int = _MOST_SAMPLES, at_one_speed: bool = False) -> Evidence:
        """The same with at most that many samples while the shaft turns, or turns at working speed, evenly taken."""
        theta, omega, _, good = self.track.at(self.time_s)
        wanted = np.abs(omega) > self.rest_rad_s
        turning = np.flatnonzero(good & wanted)
        if at_one_speed:
            away = _mean_of_turn(theta[turning], omega[turning]) - self.working_speed()
            turning = turning[np.abs(away) < _ONE_SPEED * abs(self.working_speed())]
        if self.block_s and turning.size:
            turning = turning[blocks.fewer(turning.size, self.block_s / float(np.median(np.diff(self.time_s))), most)]
        elif turning.size > most:
            turning = turning[np.linspace(0, turning.size - 1, most).astype(np.int64)]
        return replace(self, time_s=self.time_s[turning], torque_Nm=self.torque_Nm[turning])

    def in_blocks(self, governed: bool = False, whole_turns: bool = False) -> Evidence:
        """The same to be weighed by means over a tenth of a turn, or a turn, at working speed instead of by samples."""
        width = TURN / (1.0 if whole_turns else _BLOCKS_A_TURN) / abs(self.working_speed())
        return replace(self, block_s=width, governed=governed)

    def weighed(self, values: FloatArray, good: BoolArray) -> tuple[FloatArray, BoolArray]:
        """What the fits weigh of values (m, k) at the samples, and where it counts: themselves, or means of blocks."""
        if not self.block_s:
            return values, good
        return blocks.means((self.time_s - self.time_s[0]) / self.block_s, values, good)

    def scale(self, residual: FloatArray) -> float:
        """Scale of Huber's loss for a residual (m,) as weighed."""
        return blocks.scale(residual) if self.block_s else robust_scale(residual)

    def left(self, settings: Settings, states: States) -> tuple[FloatArray, BoolArray]:
        """Measured less expected torque as the fits weigh it [N m], and where it counts."""
        residual, good = self.weighed((self.torque_Nm - self.expected(settings, states))[:, None], states.good)
        return residual[:, 0], good

    def states(self, settings: Settings) -> States:
        """The shaft and the parts of its torque at the instants of which the measured samples speak."""
        theta, omega, alpha, good = self._at(settings.delay_s, settings.drift)
        turn = settings.direction * settings.ratio
        theta, omega, alpha = turn * theta - settings.zero_rad, turn * omega, turn * alpha
        # Friction sets in well below the speed from which a sample counts, so that no shift moves a whole torque.
        rest = 0.5 * settings.ratio * self.rest_rad_s
        terms = self.terms.at(theta, omega, alpha, rest)
        usable = good & (np.abs(omega) > 1.2 * rest) & np.isfinite(terms.total)
        if self.governed:
            terms = self._with_mean_load(terms, theta, omega, alpha)
            return States(theta, omega, alpha, terms, usable, np.zeros_like(usable))
        sudden = self.terms.near_jump(theta, omega, _JUMP_GUARD_S)
        # In a block both sides even out, and what a jump sets going must be there.
        return States(theta, omega, alpha, terms, usable if self.block_s else usable & ~sudden, sudden)

    def _with_mean_load(self, terms: Terms, theta: FloatArray, omega: FloatArray, alpha: FloatArray) -> Terms:
        """Terms whose load is the mean over each sample's interval: a torque that follows the speed makes no jump."""
        interval = float(np.median(np.diff(self.time_s)))
        beside = np.flatnonzero(self.terms.near_jump(theta, omega, 0.5 * interval))
        shift = interval * ((np.arange(_PARTS) + 0.5) / _PARTS - 0.5)
        angles = (theta[beside, None] + omega[beside, None] * shift).ravel()
        speeds, rates = np.repeat(omega[beside], _PARTS), np.repeat(alpha[beside], _PARTS)
        load = terms.load.copy()
        load[beside] = self.terms.at(angles, speeds, rates, 0.0).load.reshape(-1, _PARTS).mean(axis=1)
        return replace(terms, load=load)

    def _at(self, delay_s: float, drift: float) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
        """The track at the instants of which the samples speak; kept once, since zeros are tried by dozens."""
        if (delay_s, drift) not in self._seen:
            self._seen.clear()
            self._seen[delay_s, drift] = self.track.at(self.time_s - delay_s - drift * (self.time_s - self.middle_s))
        return self._seen[delay_s, drift]

    def expected(self, settings: Settings, states: States) -> FloatArray:
        """What the torque sensor would show [N m]."""
        parts = states.terms
        torque = parts.mechanism + settings.load * parts.load + parts.friction
        torque = torque + settings.constant_Nm * parts.direction + settings.viscous_Nms * states.omega
        torque = torque + settings.inertia_kgm2 * states.alpha
        return settings.gain * torque + settings.offset_Nm

    def working_speed(self) -> float:
        """The speed at which the shaft mostly turns, with its sign: the fast mode of its turns' speeds [rad/s]."""
        turning = np.abs(self.track.omega_rad_s) > self.rest_rad_s
        if not turning.any():
            return math.nan
        omega = _mean_of_turn(self.track.theta_rad[turning], self.track.omega_rad_s[turning])
        count, edges = np.histogram(omega, bins=20)
        place = int(np.argmax(count))
        inside = (omega >= edges[place]) & (omega <= edges[place + 1])
        return float(np.median(omega[inside]))

    def turns_both_ways(self) -> bool:
        """Whether the shaft turns a share of the time in either direction."""
        omega = self.track.omega_rad_s[np.abs(self.track.omega_rad_s) > self.rest_rad_s]
        share = float(np.mean(omega > 0.0)) if omega.size else 0.0
        return 0.05 < share < 0.95


def turns_gone(theta: FloatArray) -> IntArray:
    """Each sample's turn (n,) from 0 on, counted along the way that the shaft went, back and forth alike."""
    gone = np.cumsum(np.abs(np.diff(theta, prepend=theta[:1])))
    return np.asarray(np.floor((np.mod(theta[:1], TURN) + gone) / TURN), np.int64)


def _mean_of_turn(theta: FloatArray, omega: FloatArray) -> FloatArray:
    """The mean speed (n,) of each sample's turn: within one the speed may swing with the torque."""
    turn = turns_gone(theta)
    return np.asarray((np.bincount(turn, omega) / np.maximum(np.bincount(turn), 1))[turn])
