"""The step of an encoder that rounds, found as the common divisor of its readings."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.shaft.turns import TURN, split_turns

LOOK_AT = (12, 48, 192, 768)
"""Counts of readings at which the step is looked for."""
UNKNOWN_STEP_RAD = 0.012
"""Taken for the step until it is found: that of 9 bits."""
FINEST_STEP_RAD = 1e-6
ENOUGH_GAPS = 6
MOST_TRIED = 16
"""Stretches of readings of a sort, each with gaps enough, that are asked for their divisor: some have no outliers."""
MOST_TEETH = 3
"""From edge to edge, where all but every third are left out."""
MOST_FIT, FEWEST_FIT = 0.7, 0.3
"""Part of all gaps that are multiples of the step, and of any where there is none; in between it stays unknown."""


class StepFinder:
    """Collects readings until the encoder's step is found, or there is none.

    Args:
        period_rad: after which the encoder's counts come again.
        step: when it is told.
    """

    def __init__(self, period_rad: float = TURN, step: float | None = None) -> None:
        self._period = period_rad
        self._readings = self._stamps = np.zeros(0)
        self.step = step

    @property
    def wanted(self) -> int:
        """Readings until the next look; 0 when the search is over."""
        if self.step is not None:
            return 0
        return next((count - self._readings.size for count in LOOK_AT if count > self._readings.size), 0)

    def take(self, stamps: FloatArray, readings: FloatArray) -> float | None:
        """Take note of readings [rad], `wanted` at most; the step as they tell it, 0 for none, None while unknown."""
        self._stamps = np.concatenate([self._stamps, stamps])
        self._readings = np.concatenate([self._readings, readings])
        if self._readings.size not in LOOK_AT:
            return None
        step = encoder_step(self._stamps, self._readings, self._period)
        if step or self._readings.size == LOOK_AT[-1]:
            self.step = step
        if self._readings.size == LOOK_AT[-1] and step is None:  # hardly moved: begin again with what differs
            self._readings, first = np.unique(self._readings, return_index=True)
            self._readings, self._stamps = self._readings[: LOOK_AT[0] - 1], self._stamps[first[: LOOK_AT[0] - 1]]
        return step


def encoder_step(stamps: FloatArray, angles: FloatArray, period_rad: float = TURN) -> float | None:
    """The step that angles are multiples of, but for an offset and outliers; 0 for none, None when it is not clear.

    Args:
        stamps: (n,) times of the readings, rising, in any unit.
        angles: (n,) readings [rad], wrapped or not.
        period_rad: after which the encoder's counts come again.
    """
    within = split_turns(angles)[1] if period_rad == TURN else np.mod(angles, period_rad)
    grain = 16.0 * np.finfo(np.float64).eps * max(float(np.abs(angles).max()), 1.0)
    counting = _common_divisor(angles, grain)
    if counting and _is_rounding(stamps, angles, counting):
        return counting
    wrapped = _common_divisor(within, grain)
    if wrapped and _is_rounding(stamps, within, wrapped):
        return wrapped
    return None if counting is None else 0.0


def _common_divisor(values: FloatArray, grain: float) -> float | None:
    """What the gaps between most values are multiples of; 0 for nothing, None when it is not clear."""
    ordered, place, times = np.unique(values, return_index=True, return_counts=True)
    if np.sum(times[times > 1]) > MOST_FIT * values.size:  # a shaft at rest: what comes once are outliers
        ordered, place = ordered[times > 1], place[times > 1]
    gaps = np.diff(ordered)
    differs = gaps > max(10.0 * grain, FINEST_STEP_RAD)
    gaps, first = gaps[differs], np.sort(np.append(place[0], place[1:][differs]))
    if gaps.size < ENOUGH_GAPS:
        return None
    values, share, step = values[first], 0.0, 0.0
    for begin in _stretches(values):
        tried = _divisor(np.diff(np.sort(values[begin : begin + ENOUGH_GAPS + 1])), grain)
        fits = float(np.mean(_off_multiples(gaps, tried) <= _tolerance(tried, grain))) if tried else 0.0
        share, step = max((share, step), (fits, tried))
    if share < MOST_FIT:
        return None if share > FEWEST_FIT else 0.0
    gaps = gaps[_off_multiples(gaps, step) <= _tolerance(step, grain)]
    return float(np.sum(gaps) / np.sum(np.rint(gaps / step)))


def _stretches(values: FloatArray) -> IntArray:
    """Where to look for a divisor: all over the values, and around moves that are not usual, which tell most."""
    moves = np.abs(np.diff(values))
    odd = np.flatnonzero(np.abs(moves - np.median(moves)) > 1e-3 * np.median(moves)) - ENOUGH_GAPS // 2
    last = values.size - ENOUGH_GAPS - 1
    even = np.linspace(0, last, MOST_TRIED).astype(np.int64)
    some = odd[np.linspace(0, odd.size - 1, min(odd.size, MOST_TRIED)).astype(np.int64)]
    return np.unique(np.clip(np.concatenate([even, some]), 0, last))


def _is_rounding(stamps: FloatArray, angles: FloatArray, step: float) -> bool:
    """Whether a common divisor of the readings is an encoder's that rounds.

    Else it is that of the speed, then all moves are alike, but for those after which no reading is a multiple any more;
    or of the teeth whose edges are timed, then none is nothing, and over several teeth it takes longer.
    """
    fits = _are_multiples(angles, step)
    pairs = fits[1:] & fits[:-1]
    if not pairs.any():
        return False
    moves = np.diff(angles)[pairs]
    moves -= TURN * np.rint(moves / TURN)
    counts = np.rint(np.abs(moves) / step)
    most = np.sort(counts)[counts.size // 2]
    usual = counts == most
    if np.all(usual):
        return False
    return bool(np.any(counts == 0.0)) or most > MOST_TEETH or not _takes_longer(np.diff(stamps)[pairs], usual)


def _are_multiples(angles: FloatArray, step: float) -> BoolArray:
    """Which readings are multiples of the step, but for the offset that most of them share."""
    beyond = np.rint(100.0 * angles / step) % 100.0
    offset = np.argmax(np.bincount(beyond.astype(np.int64), minlength=100))
    return np.asarray(np.isin((beyond - offset) % 100.0, (99.0, 0.0, 1.0)))


def _takes_longer(intervals: FloatArray, usual: BoolArray) -> bool:
    """Whether the intervals of most moves that are not the usual one are longer than those of the usual one."""
    return bool(np.median(intervals[~usual]) > 1.25 * np.median(intervals[usual]))


def _divisor(gaps: FloatArray, grain: float) -> float:
    """What all gaps are multiples of (Euclid's algorithm on all at once); 0 for nothing."""
    step = float(gaps.min())
    while step >= FINEST_STEP_RAD:
        rest = _off_multiples(gaps, step)
        rest = rest[rest > _tolerance(step, grain)]
        if not rest.size:
            return step
        step = float(rest.min())
    return 0.0


def _off_multiples(gaps: FloatArray, step: float) -> FloatArray:
    return np.asarray(np.abs(gaps - np.rint(gaps / step) * step))


def _tolerance(step: float, grain: float) -> float:
    return 1e-3 * step + 8.0 * grain
