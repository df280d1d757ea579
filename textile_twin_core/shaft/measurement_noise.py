"""Measurement noise: its model and adaptation; sensors that repeat a value."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import layout
from textile_twin_core.shaft.encoder import FINEST_STEP_RAD, UNKNOWN_STEP_RAD
from textile_twin_core.shaft.filter_bank import rescale
from textile_twin_core.shaft.status import Record, Records
from textile_twin_core.shaft.turns import TURN

SETTLING = 25.0  # samples until a state may count as converged, and at standstill until it is reported
MOST_CORRELATED = 16.0  # maximum of `correlated`: a shaft at standstill stays within an encoder step for hours
FIRST_JITTER = 0.01  # initial standard deviation of the stamps, in intervals
SMOOTH_MOVE = TURN / 48.0  # [rad] per interval, up to which the shortest wave of ripple has at least 4 samples
ADDITIVE_SAMPLES, ADDITIVE_FEW = 100.0, 50.0  # memory of the additive noise; the second where a wave has fewer samples
MOST_ADDITIVE = 128.0  # bound of one sample's estimate, in current variances
REPEAT_MEMORY = 10.0, 25.0  # moves averaged at first and at most; a tenth of the readings used in between
REPEATING = 0.3  # share of moves after repetitions above which the sensor repeats values
# encoder steps of a move that rounding cannot explain; the second while the step is a guess
LARGE_MOVE, LARGE_MOVE_GUESSED = (
    2.5,
    4.5,
)  # encoder steps, more than rounding can hide of a move; while the step is a guess
FEW_EQUAL, SAME_MOVE = 2.0, 0.01  # equal readings between two steps, and part of a step by which they may differ
FORGET_REPEAT = 0.98  # decay of the longest repetition per large move
SIMILAR_REPEATS = 0.6  # part of the longest, from which repetitions are a sensor's: standstills of a shaft differ more
FINEST_RAD2 = 1e-14  # [rad^2] least measurement variance: float64 rounding some hundred turns from the origin
FINEST_MOTION = 1e-10  # [rad^2] least variance that the process noise is relative to: no motion is smoother for long
FINEST_S = 1e-9  # [s] least time between readings: months after the first one rounding would hide it
LEAST_SCALE = 1e-6  # least noise scale of a filter without any other bound
LEARN_JITTER = 0.5  # gain of the jitter's adaptation at full speed; lower speeds hardly show jitter
LEAST_JITTER = 0.01  # least part of the estimated noise that counts as jitter
FOURTH = 70.0  # variance of the fourth differences of white noise of variance 1
MOST_WHITE, FORGET_WHITE = 2.0, 0.5  # bound of jitter in estimates of white noise; their decay per adaptation
FORGET_SPEED = 0.99  # decay of the full speed per adaptation


@compiled_in_place
def measurement_variance(status: Record) -> float:
    """Return the measurement variance [rad^2]: rounding and jitter at this speed, or additive noise if larger."""
    fading = rounding_variance(status) + status.jitter * status.speed**2
    return float(max(fading, status.additive, status.standstill_noise) + FINEST_RAD2)


@compiled_in_place
def rounding_variance(status: Record) -> float:
    """Return the variance [rad^2] of rounding, times the number of readings that share one rounding error."""
    return float(status.correlated * status.resolution**2 / 12.0)


@compiled_in_place
def set_correlated(status: Record) -> None:
    """Set the number of readings that count as one because their rounding errors are correlated.

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

    The autocovariance of the motion is positive while ripple has many samples per wave, so motion adds no noise. With
    few samples per wave it may look like noise: such samples count only after models with ripple have had a
    probability.
    """
    moved = (reading - status.last_used) * status.interval / max(status.time - status.last_used_at, FINEST_S)
    _add_white_noise(status, moved - status.moved)
    smooth = max(abs(moved), abs(status.moved)) <= SMOOTH_MOVE
    bent = 0.0
    if smooth or status.ripple_tried > 0.0:
        bent = moved - status.moved
        found, noise = -0.25 * bent * status.bent, measurement_variance(status)
        samples = ADDITIVE_SAMPLES if smooth else ADDITIVE_FEW
        status.additive = _averaged(status.additive, found - status.jitter * status.speed**2, noise, samples)
        if status.still > 0.0:
            status.standstill_noise = _averaged(status.standstill_noise, found, noise, samples)
    status.last_used, status.last_used_at, status.moved, status.bent = reading, status.time, moved, bent


@compiled_in_place
def _add_white_noise(status: Record, second: float) -> None:
    """Update the sums that bound the jitter: white noise from fourth differences (Rice 1984), and speed, squared.

    Motion of several readings per wave adds little to fourth differences, and always a positive amount. `second`: the
    latest second difference.
    """
    third = second - status.second_difference
    fourth = third - status.third_difference
    status.second_difference, status.third_difference = second, third
    status.differences += 1.0
    if status.differences > 3.0:  # the first three include the start values
        status.white += fourth * fourth / FOURTH - max(rounding_variance(status), status.standstill_noise)
        status.speed_squared += status.speed**2


@compiled_in_place
def _averaged(variance: float, found: float, noise: float, samples: float) -> float:
    """Average a variance with one sample's estimate, bounded by the present `noise`, as it may be an outlier."""
    return max(variance + (min(max(found, -noise), MOST_ADDITIVE * noise) - variance) / samples, 0.0)


