"""Counts of an encoder behind readings that a log has rounded once more, to decimals of some unit.

Readings of N counts a turn lie on the lattice k turn / N + offset, and rounding moves each by half a unit at most. The
mean of exp(2 pi i N x) over readings x [turns] is then near 1 in size; one Fourier transform of their histogram gives
it for all N at once. The smallest N for which nearly all readings keep to the half unit is the encoder's. Where a count
is wider than the unit, the lattice point next to a reading is the encoder's own reading.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.shaft.turns import TURN

DECIMALS = range(1, 8)
WHOLE = 1e-4  # part of a unit's last decimal within which a number counts as rounded to it
MOSTLY = 0.9  # part of the moves that must be rounded; moves across a wrap in radians are not
FINEST = 2**19  # cells of a turn; counts are at most a quarter of them
LEAST_COUNTS, LEAST_MEAN = 64, 0.2  # a turn; size of the mean from which counts are candidates
LEAST_DISTINCT = 48  # distinct counts that the readings must show
MOST_COVERED = 0.75  # maximum part of a count that the rounding covers
INSIDE, BEYOND = 0.95, 1.1  # part of the readings that must lie on the lattice; within this many half units
MOST_LIKELY = 256  # maximum number of candidates
READINGS = 8192  # moving readings that are used
# units in a third difference, of which smooth motion has fewer than 4; part of them beyond
BEYOND_UNITS, LEAST_ROUGH = 3.5, 0.02


@dataclass(frozen=True)
class CountLattice:
    """The readings that an encoder can give.

    Attributes:
        counts: of a turn.
        offset: of the readings from whole counts, part of a count.
        within: distance from the lattice up to which a reading is a rounded count, part of a count.
    """

    counts: int
    offset: float
    within: float

    def restored(self, angles: FloatArray) -> FloatArray:
        """Return the encoder's own readings [rad] behind rounded ones (n,); a reading off the lattice stays."""
        place = angles / TURN * self.counts - self.offset
        count = np.rint(place)
        own = (count + self.offset) / self.counts * TURN
        return np.where(np.abs(place - count) <= self.within, own, angles)


def decimal_unit(angles: FloatArray, turn: float) -> float | None:
    """Return the last decimal [turns] to which angles (n,) [rad] were rounded, a turn being `turn` units of the log."""
    moves = np.abs(np.diff(angles)) / TURN
    moves = moves[(moves > 1e-9) & (moves < 0.5)]
    if moves.size < LEAST_DISTINCT:
        return None
    for decimals in DECIMALS:
        unit = 10.0**-decimals / turn
        counts = moves / unit
        # A unit close to the rounding of floating-point angles would match by chance.
        if unit * WHOLE > 1e-14 and np.mean(np.abs(counts - np.rint(counts)) < WHOLE) > MOSTLY:
            return unit
    return None


def count_lattice(angles: FloatArray, turn: float) -> CountLattice | None:
    """Estimate an encoder's counts behind angles that were rounded to decimals.

    Args:
        angles: (n,) unwrapped readings [rad], whatever their offset.
        turn: a turn in the unit of the log, such as 360.

    Returns:
        The lattice of the counts; None where the angles are not rounded or show no counts.
    """
    moving = np.flatnonzero(np.diff(angles) != 0.0)[:READINGS]
    if moving.size < LEAST_DISTINCT:
        return None
    unit = decimal_unit(angles[moving], turn)
    turns = np.zeros(0) if unit is None else np.unique(np.mod(angles[moving] / TURN, 1.0))
    if unit is None or turns.size < LEAST_DISTINCT:
        return None
    if _roughness(angles[: moving[-1] + 2] / TURN, unit) < LEAST_ROUGH:
        return None
    cells = np.bincount((turns * FINEST).astype(np.int64) % FINEST, minlength=FINEST)
    mean = np.abs(np.fft.rfft(cells))[: FINEST // 4] / turns.size
    counts = np.arange(LEAST_COUNTS, min(FINEST // 4 - 1, int(MOST_COVERED / unit)) + 1)
    likely = counts[mean[counts] > max(LEAST_MEAN, 5.0 / np.sqrt(turns.size))]
    tried = (_lattice(turns, int(each), unit) for each in likely[:MOST_LIKELY])
    return next((lattice for lattice in tried if lattice is not None), None)


def _roughness(turns: FloatArray, unit: float) -> float:
    """Return the part of the third differences of readings (n,) that rounding to a unit alone cannot explain."""
    third = np.diff(turns, 3)
    moving = np.lib.stride_tricks.sliding_window_view(np.diff(turns) != 0.0, 3).any(axis=1)
    return float(np.mean(np.abs(third[moving]) > BEYOND_UNITS * unit)) if moving.any() else 0.0


def _lattice(turns: FloatArray, counts: int, unit: float) -> CountLattice | None:
    """Return the lattice of `counts` if readings (n,) [turns] lie on it within half a unit and show enough of it."""
    at = turns * counts
    offset = float(np.angle(np.mean(np.exp(2j * np.pi * at)))) / (2.0 * np.pi)
    place = at - offset
    distance = np.abs(place - np.rint(place))
    within = BEYOND * 0.5 * unit * counts + 1e-6 * counts / FINEST
    distinct = np.unique(np.rint(place)).size
    # Evenly spread readings would lie on it with the probability 2 within.
    good = np.mean(distance <= within) > INSIDE and distinct >= LEAST_DISTINCT and 2.0 * within < 0.85
    return CountLattice(counts, offset, within) if good else None
