"""Samples on entry: rejected and late ones, gaps of the record, and the turn of each reading."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft.constants import (
    BUNCHED_STEP,
    FAR_ROUND,
    FINEST_S,
    GAP_SAMPLES,
    INTERVAL_EDGES,
    INTERVAL_SAMPLES,
    LARGEST,
    MAX_GAP_SIGMA,
    MAX_SPEED_RATIO,
    MAX_SPREAD,
    RANGE,
    REPEATING,
    SETTLING,
    USUAL_STEP,
)
from textile_twin_core.shaft.status import (
    OPEN,
    UNWRAPPED,
    WRAPPED,
    Counts,
    Mixture,
    Repeats,
    Sampling,
    Stamps,
    Unwrapping,
)

EVEN, BUNCHED, FASTER = 0, 1, 2  # arrival of a reading: in time; late, together with the one before; at a higher rate


@compiled_in_place
def admit(counts: Counts, unit: float, last: Stamps, stamp: float, angle: float) -> bool:
    """Accept a sample with finite angle and stamp, newer than `last` (1,); count the cause of a rejection."""
    counts.received += 1.0
    if not (abs(angle) <= LARGEST and abs(stamp * unit) <= LARGEST):  # false of NaN, too
        counts.not_finite += 1.0
        return False
    since = (stamp - last[0]) * unit
    if counts.accepted > 0.0 and since < FINEST_S:
        counts.duplicate_stamp += since >= 0.0
        counts.older_stamp += since < 0.0
        return False
    counts.accepted += 1.0
    return True


@compiled_in_place
def classify_arrival(sampling: Sampling, step: float) -> int:
    """Count readings in a row that came close together; return EVEN, BUNCHED or FASTER.

    More than a few in a row did not arrive late: the rate rose after a pause. Edges are stamped as they pass.
    """
    sampling.bunched = sampling.bunched + 1.0 if step < BUNCHED_STEP * sampling.interval else 0.0
    if sampling.bunched == 0.0:
        return EVEN
    return BUNCHED if sampling.bunched <= most_bunched(sampling) else FASTER


@compiled_in_place
def most_bunched(sampling: Sampling) -> float:
    """Return the maximum number of readings in a row that may have arrived late."""
    return 1.0 if sampling.edges > 0.0 else SETTLING


@compiled_in_place
def is_gap(sampling: Sampling, track: Mixture, period: float, step: float) -> bool:
    """Return whether the record has a gap: a long one, or one that leaves the turn of a wrapped angle ambiguous."""
    spread = step * (track.speed_sigma + 0.5 * step * track.acceleration_sigma)
    ambiguous = step > 2.0 * sampling.interval and spread > MAX_SPREAD * period > 0.0
    return ambiguous or step > GAP_SAMPLES * sampling.interval


@compiled_in_place
def average_interval(sampling: Sampling, step: float) -> None:
    """Update the mean interval; those of edges follow the speed."""
    gain = 1.0 / min(sampling.samples, INTERVAL_EDGES if sampling.edges > 0.0 else INTERVAL_SAMPLES)
    sampling.interval += (min(step, GAP_SAMPLES * sampling.interval) - sampling.interval) * gain


@compiled_in_place
def is_turn_ambiguous(sampling: Sampling, track: Mixture, repeats: Repeats, period: float, step: float) -> bool:
    """Return whether a wrapped angle moves by more than half a period per interval."""
    longest = max(step, sampling.interval) if sampling.since < SETTLING else sampling.interval
    if repeats.share > REPEATING:
        longest *= 1.0 + repeats.longest
    return period > 0.0 and 2.0 * abs(track.speed) * longest > period


@compiled_in_place
def begin_unwrapping(unwrapping: Unwrapping, angle: float, phase: float) -> None:
    """Begin with a record's first reading: `angle` [rad], and `phase` without its whole turns."""
    unwrapping.low = unwrapping.high = phase
    if unwrapping.auto > 0.0 and abs(angle - unwrapping.encoder_zero) > FAR_ROUND * unwrapping.period:
        unwrapping.period = 0.0
    unwrapping.wrapping = UNWRAPPED if unwrapping.period == 0.0 else OPEN if unwrapping.auto > 0.0 else WRAPPED


@compiled_in_place
def unwrap_reading(unwrapping: Unwrapping, samples: float, raw: float, expected: float) -> float:
    """Unwrap a reading [rad] to the turn nearest the prediction; readings that span over a period are not wrapped.

    `samples`: those accepted so far.
    """
    if unwrapping.auto > 0.0 and unwrapping.period > 0.0:
        # An outlier is alone: the range is that of pairs in a row, except for the first few readings.
        before = unwrapping.last - unwrapping.slips if samples > SETTLING else raw
        unwrapping.low, unwrapping.high = min(unwrapping.low, max(raw, before)), max(unwrapping.high, min(raw, before))
        if unwrapping.high - unwrapping.low > RANGE * unwrapping.period:
            unwrapping.period = unwrapping.slips = 0.0
            unwrapping.wrapping = UNWRAPPED
    if unwrapping.period > 0.0:
        unwrapping.slips = unwrapping.period * np.rint((expected - raw) / unwrapping.period)
    return float(raw + unwrapping.slips)


@compiled_in_place
def unwrap_move(
    unwrapping: Unwrapping, sampling: Sampling, track: Mixture,
    raw: float, expected: float, variance: float, step: float, repeated: float,
) -> float:  # fmt: skip
    """Unwrap a reading [rad] `step` [s] after the last, of a shaft that moves by less than half a period per interval.

    A reading that the track does not predict is taken to the turn nearest the reading before it: a start or a reversal
    leaves the predicted turn, but not the half period around the last reading. While the wrapping is open, that holds
    for each reading, so that only a move of more than half a period adds a turn. Such a move that ends where the track
    leads shows a wrapped angle. After missed samples the prediction decides, in an open wrapping if the reading fits.
    `variance` [rad^2] is the reading's, `repeated` the number of equal readings before it.
    """
    last, before = unwrapping.last, unwrapping.slips
    reading = unwrap_reading(unwrapping, sampling.samples, raw, expected)
    if unwrapping.period == 0.0:
        return reading
    sigma = step * (track.speed_sigma + 0.5 * step * track.acceleration_sigma) + math.sqrt(variance)
    predicted = sigma <= MAX_GAP_SIGMA and abs(reading - expected) <= 3.0 * sigma
    slips = unwrapping.period * np.rint((last - raw) / unwrapping.period)
    if slips == unwrapping.slips:
        if predicted and slips != before:
            unwrapping.wrapping = WRAPPED
        return reading
    # A value that was repeated may be older than the reading before.
    missed = raw + slips != last and step * (1.0 + repeated) > USUAL_STEP * sampling.interval
    too_fast = 0.0 < MAX_SPEED_RATIO * track.fastest * step < abs(raw + slips - last)
    if not (predicted and missed if unwrapping.wrapping == OPEN else predicted or missed or too_fast):
        unwrapping.slips = slips
    return float(raw + unwrapping.slips)
