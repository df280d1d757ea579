"""How good readings are, and where a reading of an angle that wraps or slipped belongs."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.compiling import compiled
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.status import Record, Records

FIRST_JITTER = 0.01
"""First guess of the stamps' error, in intervals; learnt within some dozens of samples."""
FINEST_RAD2 = 1e-14
"""Least variance of a reading: the rounding of float64 angles some hundred turns away."""
MOST_IN_STEP = 10.0
"""Readings within one step of the encoder that are believed to be one."""
SHARP_LESSONS = 3.0
"""Lessons in a row that readings are better than their rounding, after which they are not rounded."""
LEARN_JITTER = 0.5
"""Part of the jitter that each lesson about it gives at full speed; a slow shaft hardly shows it."""
FORGET_SPEED = 0.99
"""Part of the full speed that is left after each lesson at a lower one."""
AT_REST = 0.4
"""Part of the variance of rounding that a rest leaves: with less the first steps after it look like blows, with more a
start is noticed late."""


@compiled
def unwrapped(status: Record, raw: float, expected: float) -> float:
    """The reading nearest to where the shaft should be; an angle that leaves one period counts its turns."""
    if status.auto > 0.0 and status.period > 0.0:
        status.low, status.high = min(status.low, raw), max(status.high, raw)
        if status.high - status.low > 1.25 * status.period:
            status.period = 0.0
    if status.period > 0.0:
        status.slips = status.period * np.rint((expected - raw) / status.period)
    return float(raw + status.slips)


@compiled
def noise_of(status: Record, speed: float) -> float:
    """Variance of a reading [rad^2]: rounding, of which only one reading in each step says anything new, and jitter."""
    in_step = status.rounding / max(abs(speed) * status.interval, 1e-30)
    return noise_in_step(status, min(max(in_step, 1.0), MOST_IN_STEP))


@compiled
def noise_in_step(status: Record, readings: float) -> float:
    """Variance of a reading [rad^2] of which so many lie in one step of the encoder; 1 for one that left a step."""
    return float(status.rounding**2 / 12.0 * readings + status.jitter * status.speed**2 + FINEST_RAD2)


@compiled
def least_scale(status: Record, noise: float) -> float:
    """Least scale of the noise that filters may learn.

    At rest readings may all be equal for hours: they are rounded none the less, and would be noisy if the shaft turned.
    """
    if abs(status.speed) * status.interval > max(status.rounding, 3.0 * math.sqrt(noise)):
        return 1e-6
    return AT_REST * status.rounding**2 / 12.0 / noise if status.rounding > 0.0 else 1.0


@compiled
def recalibrate(status: Record, noise: float) -> None:
    """Give what the leading filter has learnt of the noise to jitter and rounding, so that it follows the speed.

    Readings on a lattice that are much better than its step are edges of teeth, timed: they are not rounded.
    """
    found = status.scale[status.best[status.lead]] * noise
    rounding = status.rounding**2 / 12.0
    moved = abs(status.speed) * status.interval
    sharp = rounding > 0.0 and found < 0.1 * rounding and moved > 0.5 * status.rounding
    status.sharp = status.sharp + 1.0 if sharp else 0.0
    if status.sharp >= SHARP_LESSONS:
        status.rounding = rounding = 0.0
    status.fastest = max(abs(status.speed), FORGET_SPEED * status.fastest)
    if status.jitter_told == 0.0:
        learnt = max(found - rounding, 0.01 * found) / status.speed**2
        status.jitter += LEARN_JITTER * (status.speed / status.fastest) ** 2 * (learnt - status.jitter)
    _rescale(status, noise / noise_of(status, status.speed))


@compiled
def _rescale(status: Record, change: float) -> None:
    """The unit of noise has become so many times smaller: what scale and factor stand for must stay."""
    root = math.sqrt(change)
    for m in range(lanes.COUNT):
        status.scale[m] *= change
        for row in range(lanes.L00, lanes.L22 + 1):
            status.clock[row, m] /= root
        for j in range(lanes.WIDEST):
            for i in range(j, lanes.WIDEST):
                status.factor[m, j, i] /= root


@compiled
def set_rounding(record: Records, rounding: float) -> None:
    """From now on the encoder's step is known, 0 for none [rad]."""
    status = record[0]
    before = noise_of(status, status.speed)
    status.rounding = rounding
    if status.samples > 1.0:
        _rescale(status, before / noise_of(status, status.speed))
