"""The step of an encoder that rounds, found as the common divisor of its readings."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.shaft.turns import TURN, split_turns

LOOK_AT = (12, 48, 192, 768)
"""Counts of readings at which the step is looked for."""
UNKNOWN_STEP_RAD = 0.012
"""Taken for the step until it is found: that of 9 bits."""
FINEST_STEP_RAD = 1e-6
ENOUGH_GAPS = 6
ONE_BY_ONE = 0.8
"""Part of the readings that are one step from the one before where edges are timed."""


class StepFinder:
    """Collects readings until the encoder's step is found, or there is none.

    Args:
        period_rad: after which the encoder's counts come again.
        step: when it is told.
    """

    def __init__(self, period_rad: float = TURN, step: float | None = None) -> None:
        self._period = period_rad
        self._readings = np.zeros(0)
        self.step = step

    @property
    def wanted(self) -> int:
        """Readings until the next look; 0 when the search is over."""
        if self.step is not None:
            return 0
        return next((count - self._readings.size for count in LOOK_AT if count > self._readings.size), 0)

    def take(self, readings: FloatArray) -> float | None:
        """Take note of readings [rad], `wanted` at most; the step as they tell it, 0 for none, None while unknown."""
        self._readings = np.concatenate([self._readings, readings])
        if self._readings.size not in LOOK_AT:
            return None
        step = encoder_step(self._readings, self._period)
        if step or self._readings.size == LOOK_AT[-1]:
            self.step = step
        if self._readings.size == LOOK_AT[-1] and step is None:  # hardly moved: begin again with what differs
            self._readings = np.unique(self._readings)[: LOOK_AT[0] - 1]
        return step


def encoder_step(angles: FloatArray, period_rad: float = TURN) -> float | None:
    """The step that all angles are multiples of, but for an offset; 0 when there is none, None when too few differ.

    Args:
        angles: (n,) readings [rad] in time order, wrapped or not.
        period_rad: after which the encoder's counts come again.
    """
    step = _common_step(angles, angles)
    if step:
        return step
    within = split_turns(angles)[1] if period_rad == TURN else np.mod(angles, period_rad)
    return _common_step(angles, within) or step


def _common_step(angles: FloatArray, values: FloatArray) -> float | None:
    grain = 16.0 * np.finfo(np.float64).eps * max(float(np.abs(angles).max()), 1.0)
    gaps = np.diff(np.unique(values))
    gaps = gaps[gaps > max(10.0 * grain, FINEST_STEP_RAD)]
    if gaps.size < ENOUGH_GAPS:
        return None
    step = float(gaps.min())
    while True:  # Euclid's algorithm on all gaps at once
        rest = np.abs(gaps - np.rint(gaps / step) * step)
        rest = rest[rest > 1e-3 * step + 8.0 * grain]
        if rest.size <= 0.02 * gaps.size:
            break
        step = float(rest.min())
        if step < FINEST_STEP_RAD:
            return 0.0
    multiples = np.rint(gaps / step)
    step = float(np.sum(gaps) / np.sum(multiples))
    moves = np.diff(angles)
    moves -= TURN * np.rint(moves / TURN)
    if np.all(moves != 0.0) and np.mean(np.abs(np.abs(moves) - step) < 0.01 * step) > ONE_BY_ONE:
        return 0.0  # edges that come one by one, with gaps of missing teeth: nothing is rounded
    rounding = float(np.std(np.diff(moves)))
    if float(np.median(np.abs(moves))) >= step and rounding < 0.3 * step:
        return 0.0  # readings in step with the sampling: the common divisor is not the encoder's
    return step
