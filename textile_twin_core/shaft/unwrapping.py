"""Unwrapping: the turn of each reading, and whether the sensor's angle is wrapped or counts turns."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft.measurement_noise import SETTLING, measurement_variance
from textile_twin_core.shaft.status import OPEN, UNWRAPPED, WRAPPED, Record

FAR_ROUND = 2.0  # periods from the encoder's 0 beyond which a first reading is not wrapped
RANGE = 1.25  # periods that the readings of an unwrapped angle span
MAX_SPEED_RATIO = 2.0  # of the highest speed so far, above which a move is unlikely: outliers line up by chance
USUAL_STEP = 1.5  # intervals up to which no sample is missing between two readings
MAX_GAP_SIGMA = 0.05  # [rad] predicted across a gap or a turn: at most 1 in 20 other motions passes 3 sigma by chance


@compiled_in_place
def begin_unwrapping(status: Record, angle: float, phase: float) -> None:
    """Begin with a record's first reading: `angle` [rad], and `phase` without its whole turns."""
    status.low = status.high = phase
    if status.auto > 0.0 and abs(angle - status.encoder_zero) > FAR_ROUND * status.period:
        status.period = 0.0
    status.wrapping = UNWRAPPED if status.period == 0.0 else OPEN if status.auto > 0.0 else WRAPPED


@compiled_in_place
def unwrap_reading(status: Record, raw: float, expected: float) -> float:
    """Unwrap a reading [rad] to the turn nearest the prediction; readings that span over a period are not wrapped."""
    if status.auto > 0.0 and status.period > 0.0:
        # An outlier is alone: the range is that of pairs in a row, except for the first few readings.
        before = status.last_reading - status.slips if status.samples > SETTLING else raw
        status.low, status.high = min(status.low, max(raw, before)), max(status.high, min(raw, before))
        if status.high - status.low > RANGE * status.period:
            status.period = status.slips = 0.0
            status.wrapping = UNWRAPPED
    if status.period > 0.0:
        status.slips = status.period * np.rint((expected - raw) / status.period)
    return float(raw + status.slips)


@compiled_in_place
def unwrap_move(status: Record, raw: float, expected: float, step: float) -> float:
    """Unwrap a reading [rad] `step` [s] after the last, of a shaft that moves by less than half a period per interval.

    A reading that the track does not predict is taken to the turn nearest the reading before it: a start or a reversal
    leaves the predicted turn, but not the half period around the last reading. While the wrapping is open, that holds
    for each reading, so that only a move of more than half a period adds a turn. Such a move that ends where the track
    leads shows a wrapped angle. After missed samples the prediction decides, in an open wrapping if the reading fits.
    """
    last, before = status.last_reading, status.slips
    reading = unwrap_reading(status, raw, expected)
    if status.period == 0.0:
        return reading
    spread = step * (status.speed_sigma + 0.5 * step * status.acceleration_sigma)
    sigma = spread + math.sqrt(measurement_variance(status) * status.scale[status.best[status.leading]])
    predicted = sigma <= MAX_GAP_SIGMA and abs(reading - expected) <= 3.0 * sigma
    slips = status.period * np.rint((last - raw) / status.period)
    if slips == status.slips:
        if predicted and slips != before:
            status.wrapping = WRAPPED
        return reading
    # A value that was repeated may be older than the reading before.
    missed = raw + slips != last and step * (1.0 + status.repeat_run) > USUAL_STEP * status.interval
    too_fast = 0.0 < MAX_SPEED_RATIO * status.fastest * step < abs(raw + slips - last)
    if not (predicted and missed if status.wrapping == OPEN else predicted or missed or too_fast):
        status.slips = slips
    return float(raw + status.slips)
