"""Measurement noise: its model and adaptation; unwrapping; sensors that repeat a value."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.bank import rescale
from textile_twin_core.shaft.encoder import FINEST_STEP_RAD, UNKNOWN_STEP_RAD
from textile_twin_core.shaft.status import Record, Records
from textile_twin_core.shaft.turns import TURN

SETTLING = 25.0  # samples until a state may be settled, and at rest until standstill
MOST_CORRELATED = 16.0  # upper bound of `correlated`: a shaft at rest stays within an encoder step for hours
FIRST_JITTER = 0.01  # initial standard deviation of the stamps, in intervals
SMOOTH_MOVE = TURN / 48.0  # [rad] per interval, up to which the shortest wave of ripple has at least 4 samples
ADDITIVE_SAMPLES, ADDITIVE_FEW = 100.0, 50.0  # memory of the additive noise; where a wave has fewer samples than that
MOST_ADDITIVE = 128.0  # bound of one sample's estimate in current variances
HELD_MOVES = 10.0, 25.0  # memory at first and at most in moves, a tenth of the readings used between
OFTEN_HELD = 0.3  # share of moves after repetitions from which the sensor holds values
LEAP, LEAP_GUESSED = 2.5, 4.5  # encoder steps, more than rounding can hide of a move; while the step is a guess
FEW_EQUAL, SAME_MOVE = 2.0, 0.01  # equal readings between two steps, and part of a step by which they may differ
FORGET_HOLD = 0.98  # decay of the longest repetition per leap
ALIKE_HOLDS = 0.6  # of the longest, from which repetitions are a sensor's: a shaft's that rests at times differ
FINEST_RAD2 = 1e-14  # [rad^2] least measurement variance: float64 rounding some hundred turns from the origin
FINEST_MOTION = 1e-10  # [rad^2] least variance that the process noise is relative to: no motion is evener for long
FINEST_S = 1e-9  # [s] least time between measurements: months after the first it may be lost to rounding
LEAST_SCALE = 1e-6  # least noise scale of a filter where nothing else bounds it
LEARN_JITTER = 0.5  # gain of the jitter's adaptation at full speed; lower speeds hardly show it
LEAST_JITTER = 0.01  # part of the noise found that is taken for jitter at least
FOURTH = 70.0  # variance of the fourth differences of white noise of variance 1
MOST_WHITE, FORGET_WHITE = 2.0, 0.5  # bound of jitter in estimates of white noise; their decay per adaptation
FORGET_SPEED = 0.99  # decay of the full speed per adaptation


@compiled_in_place
def unwrap_reading(status: Record, raw: float, expected: float) -> float:
    """The measurement [rad] nearest to the prediction; one whose range exceeds a period is not wrapped."""
    if status.auto > 0.0 and status.period > 0.0:
        # A wild reading is one alone: the range is what two in a row share, but for the first few, that may leap.
        before = status.read - status.slips if status.samples > SETTLING else raw
        status.low, status.high = min(status.low, max(raw, before)), max(status.high, min(raw, before))
        if status.high - status.low > 1.25 * status.period:
            status.period = status.slips = 0.0
    if status.period > 0.0:
        status.slips = status.period * np.rint((expected - raw) / status.period)
    return float(raw + status.slips)


@compiled_in_place
def measurement_variance(status: Record) -> float:
    """Measurement variance [rad^2]: rounding and stamp jitter at the present speed, or additive noise if larger."""
    fading = rounding_variance(status) + status.jitter * status.speed**2
    return float(max(fading, status.additive, status.noise_at_rest) + FINEST_RAD2)


@compiled_in_place
def rounding_variance(status: Record) -> float:
    """Variance [rad^2] of rounding to the encoder's step, times the measurements that share one rounding error."""
    return float(status.correlated * status.resolution**2 / 12.0)


