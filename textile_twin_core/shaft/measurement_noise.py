"""How good readings are, and where a reading of an angle that wraps or slipped belongs."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.compiling import compiled
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.encoder import FINEST_STEP_RAD
from textile_twin_core.shaft.status import Record, Records
from textile_twin_core.shaft.turns import TURN

SETTLING = 25.0
"""Samples until a state is called settled, and at rest until it is called standstill."""
MOST_CORRELATED = 16.0
"""Readings that count as one at most: a shaft at rest stays for hours within a step of its encoder."""
FIRST_JITTER = 0.01
"""First guess of the stamps' error, in intervals; learnt within some dozens of samples."""
SMOOTHLY = TURN / 48.0
"""Move from a reading to the next up to which there are 4 readings in the shortest wave of ripple at least."""
ADDITIVE_SAMPLES, ADDITIVE_FEW, MOST_ADDITIVE = 100.0, 50.0, 128.0
"""Readings that other noise is learnt from, and where they are few in a turn; the most that one tells, in variances: it
may have leapt."""
HELD_MOVES, OFTEN_HELD = 10.0, 0.3
"""Moves that are looked at for such as come after repetitions, and their part from which the sensor holds readings."""
LEAP, LEAP_GUESSED = 2.5, 4.5
"""Steps of the encoder that a move is more than where no rounding hid a motion before; while the step is a guess."""
FORGET_HOLD = 0.98
"""Part of the longest repetition that is left after each move."""
FINEST_RAD2 = 1e-14
"""Least variance of a reading: the rounding of float64 angles some hundred turns away."""
FINEST_S = 1e-9
"""Least time between readings; months of seconds may tell none."""
LEAST_SCALE = 1e-6
"""Of the noise, that filters learn, as far as nothing else bounds it."""
LEARN_JITTER = 0.5
"""Part of the jitter that each lesson about it gives at full speed; a slow shaft hardly shows it."""
FORGET_SPEED = 0.99
"""Part of the full speed that is left after each lesson at a lower one."""


@compiled
def unwrap_reading(status: Record, raw: float, expected: float) -> float:
    """The reading nearest to where the shaft should be; an angle that leaves one period counts its turns."""
    if status.auto > 0.0 and status.period > 0.0:
        status.low, status.high = min(status.low, raw), max(status.high, raw)
        if status.high - status.low > 1.25 * status.period:
            status.period = 0.0
    if status.period > 0.0:
        status.slips = status.period * np.rint((expected - raw) / status.period)
    return float(raw + status.slips)


@compiled
def measurement_variance(status: Record, speed: float) -> float:
    """Variance of a reading [rad^2]: rounding and jitter, or other noise where that is more."""
    return float(max(rounding_variance(status) + status.jitter * speed**2, status.additive) + FINEST_RAD2)


@compiled
def rounding_variance(status: Record) -> float:
    """What rounding adds to the variance of a reading [rad^2]."""
    return float(status.correlated * status.resolution**2 / 12.0)


@compiled
def set_correlated(status: Record) -> None:
    """Set how many readings count as one, because they are rounded by about as much.

    From reading to reading a shaft moves within the encoder's step by what it turns beyond whole steps: slowly when
    it is slow, or in step with the sampling. K readings pass until that is a whole step, where rate K + bend K^2 / 2 is
    1; half of them count as one. Jitter of the stamps blurs it: of the sawtooth that the rounding then follows the
    first wave's variance shrinks by exp(-(2 pi s)^2), with s the jitter in steps (Widrow and Kollar 2008).
    """
    step = status.resolution
    moved = abs(status.speed) * status.interval / step if step > 0.0 else 1.0
    if step == 0.0 or (status.guessed > 0.0 and moved > 0.5):
        status.correlated = 1.0
        return
    rate = math.hypot(moved - np.rint(moved), status.speed_sigma * status.interval / step)
    bend = math.hypot(status.acceleration, status.acceleration_sigma) * status.interval**2 / step
    apart = min(1.0 / max(rate + math.sqrt(rate * rate + 2.0 * bend), 1e-30), MOST_CORRELATED)
    blur = math.exp(-4.0 * math.pi**2 * status.jitter * (status.speed / step) ** 2)
    status.correlated = max(1.0 + (apart - 1.0) * blur, 1.0)


@compiled
def adapt_additive_noise(status: Record, reading: float) -> None:
    """Learn the noise that jitter does not account for: by how much second differences of the readings alternate.

    Those of white noise have the covariance -4 sigma^2 with the one before; what the shaft does between samples adds to
    it as long as they are many in each wave of its ripple, and is no noise. Where they are few, ripple could be taken
    for noise: there it counts once the ripple was looked for.
    """
    moved = (reading - status.kept) * status.interval / max(status.time - status.kept_at, FINEST_S)
    smoothly = max(abs(moved), abs(status.moved)) <= SMOOTHLY
    tells = smoothly or status.ripple_tried > 0.0
    bent = moved - status.moved if tells else 0.0
    if tells:
        told = -0.25 * bent * status.bent - status.jitter * status.speed**2
        noise = measurement_variance(status, status.speed)
        status.additive += (min(max(told, -noise), MOST_ADDITIVE * noise) - status.additive) / (
            ADDITIVE_SAMPLES if smoothly else ADDITIVE_FEW
        )
    status.kept, status.kept_at, status.moved, status.bent = reading, status.time, moved, bent


