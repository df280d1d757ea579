"""Measurement noise: its model and adaptation; sensors that repeat a value."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import layout
from textile_twin_core.shaft.constants import (
    ADDITIVE_FEW,
    ADDITIVE_SAMPLES,
    FEW_EQUAL,
    FINEST_RAD2,
    FINEST_S,
    FIRST_JITTER,
    FORGET_REPEAT,
    FORGET_SPEED,
    FORGET_WHITE,
    FOURTH,
    LARGE_MOVE,
    LARGE_MOVE_GUESSED,
    LEARN_JITTER,
    LEAST_JITTER,
    LEAST_SCALE,
    MOST_ADDITIVE,
    MOST_CORRELATED,
    MOST_WHITE,
    REPEAT_MEMORY,
    REPEATING,
    SAME_MOVE,
    SETTLING,
    SIMILAR_REPEATS,
    SMOOTH_MOVE,
)
from textile_twin_core.shaft.encoder import FINEST_STEP_RAD, UNKNOWN_STEP_RAD
from textile_twin_core.shaft.filter_bank import rescale
from textile_twin_core.shaft.status import (
    Bank,
    Differences,
    FilterStatus,
    Mixture,
    Noise,
    Records,
    Repeats,
    Sampling,
)


@compiled_in_place
def measurement_variance(noise: Noise, speed: float) -> float:
    """Return the measurement variance [rad^2] at this speed: rounding and jitter, or additive noise if larger."""
    fading = rounding_variance(noise) + noise.jitter * speed**2
    return float(max(fading, noise.additive, noise.standstill) + FINEST_RAD2)


@compiled_in_place
def rounding_variance(noise: Noise) -> float:
    """Return the variance [rad^2] of rounding, times the number of readings that share one rounding error."""
    return float(noise.correlated * noise.resolution**2 / 12.0)


@compiled_in_place
def set_correlated(noise: Noise, track: Mixture, interval: float) -> None:
    """Set the number of readings that count as one because their rounding errors are correlated.

    In encoder steps the shaft moves per sample by `rate` beyond whole steps (slow, or in step with the sampling) and by
    `bend` more each time. K samples make a step where rate K + bend K^2 / 2 = 1; half of them count as one. Jitter of s
    steps dithers: the error's first harmonic loses exp(-(2 pi s)^2) of its variance (Widrow and Kollar 2008).
    """
    step = noise.resolution
    moved = abs(track.speed) * interval / step if step > 0.0 else 1.0
    if step == 0.0 or (noise.guessed > 0.0 and moved > 0.5):
        noise.correlated = 1.0
        return
    rate = math.hypot(moved - np.rint(moved), track.speed_sigma * interval / step)
    bend = math.hypot(track.acceleration, track.acceleration_sigma) * interval**2 / step
    apart = min(1.0 / max(rate + math.sqrt(rate * rate + 2.0 * bend), 1e-30), MOST_CORRELATED)
    blur = math.exp(-4.0 * math.pi**2 * noise.jitter * (track.speed / step) ** 2)
    noise.correlated = max(1.0 + (apart - 1.0) * blur, 1.0)


@compiled_in_place
def adapt_additive_noise(
    noise: Noise, differences: Differences, sampling: Sampling, track: Mixture, reading: float, tried: bool
) -> None:
    """Estimate the noise beyond jitter from the lag-1 autocovariance of second differences, -4 sigma^2 if white.

    The autocovariance of the motion is positive while ripple has many samples per wave, so motion adds no noise. With
    few samples per wave it may look like noise: such samples count only after models with ripple were `tried`.
    """
    since = max(sampling.time - differences.last_used_at, FINEST_S)
    moved = (reading - differences.last_used) * sampling.interval / since
    _add_white_noise(noise, differences, track.speed, moved - differences.moved)
    smooth = max(abs(moved), abs(differences.moved)) <= SMOOTH_MOVE
    bent = 0.0
    if smooth or tried:
        bent = moved - differences.moved
        found, variance = -0.25 * bent * differences.bent, measurement_variance(noise, track.speed)
        samples = ADDITIVE_SAMPLES if smooth else ADDITIVE_FEW
        noise.additive = _averaged(noise.additive, found - noise.jitter * track.speed**2, variance, samples)
        if track.still > 0.0:
            noise.standstill = _averaged(noise.standstill, found, variance, samples)
    differences.last_used, differences.last_used_at = reading, sampling.time
    differences.moved, differences.bent = moved, bent


@compiled_in_place
def _add_white_noise(noise: Noise, differences: Differences, speed: float, second: float) -> None:
    """Update the sums that bound the jitter: white noise from fourth differences (Rice 1984), and speed, squared.

    Motion of several readings per wave adds little to fourth differences, and always a positive amount. `second`: the
    latest second difference.
    """
    third = second - differences.second
    fourth = third - differences.third
    differences.second, differences.third = second, third
    differences.count += 1.0
    if differences.count > 3.0:  # the first three include the start values
        noise.white += fourth * fourth / FOURTH - max(rounding_variance(noise), noise.standstill)
        noise.speed_squared += speed**2


@compiled_in_place
def _averaged(variance: float, found: float, noise: float, samples: float) -> float:
    """Average a variance with one sample's estimate, bounded by the present `noise`, as it may be an outlier."""
    return max(variance + (min(max(found, -noise), MOST_ADDITIVE * noise) - variance) / samples, 0.0)