@compiled_in_place
def set_correlated(status: Record) -> None:
    """Set the number of measurements that count as one because their rounding errors are correlated.

    In encoder steps the shaft moves per sample by `rate` beyond whole steps (slow, or in step with the sampling) and by
    `bend` more each time. K samples make a step where rate K + bend K^2 / 2 = 1; half of them count as one. Jitter of s
    steps dithers: the error's first harmonic loses exp(-(2 pi s)^2) of its variance (Widrow and Kollar 2008).
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


@compiled_in_place
def adapt_additive_noise(status: Record, reading: float) -> None:
    """Estimate the noise beyond jitter from the lag-1 autocovariance of second differences, -4 sigma^2 if white.

    The motion's own is positive, and feigns no noise, while ripple has many samples per wave. Where it has few it may
    pass for noise: such samples count only once families with ripple have had a probability.
    """
    moved = (reading - status.kept) * status.interval / max(status.time - status.kept_at, FINEST_S)
    _add_white_noise(status, moved - status.moved)
    smooth = max(abs(moved), abs(status.moved)) <= SMOOTH_MOVE
    bent = 0.0
    if smooth or status.ripple_tried > 0.0:
        bent = moved - status.moved
        found, noise = -0.25 * bent * status.bent, measurement_variance(status)
        samples = ADDITIVE_SAMPLES if smooth else ADDITIVE_FEW
        status.additive = _averaged(status.additive, found - status.jitter * status.speed**2, noise, samples)
        if status.still > 0.0:
            status.noise_at_rest = _averaged(status.noise_at_rest, found, noise, samples)
    status.kept, status.kept_at, status.moved, status.bent = reading, status.time, moved, bent


@compiled_in_place
def _add_white_noise(status: Record, second: float) -> None:
    """Add to the sums by which jitter is bounded: white noise from fourth differences (Rice 1984), and speed, squared.

    A motion of some readings per wave has hardly any, and never less than none. `second`: the latest second difference.
    """
    third = second - status.second_difference
    fourth = third - status.third_difference
    status.second_difference, status.third_difference = second, third
    status.differences += 1.0
    if status.differences > 3.0:  # the first three are not of readings alone
        status.white += fourth * fourth / FOURTH - max(rounding_variance(status), status.noise_at_rest)
        status.speed_squared += status.speed**2


@compiled_in_place
def _averaged(variance: float, found: float, noise: float, samples: float) -> float:
    """Mean of a variance with one sample's estimate, bounded by the present `noise`, as it may be an outlier."""
    return max(variance + (min(max(found, -noise), MOST_ADDITIVE * noise) - variance) / samples, 0.0)


@compiled_in_place
def guess_resolution(status: Record, moved: float) -> None:
    """Guess the encoder's step while it is not known: no move is smaller.

    The first two after a rest, between equal readings, are of one step if they are alike; those of a shaft whose sensor
    repeats its readings are not.
    """
    if abs(moved) > FINEST_STEP_RAD:
        alike = status.holding >= FEW_EQUAL and abs(moved - status.lone) < SAME_MOVE * abs(moved)
        coarse = alike and status.resolution == UNKNOWN_STEP_RAD
        status.resolution = abs(moved) if coarse else min(status.resolution, abs(moved))
        status.lone = moved if status.holding >= SETTLING else 0.0


@compiled_in_place
def is_repetition(status: Record, reading: float) -> bool:
    """Whether a sensor that measures less often than it is read repeats its value; a longer repetition is a stop.

    After a measurement that was set aside the one before may be repeated.
    """
    if reading != status.read and (reading != status.kept or status.rejected_run == 0.0):
        status.holding = 0.0
        return False
    status.holding += 1.0
    return bool(status.held > OFTEN_HELD and status.holding <= status.longest_hold + 1.0)


@compiled_in_place
def samples_between(status: Record, repeated: float) -> float:
    """Samples from the last reading to one that follows so many repetitions."""
    return 1.0 + repeated if status.held > OFTEN_HELD else 1.0


