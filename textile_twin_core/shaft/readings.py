"""How good readings are, and where a reading of an angle that wraps or slipped belongs."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.compiling import compiled
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.encoder import FINEST_STEP_RAD
from textile_twin_core.shaft.status import Record, Records

SETTLING = 25.0
"""Samples until a state is called settled, and at rest until it is called standstill."""
FIRST_SCALE_WEIGHT = 0.5
"""What the first guess of the noise weighs beside the innovations that a filter's scale of it is learnt from."""
ALIKE, STEPS_APART = 2.0, 4.0
"""Readings that count as one, and steps of the encoder from each to the next below which they do: the rounding of a
slow shaft, or of one in step with the sampling, is no noise."""
FIRST_JITTER = 0.01
"""First guess of the stamps' error, in intervals; learnt within some dozens of samples."""
FINEST_RAD2 = 1e-14
"""Least variance of a reading: the rounding of float64 angles some hundred turns away."""
SHARP_LESSONS = 3.0
"""Lessons in a row that readings are better than their rounding, after which they are not rounded."""
LEARN_JITTER = 0.5
"""Part of the jitter that each lesson about it gives at full speed; a slow shaft hardly shows it."""
FASTER = 1.25
"""So many times the full speed known there is a new one: jitter is not foretold beyond it, ..."""
KNOWN_BEFORE = 64.0
"""... and what was learnt before weighs no more than so many innovations."""
FORGET_SPEED = 0.99
"""Part of the full speed that is left after each lesson at a lower one."""


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
    """Variance of a reading [rad^2]: rounding and jitter."""
    moved = abs(speed) * status.interval
    alike = min(max(STEPS_APART * status.rounding / max(moved, 1e-30), 1.0), ALIKE)
    if status.fastest > 0.0 and status.jitter_told == 0.0:
        speed = min(abs(speed), FASTER * status.fastest)
    return float(alike * status.rounding**2 / 12.0 + status.jitter * speed**2 + FINEST_RAD2)


@compiled
def hardly(status: Record) -> float:
    """The speed [rad/s] below which a shaft hardly moves: it stays within its reading's noise until a state settles."""
    return float(max(status.rounding, 3.0 * math.sqrt(noise_of(status, status.speed))) / (SETTLING * status.interval))


@compiled
def least_scale(status: Record, noise: float) -> float:
    """Least scale of the noise that filters may learn.

    At rest readings may all be equal for hours: they are rounded none the less, and would be noisy if the shaft turned.
    """
    turning = abs(status.speed) * status.interval > max(status.rounding, 3.0 * math.sqrt(noise))
    return 1e-6 if turning else 1.0


@compiled
def know_rounding(record: Records, rounding: float) -> None:
    """From now on this is the encoder's step [rad], 0 for none."""
    record[0].guessed = 0.0
    _set_rounding(record[0], rounding)


@compiled
def guess_rounding(status: Record, moved: float) -> None:
    """While the encoder's step is not known: it is at most what a reading differs by from the one before."""
    if status.guessed > 0.0 and FINEST_STEP_RAD < moved < status.rounding:
        _set_rounding(status, moved)


@compiled
def _set_rounding(status: Record, rounding: float) -> None:
    """What a turning shaft has told of the noise stays; what one at rest did was the guess, and is learnt anew."""
    before, turning = noise_of(status, status.speed), abs(status.speed) * status.interval > status.rounding
    status.rounding = rounding
    for m in range(lanes.FILTERS):
        _rescale(status, m, before / noise_of(status, status.speed) if turning else 1.0 / status.scale[m])
        status.learnt[m] = status.learnt[m] if turning else FIRST_SCALE_WEIGHT


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
    if abs(status.speed) > FASTER * status.fastest:
        for m in range(lanes.FILTERS):
            status.learnt[m] = min(status.learnt[m], KNOWN_BEFORE)
    status.fastest = max(abs(status.speed), FORGET_SPEED * status.fastest)
    if status.jitter_told == 0.0:
        learnt = max(found - rounding, 0.01 * found) / status.speed**2
        status.jitter += LEARN_JITTER * (status.speed / status.fastest) ** 2 * (learnt - status.jitter)
    for m in range(lanes.FILTERS):
        _rescale(status, m, noise / noise_of(status, status.speed))


@compiled
def _rescale(status: Record, m: int, change: float) -> None:
    """The unit of a lane's noise has become so many times smaller: what scale and factor stand for must stay."""
    root = math.sqrt(change)
    status.scale[m] *= change
    for row in range(lanes.L00, lanes.L22 + 1):
        status.clock[row, m] /= root
    for j in range(lanes.WIDEST):
        for i in range(j, lanes.WIDEST):
            status.factor[m, j, i] /= root