@compiled_in_place
def guess_resolution(noise: Noise, moved: float, repeated: float) -> None:
    """Guess the encoder's step while it is unknown: no move is smaller.

    The first two moves after a standstill, between equal readings, are one step if they are alike. Moves of a shaft
    whose sensor repeats its readings are not. `repeated`: equal readings before this move [rad].
    """
    if abs(moved) > FINEST_STEP_RAD:
        alike = repeated >= FEW_EQUAL and abs(moved - noise.lone_move) < SAME_MOVE * abs(moved)
        coarse = alike and noise.resolution == UNKNOWN_STEP_RAD
        noise.resolution = abs(moved) if coarse else min(noise.resolution, abs(moved))
        noise.lone_move = moved if repeated >= SETTLING else 0.0


@compiled_in_place
def is_repetition(repeats: Repeats, reading: float, last: float, before_rejected: float) -> bool:
    """Return whether a sensor that measures less often than it is read repeats its value.

    A longer repetition is a stop. After a rejected reading `last` the reading before it may be repeated.
    """
    if reading != last and reading != before_rejected:
        repeats.run = 0.0
        return False
    repeats.run += 1.0
    return bool(repeats.share > REPEATING and repeats.run <= repeats.longest + 1.0)


@compiled_in_place
def samples_between(repeats: Repeats, repeated: float) -> float:
    """Return the number of samples from the last reading to the next after `repeated` repetitions."""
    return 1.0 + repeated if repeats.share > REPEATING else 1.0


@compiled_in_place
def learn_repetitions(repeats: Repeats, noise: Noise, moved: float, used: float, repeated: float) -> None:
    """Learn from large moves, beyond rounding, whether they follow repetitions and how long these are.

    A large move counts once the next one has the same sign: an outlier returns at once. A sensor repeats about equally
    often each time.
    """
    before = repeats.before_move
    least = LARGE_MOVE_GUESSED if noise.guessed > 0.0 else LARGE_MOVE
    if abs(moved) <= least * max(noise.resolution, FINEST_STEP_RAD):
        return
    if moved * repeats.large_move > 0.0:
        most = repeats.longest + 1.0 if repeats.share > REPEATING else SETTLING
        memory = min(REPEAT_MEMORY[0] + 0.1 * used, REPEAT_MEMORY[1])
        repeats.share += ((1.0 if before > SIMILAR_REPEATS * repeats.longest else 0.0) - repeats.share) / memory
        repeats.longest = max(FORGET_REPEAT * repeats.longest, min(before, most))
    repeats.large_move, repeats.before_move = moved, repeated


@compiled_in_place
def standstill_speed(noise: Noise, speed: float, interval: float) -> float:
    """Return the speed [rad/s] below which the shaft stays within its measurement noise for SETTLING samples."""
    extent = max(noise.resolution, 3.0 * math.sqrt(measurement_variance(noise, speed)))
    return float(extent / (SETTLING * interval))


@compiled_in_place
def least_scale(noise: Noise, speed: float, interval: float, variance: float) -> float:
    """Return the lower bound of the filters' noise scale: the known rounding and jitter; 1 at standstill.

    Readings at standstill may be equal for hours, and stamps of a controller's cycle equally late for minutes, although
    the noise is not smaller.
    """
    at_rest = max(rounding_variance(noise), noise.additive, noise.standstill) + FINEST_RAD2
    if abs(speed) * interval <= max(noise.resolution, 3.0 * math.sqrt(at_rest)):
        return 1.0
    known = 0.0 if noise.guessed > 0.0 else rounding_variance(noise)
    return float(max((known + noise.jitter_configured * noise.jitter * speed**2) / variance, LEAST_SCALE))


@compiled_in_place
def set_resolution(record: Records, resolution: float) -> None:
    """Set the encoder's step [rad], 0 for none.

    Filters of a turning shaft keep the variance that they have learnt; at standstill they have learnt none.
    """
    for i in range(2 if record[0].gate.provisional > 0.0 else 1):
        status: FilterStatus = record[i]
        noise, track, interval = status.noise, status.track, status.sampling.interval
        before = measurement_variance(noise, track.speed)
        least = UNKNOWN_STEP_RAD if noise.guessed > 0.0 else noise.resolution
        turning = abs(track.speed) * interval > least
        noise.resolution, noise.guessed, status.repeats.share = resolution, 0.0, 0.0
        set_correlated(noise, track, interval)
        if turning:
            rescale(status.bank, before / measurement_variance(noise, track.speed))


@compiled_in_place
def begin_jitter(noise: Noise, interval: float) -> None:
    """Set the stamps' jitter to its initial value, unless it is configured."""
    if noise.jitter_configured == 0.0:
        noise.jitter = (FIRST_JITTER * interval) ** 2
    noise.white = noise.speed_squared = 0.0


@compiled_in_place
def adapt_jitter(bank: Bank, noise: Noise, track: Mixture, interval: float, variance: float) -> None:
    """Attribute the noise scale of the leading model's best filter to jitter, whose variance follows the speed.

    White noise of the readings bounds the jitter: a plain filter's scale may come from motion that it cannot follow.
    """
    leading = bank.models.leading
    found = bank.filters.scale[bank.models.best[leading]] * variance
    track.fastest = max(abs(track.speed), FORGET_SPEED * track.fastest)
    if noise.jitter_configured == 0.0:
        other = max(rounding_variance(noise), noise.standstill)
        jitter = max(found - other, LEAST_JITTER * found) / track.speed**2
        if leading == layout.PLAIN and noise.speed_squared > 0.0:
            jitter = min(jitter, max(MOST_WHITE * noise.white / noise.speed_squared, LEAST_JITTER * jitter))
        jitter = min(jitter, interval**2)  # near a stop any noise would give a larger jitter
        noise.jitter += LEARN_JITTER * (track.speed / track.fastest) ** 2 * (jitter - noise.jitter)
    noise.white *= FORGET_WHITE
    noise.speed_squared *= FORGET_WHITE
    rescale(bank, variance / measurement_variance(noise, track.speed))
