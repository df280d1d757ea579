"""Unwrapping: the turn of each reading, and whether the sensor's angle is wrapped or counts turns."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft.constants import FAR_ROUND, MAX_GAP_SIGMA, MAX_SPEED_RATIO, RANGE, SETTLING, USUAL_STEP
from textile_twin_core.shaft.status import OPEN, UNWRAPPED, WRAPPED, Mixture, Sampling, Unwrapping


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
