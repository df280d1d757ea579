"""Sensors: the step of an encoder, the common divisor of its moves, and the pitch errors of a toothed wheel."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.shaft.turns import TURN

LOOK_AT = (12, 24, 48, 192, 768)  # numbers of readings at which the step is searched
UNKNOWN_STEP_RAD = 0.012  # assumed until the step is known: 9 bits
FINEST_STEP_RAD = 1e-6  # readings of a finer step count as not rounded
OUTLIER_RAD = 0.05  # a reading further than this from the median of five is ignored
SAME_TIME = 1.2  # ratio of two intervals up to which they count as equal
WINDOW = 4  # changes of a move whose greatest common divisor is a candidate
CANDIDATES = 32  # number of such windows
DIFFERENT = 8  # moves of this many numbers of steps have a larger divisor by chance in one case of 250
# part of the moves that must be multiples of the step; where readings are rounded twice
MIN_SHARE, MOST_SHARE = 0.75, 0.95
TWICE_ROUNDED = 4.0  # least number of units in a step that can be identified behind them
BY_CHANCE = 0.004  # probability of chance, for moves of that many numbers of steps near their multiples
TOLERANCE, TOLERANCE_RAD = 1e-3, 1e-7  # of a multiple: part of the step, and rounding of floating-point angles
MAX_ERROR = 0.3  # part of the pitch; a larger median residual is no pitch error
FORGETTING = 0.01  # decay of an error at each pass, so that a spurious error fades


class StepFinder:
    """Search of the encoder's step in the readings so far, until it is known.

    Equal moves look like single steps: until moves differ, the search repeats with more readings.

    Args:
        period_rad: period of a wrapped angle.
        step: the configured step [rad]; None: unknown.
    """

    def __init__(self, period_rad: float = TURN, step: float | None = None) -> None:
        self._period = period_rad
        self._readings = self._stamps = np.zeros(0)
        self._known = step is not None
        self.step = step

    @property
    def wanted(self) -> int:
        """Readings until the next search; 0 when the search has ended."""
        if self._known:
            return 0
        return min(count - self._readings.size for count in LOOK_AT if count > self._readings.size)

    def take(self, stamps: FloatArray, readings: FloatArray) -> float | None:
        """Add readings (n,) [rad], n at most `wanted`; return the step [rad] if it changed (0: none), else None."""
        self._stamps = np.concatenate([self._stamps, stamps])
        self._readings = np.concatenate([self._readings, readings])
        if self._readings.size not in LOOK_AT:
            return None
        step, before = encoder_step(self._stamps, self._readings, self._period), self.step
        self.step = before if step is None else step
        last = self._readings.size == LOOK_AT[-1]
        sure = self.step is not None and self.step > 0.0 and not _is_decimal(self.step)
        self._known = self.step is not None and (last or (sure and self._has_different_moves(self.step)))
        if self._known or last:
            self._readings = self._stamps = np.zeros(0)  # the shaft hardly moved: the search restarts
        same = step is None or (before is not None and abs(step - before) <= TOLERANCE * before)
        return None if same else step

    def _has_different_moves(self, step: float) -> bool:
        moves = np.rint(np.abs(np.diff(np.unwrap(self._readings, period=self._period))) / step)
        return np.unique(moves[moves > 0.0]).size >= DIFFERENT


def _is_decimal(step: float) -> bool:
    """Return whether a step [rad] is a power of ten in radians or degrees: it may come from the log alone."""
    places = np.log10([step, np.rad2deg(step)])
    return bool(np.any(np.abs(places - np.rint(places)) < TOLERANCE))


def encoder_step(stamps: FloatArray, angles: FloatArray, period_rad: float = TURN) -> float | None:
    """Estimate the step [rad] to which angles were rounded, whatever their offset.

    Moves from reading to reading differ by multiples of the step. Only moves in equal intervals are compared: at a
    steady speed these are equal, and from edge to edge of a toothed wheel a longer move takes longer.

    Args:
        stamps: (n,) times of the readings, rising, in any unit.
        angles: (n,) readings [rad], wrapped or not, some of them outliers.
        period_rad: period of a wrapped angle.

    Returns:
        The step; 0 for angles that are not rounded; None where the readings do not decide.
    """
    if np.ptp(angles) < 1.25 * period_rad:
        angles = np.unwrap(angles, period=period_rad)
    medians = np.median(sliding_window_view(np.pad(angles, 2, mode="edge"), 5), axis=1)
    inliers = np.abs(angles - medians) < OUTLIER_RAD
    intervals, moves = np.diff(stamps[inliers]), np.abs(np.diff(angles[inliers]))
    moving = moves[moves > FINEST_STEP_RAD]
    no_step = 0.0 if moving.size > 0.5 * moves.size else None  # angles without rounding do not repeat
    shorter, longer = np.sort([intervals[1:], intervals[:-1]], axis=0)
    changes = np.abs(np.diff(moves))[longer < SAME_TIME * shorter]
    changes = changes[changes > FINEST_STEP_RAD]
    if changes.size < WINDOW:
        return no_step if changes.size == 0 and moves.size >= LOOK_AT[1] else None  # moves may be equal for long
    windows = sliding_window_view(changes, WINDOW)
    steps = _common_divisors(windows[np.linspace(0, len(windows) - 1, CANDIDATES).astype(np.int64)])
    multiples = (_remainders(moving, steps) == 0.0) & (moving > 0.5 * steps) & (steps > FINEST_STEP_RAD)
    shares = np.mean(multiples, axis=1)
    step = float(steps[np.argmax(shares), 0])
    if shares.max() > MIN_SHARE and np.unique(np.rint(moving / step)).size == 1 and stamps.size < LOOK_AT[-1]:
        return None  # equal moves may be many steps
    found = step if shares.max() > MIN_SHARE else no_step
    return found if found is None else _step_behind(max(found, FINEST_STEP_RAD), moving, changes) or found


def _step_behind(unit: float, moves: FloatArray, changes: FloatArray) -> float | None:
    """Estimate the step [rad] of readings that were rounded once more, to `unit`, as by the decimals of a log.

    Moves are then within a unit, and their changes within two, of multiples of the step. None where chance explains it.
    """
    several = changes[changes > 2.5 * unit]
    step = float(np.median(several[several <= several.min() + 2.5 * unit])) if several.size else 0.0
    if moves.size == 0 or step < TWICE_ROUNDED * unit:
        return None
    for most in (1.0, 4.0, 16.0, 64.0, math.inf):  # a difference of more steps determines the step better
        used = several if most < 16.0 else np.concatenate([several, moves])
        counts = np.rint(used / step)
        counts = np.where(counts <= most, counts, 0.0)
        step = float(counts @ used / (counts @ counts))
    counts = np.rint(moves / step)
    inside = np.abs(moves - counts * step) < 1.01 * unit + TOLERANCE_RAD
    chance = (2.0 * unit / step) ** (np.unique(counts[inside]).size - 1)
    return step if np.mean(inside) > MOST_SHARE and chance < BY_CHANCE else None


def _common_divisors(values: FloatArray) -> FloatArray:
    """Return the greatest common divisors (n, 1) of rows of values (n, k), by Euclid's algorithm; tiny without one."""
    step = values.max(axis=1, keepdims=True)
    while (remainder := _remainders(values, step)).any():
        step = np.where(remainder > 0.0, remainder, step).min(axis=1, keepdims=True)
    counts = np.rint(values / step)
    return np.asarray(values.sum(axis=1, keepdims=True) / counts.sum(axis=1, keepdims=True))


