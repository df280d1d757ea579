"""The counts of an encoder behind readings that a log has rounded once more, to so many decimals of some unit.

Readings of N counts a turn lie on the lattice k turn / N + offset, and rounding moves each by half a unit at most. The
mean of exp(2 pi i N x) over readings x [turns] is then near 1 in size; one Fourier transform of their histogram gives
it for all N at once. The smallest N for which nearly all readings keep to the half unit is the encoder's.
"""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.shaft.turns import TURN

UNITS = (360.0, 1.0, 400.0, TURN)  # of a turn: degrees, turns, gon, radians
DECIMALS = range(1, 8)
WHOLE = 1e-4  # of a unit's last decimal, within which a number counts as rounded to it
MOSTLY = 0.9  # part of the moves that must be rounded; at a wrap of radians they are not
FINEST = 2**19  # cells of a turn; a quarter of them are the most counts
LEAST_COUNTS, LEAST_MEAN = 64, 0.2  # a turn; size of the mean for which counts are looked at
LEAST_DISTINCT = 48  # counts that the readings must show
MOST_COVERED = 0.75  # part of a count that the rounding may cover
INSIDE, BEYOND = 0.95, 1.1  # part of the readings that must keep to the lattice; within so many half units
MOST_LIKELY = 256  # candidates that are tried


def decimal_units(angles: FloatArray, period_rad: float = TURN, turn: float | None = None) -> list[float]:
    """The units [turns], coarsest first, of last decimals to which angles (n,) [rad] may have been rounded.

    Args:
        angles: readings, wrapped or not.
        period_rad: a turn of the encoder as an angle of the shaft.
        turn: what a turn counts in the unit of the log; None: in any of UNITS.
    """
    moves = np.abs(np.diff(angles)) / period_rad
    moves = moves[(moves > 1e-9) & (moves < 0.5)]
    found: list[float] = []
    if moves.size < LEAST_DISTINCT:
        return found
    for each in UNITS if turn is None else (turn,):
        for decimals in DECIMALS:
            unit = 10.0**-decimals / each
            counts = moves / unit
            # A unit that is fine beside the rounding of floating-point angles is met by chance.
            if unit * WHOLE > 1e-14 and np.mean(np.abs(counts - np.rint(counts)) < WHOLE) > MOSTLY:
                found.append(unit)
                break
    return sorted(found, reverse=True)


def counts_behind(angles: FloatArray, period_rad: float = TURN, turn: float | None = None) -> int | None:
    """The encoder's counts a turn behind angles (n,) [rad] that were rounded to decimals, whatever their offset.

    Args:
        angles, period_rad, turn: as for `decimal_units`.

    Returns:
        The counts of a period; None where the angles are not rounded, or show no counts.
    """
    units = decimal_units(angles, period_rad, turn)
    turns = np.unique(np.mod(angles / period_rad, 1.0)) if units else np.zeros(0)
    if turns.size < LEAST_DISTINCT:
        return None
    cells = np.bincount((turns * FINEST).astype(np.int64) % FINEST, minlength=FINEST)
    mean = np.abs(np.fft.rfft(cells))[: FINEST // 4] / turns.size
    for unit in units:
        counts = np.arange(LEAST_COUNTS, min(FINEST // 4 - 1, int(MOST_COVERED / unit)) + 1)
        likely = counts[mean[counts] > max(LEAST_MEAN, 5.0 / np.sqrt(turns.size))]
        for each in likely[:MOST_LIKELY].tolist():
            if _keep_to(turns, each, unit):
                return int(each)
    return None


def _keep_to(turns: FloatArray, counts: int, unit: float) -> bool:
    """Whether readings (n,) [turns] lie on a lattice of so many counts within half a unit, and show enough of them."""
    at = turns * counts
    offset = float(np.angle(np.mean(np.exp(2j * np.pi * at)))) / (2.0 * np.pi)
    place = at - offset
    off = np.abs(place - np.rint(place))
    within = BEYOND * 0.5 * unit * counts + 1e-6 * counts / FINEST
    inside = off <= within
    distinct = np.unique(np.rint(place)).size
    # Readings spread evenly keep to it with the probability 2 within.
    return bool(np.mean(inside) > INSIDE and distinct >= LEAST_DISTINCT and 2.0 * within < 0.85)