@compiled_in_place
def guess_resolution(status: Record, moved: float) -> None:
    """Guess the encoder's step while it is unknown: no move is smaller.

    The first two moves after a standstill, between equal readings, are one step if they are alike. Moves of a shaft
    whose sensor repeats its readings are not.
    """
    if abs(moved) > FINEST_STEP_RAD:
        alike = status.repeat_run >= FEW_EQUAL and abs(moved - status.lone_move) < SAME_MOVE * abs(moved)
        coarse = alike and status.resolution == UNKNOWN_STEP_RAD
        status.resolution = abs(moved) if coarse else min(status.resolution, abs(moved))
        status.lone_move = moved if status.repeat_run >= SETTLING else 0.0


@compiled_in_place
def is_repetition(status: Record, reading: float) -> bool:
    """Return whether a sensor that measures less often than it is read repeats its value.

    A longer repetition is a stop. After a rejected reading the reading before it may be repeated.
    """
    if reading != status.last_reading and (reading != status.last_used or status.rejected_run == 0.0):
        status.repeat_run = 0.0
        return False
    status.repeat_run += 1.0
    return bool(status.repeat_share > REPEATING and status.repeat_run <= status.longest_repeat + 1.0)


@compiled_in_place
def samples_between(status: Record, repeated: float) -> float:
    """Return the number of samples from the last reading to the next after `repeated` repetitions."""
    return 1.0 + repeated if status.repeat_share > REPEATING else 1.0


@compiled_in_place
def learn_repetitions(status: Record, reading: float, repeated: float) -> None:
    """Learn from large moves, beyond rounding, whether they follow repetitions and how long these are.

    A large move counts once the next one has the same sign: an outlier returns at once. A sensor repeats about equally
    often each time.
    """
    moved, before = reading - status.last_used, status.large_move_repeats
    if abs(moved) <= (LARGE_MOVE_GUESSED if status.guessed > 0.0 else LARGE_MOVE) * max(
        status.resolution, FINEST_STEP_RAD
    ):
        return
    if moved * status.large_move > 0.0:
        most = status.longest_repeat + 1.0 if status.repeat_share > REPEATING else SETTLING
        memory = min(REPEAT_MEMORY[0] + 0.1 * status.used, REPEAT_MEMORY[1])
        status.repeat_share += (
            (1.0 if before > SIMILAR_REPEATS * status.longest_repeat else 0.0) - status.repeat_share
        ) / memory
        status.longest_repeat = max(FORGET_REPEAT * status.longest_repeat, min(before, most))
    status.large_move, status.large_move_repeats = moved, repeated


@compiled_in_place
def standstill_speed(status: Record) -> float:
    """Return the speed [rad/s] below which the shaft stays within its measurement noise for SETTLING samples."""
    noise = max(status.resolution, 3.0 * math.sqrt(measurement_variance(status)))
    return float(noise / (SETTLING * status.interval))


@compiled_in_place
def least_scale(status: Record, noise: float) -> float:
    """Return the lower bound of the filters' noise scale: the known rounding and jitter; 1 at standstill.

    Readings at standstill may be equal for hours, and stamps of a controller's cycle equally late for minutes, although
    the noise is not smaller.
    """
    at_rest = max(rounding_variance(status), status.additive, status.standstill_noise) + FINEST_RAD2
    if abs(status.speed) * status.interval <= max(status.resolution, 3.0 * math.sqrt(at_rest)):
        return 1.0
    known = 0.0 if status.guessed > 0.0 else rounding_variance(status)
    return float(max((known + status.jitter_configured * status.jitter * status.speed**2) / noise, LEAST_SCALE))


@compiled_in_place
def set_resolution(record: Records, resolution: float) -> None:
    """Set the encoder's step [rad], 0 for none.

    Filters of a turning shaft keep the variance that they have learnt; at standstill they have learnt none.
    """
    for i in range(2 if record[0].provisional > 0.0 else 1):
        status = record[i]
        before = measurement_variance(status)
        least = UNKNOWN_STEP_RAD if status.guessed > 0.0 else status.resolution
        turning = abs(status.speed) * status.interval > least
        status.resolution, status.guessed, status.repeat_share = resolution, 0.0, 0.0
        set_correlated(status)
        if turning:
            rescale(status, before / measurement_variance(status))


@compiled_in_place
def begin_jitter(status: Record) -> None:
    """Set the stamps' jitter to its initial value, unless it is configured."""
    if status.jitter_configured == 0.0:
        status.jitter = (FIRST_JITTER * status.interval) ** 2
    status.white = status.speed_squared = 0.0


@compiled_in_place
def adapt_jitter(status: Record, noise: float) -> None:
    """Attribute the noise scale of the leading model's best filter to jitter, whose variance follows the speed.

    White noise of the readings bounds the jitter: a plain filter's scale may come from motion that it cannot follow.
    """
    found = status.scale[status.best[status.leading]] * noise
    status.fastest = max(abs(status.speed), FORGET_SPEED * status.fastest)
    if status.jitter_configured == 0.0:
        other = max(rounding_variance(status), status.standstill_noise)
        jitter = max(found - other, LEAST_JITTER * found) / status.speed**2
        if status.leading == layout.PLAIN and status.speed_squared > 0.0:
            jitter = min(jitter, max(MOST_WHITE * status.white / status.speed_squared, LEAST_JITTER * jitter))
        jitter = min(jitter, status.interval**2)  # near a stop any noise would give a larger jitter
        status.jitter += LEARN_JITTER * (status.speed / status.fastest) ** 2 * (jitter - status.jitter)
    status.white *= FORGET_WHITE
    status.speed_squared *= FORGET_WHITE
    rescale(status, noise / measurement_variance(status))