@compiled
def is_repetition(status: Record, reading: float) -> bool:
    """Whether a reading is none: a sensor that measures less often than it is asked says again what it said.

    What lasts longer than its repetitions do is a stop.
    """
    if reading != status.read:
        status.holding = 0.0
        return False
    status.holding += 1.0
    return bool(status.held > OFTEN_HELD and status.holding <= status.longest_hold + 1.0)


@compiled
def learn_repetitions(status: Record, reading: float, repeated: float) -> None:
    """Learn whether the sensor holds readings: moves after repetitions are of more than rounding hides.

    Each leap is a lesson once the next one goes on in its sense: what turns back at once was an outlier.
    """
    moved, usual = reading - status.kept, status.held > OFTEN_HELD
    if abs(moved) <= (LEAP_GUESSED if status.guessed > 0.0 else LEAP) * max(status.resolution, FINEST_STEP_RAD):
        return
    if moved * status.leapt > 0.0:
        before = status.leapt_after
        status.held += ((1.0 if before > 0.0 else 0.0) - status.held) / HELD_MOVES
        most = status.longest_hold + 1.0 if usual else SETTLING
        status.longest_hold = max(FORGET_HOLD * status.longest_hold, min(before, most))
    status.leapt, status.leapt_after = moved, repeated


@compiled
def standstill_speed(status: Record) -> float:
    """The speed [rad/s] below which a shaft hardly moves: it stays within its reading's noise until a state settles."""
    return float(
        max(status.resolution, 3.0 * math.sqrt(measurement_variance(status, status.speed)))
        / (SETTLING * status.interval)
    )


@compiled
def least_scale(status: Record, noise: float) -> float:
    """Least scale of the noise that filters may learn: no reading is better than its rounding and its stamp, as far as
    these are known.

    At rest readings may all be equal for hours, and would be noisy if the shaft turned. And those of a controller's
    cycle are all as old for minutes, until its clock passes that of the polls.
    """
    if abs(status.speed) * status.interval <= max(status.resolution, 3.0 * math.sqrt(noise)):
        return 1.0
    known = 0.0 if status.guessed > 0.0 else rounding_variance(status)
    return float(max((known + status.jitter_told * status.jitter * status.speed**2) / noise, LEAST_SCALE))


@compiled
def set_resolution(record: Records, resolution: float) -> None:
    """From now on this is the encoder's step [rad], 0 for none."""
    record[0].guessed = record[0].held = 0.0
    _set_resolution(record[0], resolution)


@compiled
def guess_resolution(status: Record, moved: float) -> None:
    """While the encoder's step is not known: it is at most what a reading differs by from the one before."""
    if status.guessed > 0.0 and FINEST_STEP_RAD < moved < status.resolution:
        _set_resolution(status, moved)


@compiled
def _set_resolution(status: Record, resolution: float) -> None:
    """What a turning shaft has told of the noise stays; one at rest tells nothing."""
    before, turning = (
        measurement_variance(status, status.speed),
        abs(status.speed) * status.interval > status.resolution,
    )
    status.resolution = resolution
    set_correlated(status)
    if turning:
        _rescale(status, before / measurement_variance(status, status.speed))


@compiled
def adapt_jitter(status: Record, noise: float) -> None:
    """Give what the leading filter has learnt of the noise to the jitter, so that it follows the speed."""
    found = status.scale[status.best[status.leading]] * noise
    status.fastest = max(abs(status.speed), FORGET_SPEED * status.fastest)
    if status.jitter_told == 0.0:
        scale_samples = max(found - rounding_variance(status), 0.01 * found) / status.speed**2
        status.jitter += LEARN_JITTER * (status.speed / status.fastest) ** 2 * (scale_samples - status.jitter)
    _rescale(status, noise / measurement_variance(status, status.speed))


@compiled
def _rescale(status: Record, change: float) -> None:
    """The unit of the noise has become so many times smaller: what scales and factors stand for must stay."""
    part = 1.0 / math.sqrt(change)
    for f in range(lanes.FAMILIES):
        for m in range(lanes.FIRST[f], lanes.END[f] if status.active[f] > 0.0 else lanes.FIRST[f]):
            status.scale[m] *= change
            for row in range(lanes.L00, lanes.L22 + 1):
                status.clock[row, m] *= part
            for j in range(2 * lanes.WAVES[f]):
                for i in range(j, 2 * lanes.WAVES[f]):
                    status.factor[m, j, i] *= part