@compiled_in_place
def learn_repetitions(status: Record, reading: float, repeated: float) -> None:
    """Learn from leaps, moves beyond what rounding hides, whether they follow repetitions and how long these are.

    A leap counts once the next one has the same sign: an outlier returns at once. A sensor's repetitions are about
    equally many each time.
    """
    moved, before = reading - status.kept, status.leapt_after
    if abs(moved) <= (LEAP_GUESSED if status.guessed > 0.0 else LEAP) * max(status.resolution, FINEST_STEP_RAD):
        return
    if moved * status.leapt > 0.0:
        most = status.longest_hold + 1.0 if status.held > OFTEN_HELD else SETTLING
        memory = min(HELD_MOVES[0] + 0.1 * status.used, HELD_MOVES[1])
        status.held += ((1.0 if before > ALIKE_HOLDS * status.longest_hold else 0.0) - status.held) / memory
        status.longest_hold = max(FORGET_HOLD * status.longest_hold, min(before, most))
    status.leapt, status.leapt_after = moved, repeated


@compiled_in_place
def standstill_speed(status: Record) -> float:
    """Speed [rad/s] below which the shaft stays within its measurement noise for SETTLING samples."""
    noise = max(status.resolution, 3.0 * math.sqrt(measurement_variance(status)))
    return float(noise / (SETTLING * status.interval))


@compiled_in_place
def least_scale(status: Record, noise: float) -> float:
    """Lower bound of the filters' noise scale: the rounding and jitter that are known; 1 at standstill.

    Measurements at rest may be equal for hours, and stamps of a controller's cycle equally late for minutes, without
    the noise being smaller.
    """
    at_rest = max(rounding_variance(status), status.additive, status.noise_at_rest) + FINEST_RAD2
    if abs(status.speed) * status.interval <= max(status.resolution, 3.0 * math.sqrt(at_rest)):
        return 1.0
    known = 0.0 if status.guessed > 0.0 else rounding_variance(status)
    return float(max((known + status.jitter_told * status.jitter * status.speed**2) / noise, LEAST_SCALE))


@compiled_in_place
def set_resolution(record: Records, resolution: float) -> None:
    """Set the encoder's step [rad], 0 for none.

    A turning shaft's filters keep the variance that they learnt, at rest nothing was learnt.
    """
    for i in range(2 if record[0].doubtful > 0.0 else 1):
        status = record[i]
        before = measurement_variance(status)
        least = UNKNOWN_STEP_RAD if status.guessed > 0.0 else status.resolution
        turning = abs(status.speed) * status.interval > least
        status.resolution, status.guessed, status.held = resolution, 0.0, 0.0
        set_correlated(status)
        if turning:
            rescale(status, before / measurement_variance(status))


@compiled_in_place
def begin_jitter(status: Record) -> None:
    """Set the stamps' jitter, unless it is a setting, to what it is taken for before there is evidence."""
    if status.jitter_told == 0.0:
        status.jitter = (FIRST_JITTER * status.interval) ** 2
    status.white = status.speed_squared = 0.0


@compiled_in_place
def adapt_jitter(status: Record, noise: float) -> None:
    """Attribute the noise scale of the leading family's best filter to jitter: the variance follows the speed.

    As far as the readings' noise is white: a plain filter's scale may be that of a motion which it cannot follow.
    """
    found = status.scale[status.best[status.leading]] * noise
    status.fastest = max(abs(status.speed), FORGET_SPEED * status.fastest)
    if status.jitter_told == 0.0:
        other = max(rounding_variance(status), status.noise_at_rest)
        jitter = max(found - other, LEAST_JITTER * found) / status.speed**2
        if status.leading == lanes.PLAIN and status.speed_squared > 0.0:
            jitter = min(jitter, max(MOST_WHITE * status.white / status.speed_squared, LEAST_JITTER * jitter))
        jitter = min(jitter, status.interval**2)  # at a stop any noise would be that of stamps later than that
        status.jitter += LEARN_JITTER * (status.speed / status.fastest) ** 2 * (jitter - status.jitter)
    status.white *= FORGET_WHITE
    status.speed_squared *= FORGET_WHITE
    rescale(status, noise / measurement_variance(status))