def _remainders(values: FloatArray, step: FloatArray) -> FloatArray:
    """Return the distances [rad] from the nearest multiples of the step; 0 within the tolerance."""
    remainder = np.abs(values - np.rint(values / step) * step)
    return np.where(remainder > TOLERANCE * step + TOLERANCE_RAD, remainder, 0.0)


class ToothWheel:
    """Nominal angles of a wheel's edges, corrected by each tooth's pitch error.

    An error that repeats every turn can belong to the wheel or to the motion, see `residual_orders`.

    Args:
        teeth: number of teeth in a turn, missing ones counted.
        zero_rad: angle of tooth 0.
        known: (teeth,) pitch errors [rad]; None: estimated.
    """

    def __init__(self, teeth: int, zero_rad: float, known: Sequence[float] | None) -> None:
        self._pitch, self._zero = TURN / teeth, zero_rad
        self.learning = known is None
        self.errors_rad: FloatArray = np.zeros(teeth) if known is None else np.asarray(known, dtype=np.float64)

    def _tooth(self, angles: FloatArray) -> IntArray:
        place = np.rint((np.nan_to_num(angles, posinf=0.0, neginf=0.0) - self._zero) / self._pitch)
        return np.asarray(place % self.errors_rad.size, dtype=np.int64)

    def corrected(self, angles: FloatArray) -> FloatArray:
        """Return the shaft angles (n,) [rad] at edges of these nominal angles (n,)."""
        return angles + self.errors_rad[self._tooth(angles)]

    def learn(self, readings: FloatArray, residuals: FloatArray) -> FloatArray:
        """Correct each tooth's error by the median residual of its readings, relative to the median of all.

        Residuals of outliers count as well: a tooth may stand so wrong that all of its readings were rejected.

        Args:
            readings: (n,) corrected readings [rad], at least one.
            residuals: (n,) readings less the smoothed angles [rad].

        Returns:
            (n,) further correction of each reading [rad].
        """
        tooth = self._tooth(readings)
        order = np.argsort(tooth)
        of_tooth = np.split(residuals[order], np.searchsorted(tooth[order], np.arange(1, self.errors_rad.size)))
        found = np.array([np.median(values) if values.size else 0.0 for values in of_tooth]) - np.median(residuals)
        found[np.abs(found) > MAX_ERROR * self._pitch] = 0.0
        change = -FORGETTING * self.errors_rad - found
        self.errors_rad = self.errors_rad + change
        return np.asarray(change[tooth])
