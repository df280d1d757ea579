"""Recursion shared by all views: for each sample predict, gate, update filters and models, adapt the noise.

The estimators `causal` and `smooth` call `run_filter`, the estimator `lag` calls `process_sample`; live nodes and
recordings run the same compiled code. `status` declares the fields of a status and of a row. docs/shaft.md has the
method, its sources, the cost of a sample and the accuracy. tests/shaft/test_beside_the_textbook.py compares the
states with textbook filters tuned to each record, test_accuracy.py with known motions.
"""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import by_reference, compiled_in_place
from textile_twin_core.shaft import layout, measurement_noise, model_bank, outlier_gate
from textile_twin_core.shaft.constants import (
    ADAPT_EVERY,
    FAR_FROM_READING,
    FINEST_MOTION,
    FORGET_NOISE,
    GAP_SAMPLES,
    LEAST_SPEED,
    MAX_SPEED_SIGMA,
    MAX_STEP_INNOVATION,
    MOST_GAIN,
    OUTLIER_DENSITY,
    REPEATING,
    ROUNDED_APART,
    SETTLING,
    USUAL_STEP,
)
from textile_twin_core.shaft.filter_bank import predict_reading, reset_ripple_covariance, update_second_order
from textile_twin_core.shaft.kalman import time_update
from textile_twin_core.shaft.residual_orders import add_systematic, average_orders, set_systematic
from textile_twin_core.shaft.samples import (
    BUNCHED,
    FASTER,
    admit,
    average_interval,
    begin_unwrapping,
    classify_arrival,
    is_gap,
    is_turn_ambiguous,
    most_bunched,
    unwrap_move,
    unwrap_reading,
)
from textile_twin_core.shaft.status import (
    MANOEUVRE,
    RUNNING,
    STANDSTILL,
    STARTING,
    Counts,
    FilterRow,
    FilterStatus,
    Mixture,
    Records,
    Stamps,
)
from textile_twin_core.shaft.turns import TURN, split_turn


@by_reference
class Block(NamedTuple):
    """A block of n input samples."""

    last: Stamps  # (1,) the newest stamp accepted
    stamps: Stamps  # (n,)
    angles: FloatArray  # (n,) [rad]
    velocities: FloatArray  # (n,) [rad/s], NaN for none, or empty
    unwrapped: FloatArray  # (n,) output: unwrapped readings for the encoder's resolution, else NaN


@compiled_in_place
def run_filter(record: Records, block: Block, table: Records) -> int:
    """Filter a block of samples; fill a row of `table` for each accepted one and return their number.

    Args:
        record: (2,) STATUS, the second one for a provisional reading.
        block: the samples.
        table: (n,) ROW, output.
    """
    count = 0
    for i in range(block.stamps.size):
        count += process_sample(record, block, i, table[count])
    return count


@partial(compiled_in_place, inlined=True)
def process_sample(record: Records, block: Block, i: int, row: FilterRow) -> bool:
    """Filter sample `i` of a block and fill its row; return whether it was accepted.

    An outlier is accepted, too: its row has the predicted state and `noise` 0. `admit` has the causes of a rejection.
    """
    status: FilterStatus = record[0]
    stamp, angle = block.stamps[i], block.angles[i]
    sampling, track, unwrapping = status.sampling, status.track, status.unwrapping
    block.unwrapped[i] = math.nan
    if not admit(status.counts, sampling.unit, block.last, stamp, angle):
        return False
    step, confirmed = (stamp - block.last[0]) * sampling.unit, False
    turns, phase = split_turn(angle)
    raw = phase + (turns - unwrapping.origin) * TURN
    if status.gate.provisional > 0.0:
        confirmed = outlier_gate.reconsider(record, raw, step, step > GAP_SAMPLES * sampling.interval)
    block.last[0] = stamp
    track.sensor_speed = block.velocities[i] if block.velocities.size > 0 else math.nan
    sampling.samples += 1.0
    row.index, row.settled = status.counts.received - 1.0, -1.0
    row.noise = row.gate_noise = row.cut = row.intensity = row.residual = 0.0
    if sampling.samples == 1.0:
        unwrapping.origin, sampling.time = turns, 0.0
        track.angle = row.reading = row.angle = phase
        row.origin = turns
        begin_unwrapping(unwrapping, angle, phase)
        put_angle(row, phase)
    else:
        sampling.time += step
        sampling.longest = max(sampling.longest, step)
        row.step, row.time, row.correlated = step, sampling.time, status.noise.correlated
        if sampling.samples == 2.0:
            reading = unwrap_reading(unwrapping, sampling.samples, raw, track.angle)
            outlier_gate.initiate(status, step, reading, (reading - track.angle) / step, row)
        else:
            _process_reading(record, step, raw, row)
        if status.gate.provisional > 0.0:
            _report_provisional(record, row)
        else:
            _report_state(status, row)
        row.interval = sampling.interval
        if confirmed and row.cut == 0.0 and row.noise > 0.0:
            row.cut = MANOEUVRE
    # Samples at the rate of the encoder's steps may skip a step and look like outliers: within a move they count, too.
    within = MAX_STEP_INNOVATION * abs(track.speed) * sampling.interval
    if row.noise > 0.0 or abs(row.reading - track.angle) <= within:
        block.unwrapped[i] = row.reading
    return True


@partial(compiled_in_place, inlined=True)
def _process_reading(record: Records, step: float, raw: float, row: FilterRow) -> None:
    """Process a reading from the third on, `raw` [rad] before unwrapping, `step` [s] after the one before."""
    status: FilterStatus = record[0]
    bank, sampling, track, unwrapping = status.bank, status.sampling, status.track, status.unwrapping
    arrival, gap = classify_arrival(sampling, step), is_gap(sampling, track, unwrapping.period, step)
    if arrival != BUNCHED:
        sampling.since += 1.0
        status.gate.since_slip += 1.0
    if not gap or sampling.since < GAP_SAMPLES:
        average_interval(sampling, step)
    expected = outlier_gate.predicted_angle(track, step)
    variance = measurement_noise.measurement_variance(status.noise, track.speed)
    if gap and sampling.since > 1.0:
        status.counts.gaps += 1.0
        expected = unwrap_reading(unwrapping, sampling.samples, raw, expected)
        known = sampling.since >= SETTLING
        if not known or not outlier_gate.is_predicted(bank, variance, sampling.interval, step, expected):
            outlier_gate.bridge_gap(status, step, raw, row)
            return
    # A gap just after an initiation: its interval was wrong.
    ambiguous = is_turn_ambiguous(sampling, track, status.repeats, unwrapping.period, step)
    begins = (gap and sampling.since <= 1.0) or (ambiguous and arrival != BUNCHED)
    if begins or arrival == BUNCHED:
        reading = unwrap_reading(unwrapping, sampling.samples, raw, unwrapping.last if begins else expected)
    else:
        scaled = variance * bank.filters.scale[bank.models.best[bank.models.leading]]
        reading = unwrap_move(unwrapping, sampling, track, raw, expected, scaled, step, status.repeats.run)
    rate = _rate_of_new_track(status, arrival, begins, reading, reading - expected, step)
    if not math.isnan(rate):
        status.counts.losses += arrival != FASTER
        outlier_gate.initiate(status, step, reading, rate, row)
        return
    repeated = status.repeats.run
    copied = _classify_reading(status, arrival, reading, reading - expected, step, row)
    track.angle, row.reading = expected, reading
    variance = _predict(status, step, repeated, copied, row)
    if copied:
        row.noise = 0.0
        status.counts.repeats += 1.0
    elif _passes_gate(record, reading, reading - expected, step, row):
        settles = sampling.since - status.gate.rejected_run <= SETTLING <= sampling.since
        turning = _update(status, reading - expected, repeated, variance, row)
        _adapt(status, reading, repeated, variance, turning, settles)


@compiled_in_place
def _rate_of_new_track(
    status: FilterStatus, arrival: int, begins: bool, reading: float, innovation: float, step: float
) -> float:
    """Return the speed [rad/s] with which the track begins again at a reading; NaN where it continues."""
    sampling, track, noise, repeats = status.sampling, status.track, status.noise, status.repeats
    moved = reading - status.unwrapping.last
    if begins and (moved != 0.0 or repeats.share <= REPEATING):
        return float(moved / (step * (1.0 + repeats.run)))
    variance = measurement_noise.measurement_variance(noise, track.speed)
    if outlier_gate.is_false_start(sampling, status.differences, variance, reading, innovation, step):
        noise.additive, track.sense = 0.0, 0.0
        return float(moved / step)
    if arrival != BUNCHED and outlier_gate.is_runaway(status.gate, track, noise.resolution, moved, step):
        track.fastest = 0.0
        return float(math.copysign(status.gate.travel, repeats.large_move) / sampling.interval)
    return float(moved / step) if arrival == FASTER else math.nan


@compiled_in_place
def _classify_reading(
    status: FilterStatus, arrival: int, reading: float, innovation: float, step: float, row: FilterRow
) -> bool:
    """Compare a reading with the last one: guess the encoder's step; return whether it is late or a repeated value."""
    noise, sampling, unwrapping = status.noise, status.sampling, status.unwrapping
    moved = reading - unwrapping.last
    if noise.guessed > 0.0:
        measurement_noise.guess_resolution(noise, moved, status.repeats.run)
    if max(abs(moved - status.track.speed * step), abs(innovation)) > ROUNDED_APART * noise.resolution:
        noise.correlated = row.correlated = 1.0
    before_rejected = status.differences.last_used if status.gate.rejected_run > 0.0 else unwrapping.last
    late = arrival == BUNCHED
    copied = late or measurement_noise.is_repetition(status.repeats, reading, unwrapping.last, before_rejected)
    if not late or sampling.bunched == most_bunched(sampling):
        unwrapping.last = reading
    return copied


@partial(compiled_in_place, inlined=True)
def _predict(status: FilterStatus, step: float, repeated: float, copied: bool, row: FilterRow) -> float:
    """Predict the reading of a row in all filters of the active models; set and return its variance [rad^2]."""
    bank, sampling, track, noise = status.bank, status.sampling, status.track, status.noise
    models, turned = bank.models, abs(track.speed) * step
    row.unit = variance = measurement_noise.measurement_variance(noise, track.speed)
    row.noise = bank.filters.scale[models.best[models.leading]] * variance
    if not copied and step < USUAL_STEP * sampling.interval:
        moved = measurement_noise.samples_between(status.repeats, repeated) * turned
        sampling.move += (moved - sampling.move) * min(moved / TURN, MOST_GAIN)  # the mean of a turn
    for f in range(1, layout.MODELS):
        model_bank.begin_or_suspend(bank, status.orders, sampling, track, noise, f, turned)
    # Memory N: q = r / (N^6 T^5) (Kalata 1984). The noise of stamps vanishes at a stop, but q must follow the stop.
    noise.recent = max(variance, FORGET_NOISE * noise.recent, FINEST_MOTION)
    strength = math.sqrt(noise.recent * step / sampling.interval**5)
    for f in range(layout.MODELS - 1, -1, -1):
        if models.active[f] > 0.0:
            time_update(bank.filters, strength, step, layout.FIRST[f], layout.STOP[f])
            was_observed = model_bank.is_observed(bank, f)
            models.travelled[f] = max(models.travelled[f], abs(track.angle - models.start_angle[f]))
            observed = model_bank.is_observed(bank, f)
            if observed and not was_observed:
                update_second_order(bank, f)  # needed by the first likelihood that counts
            # The ripple is evaluated at the reading until the model is observed, then at the predicted angle.
            predict_reading(bank, f, step, row.reading, track.angle if observed else row.reading, variance)
    return variance


@partial(compiled_in_place, inlined=True)
def _passes_gate(record: Records, reading: float, innovation: float, step: float, row: FilterRow) -> bool:
    """Return whether a reading is used: all filters find it probable, or it belongs to a manoeuvre."""
    status: FilterStatus = record[0]
    density = 0.0
    models = status.bank.models
    for f in range(layout.MODELS - 1, -1, -1):
        if models.active[f] > 0.0:
            density += models.mode_probability[f] * models.density[f]
    outlying = density < OUTLIER_DENSITY or outlier_gate.is_alike(status.gate, innovation, status.sampling.used)
    if not outlying or status.sampling.since <= 5.0:
        return True
    return outlier_gate.accept_manoeuvre(record, reading, innovation, step, row)


@partial(compiled_in_place, inlined=True)
def _update(status: FilterStatus, innovation: float, repeated: float, variance: float, row: FilterRow) -> bool:
    """Update filters, model probabilities and residual orders with an accepted reading; return whether it turns."""
    bank, gate, sampling, track, noise = status.bank, status.gate, status.sampling, status.track, status.noise
    sampling.used += 1.0
    was_outlier = gate.rejected_run > 0.0 and row.cut == 0.0 and not outlier_gate.is_growing(gate, innovation)
    if was_outlier:
        outlier_gate.learn_abruptness(gate, False)
    gate.clean = 0.0 if was_outlier else gate.clean + 1.0
    gate.rejected_run = gate.innovation_before = gate.last_innovation = 0.0
    span = measurement_noise.samples_between(status.repeats, repeated) * sampling.interval
    noticed = 3.0 * math.sqrt(row.noise)
    turning = span * abs(track.speed) > noticed
    # A ripple model may take a start for ripple, so that the mixture stands still; the plain model shows the start.
    starting = span * abs(bank.filters.clock[layout.RATE, bank.models.best[layout.PLAIN]]) > noticed
    least = measurement_noise.least_scale(noise, track.speed, sampling.interval, variance)
    model_bank.update_mode_probabilities(bank, sampling, track.speed, variance, least, turning or starting)
    if turning:
        average_orders(bank, status.orders, sampling, track.angle, variance)
    return turning


@compiled_in_place
def _adapt(
    status: FilterStatus, reading: float, repeated: float, variance: float, turning: bool, settles: bool
) -> None:
    """Adapt repetitions, additive noise and jitter to a used reading of this variance [rad^2].

    `settles`: the filters' noise scales have just converged.
    """
    bank, sampling, track, noise, repeats = status.bank, status.sampling, status.track, status.noise, status.repeats
    share_before, moved = repeats.share, reading - status.differences.last_used
    measurement_noise.learn_repetitions(repeats, noise, moved, sampling.used, repeated)
    if share_before <= REPEATING < repeats.share:
        _reset_adaptation(status)
    tried = bank.models.ripple_tried > 0.0
    measurement_noise.adapt_additive_noise(noise, status.differences, sampling, track, reading, tried)
    if settles and not tried:
        for f in range(1, layout.MODELS):  # prior covariances in units of the noise scale, which has converged now
            reset_ripple_covariance(bank, f, 0)
    if sampling.used % ADAPT_EVERY == 0.0 and turning and sampling.since > ADAPT_EVERY / 2.0:
        measurement_noise.adapt_jitter(bank, noise, track, sampling.interval, variance)


@compiled_in_place
def _reset_adaptation(status: FilterStatus) -> None:
    """Reset everything but the plain states: repeated values were taken for readings so far."""
    orders, repeats = status.orders, status.repeats
    model_bank.reset_models(status.bank)
    orders.sums[:] = 0.0
    orders.average_weight = orders.reading_variance = orders.sensor_power = orders.high_orders = 0.0
    status.track.fastest = 0.0
    status.sampling.move *= 1.0 + 0.5 * (repeats.longest + repeats.before_move)
    measurement_noise.begin_jitter(status.noise, status.sampling.interval)


@compiled_in_place
def _report_state(status: FilterStatus, row: FilterRow) -> None:
    """Write the mixture's state and covariance, its convergence, and the smoothers' data into a row."""
    bank, sampling, track, noise, gate = status.bank, status.sampling, status.track, status.noise, status.gate
    model_bank.combine(bank, track, row)
    sigma = math.sqrt(max(row.covariance[4], 0.0))
    track.speed_sigma, track.acceleration_sigma = sigma, math.sqrt(max(row.covariance[8], 0.0))
    measurement_noise.set_correlated(noise, track, sampling.interval)
    least = measurement_noise.standstill_speed(noise, track.speed, sampling.interval)
    _detect_motion(track, status.counts, sampling.since, sigma, least)
    if sampling.samples > 2.0:
        # Bounded by the highest speed so far: outliers imitate speeds at which any sigma would pass.
        speed = abs(track.speed) if track.fastest == 0.0 else min(abs(track.speed), track.fastest)
        limit = max(MAX_SPEED_SIGMA * max(speed, LEAST_SPEED * track.fastest), least)
        near = row.noise == 0.0 or abs(row.reading - track.angle) <= FAR_FROM_READING
        settled = sigma <= limit and gate.unconfirmed == 0.0 and sampling.since >= SETTLING and near
        row.settled = 1.0 if settled else 0.0
    set_systematic(bank.models, row, track.speed, least)
    add_systematic(row, 1.0)
    if row.noise > 0.0:
        gate.unconfirmed = max(gate.unconfirmed - 1.0, 0.0)
    row.angle, row.origin, row.leading = track.angle, status.unwrapping.origin, float(bank.models.leading)
    put_angle(row, track.angle)
    for f in range(layout.MODELS):
        row.memory[f] = model_bank.memory_of(bank, f)


@compiled_in_place
def _report_provisional(record: Records, row: FilterRow) -> None:
    """Report the state with a provisional reading; smoothers treat it as rejected until the next one confirms it."""
    noise, row.noise = row.noise, 0.0
    _report_state(record[1], row)
    theta, row.noise = row.angle, noise
    _report_state(record[0], row)
    row.angle, row.noise, row.cut = theta, 0.0, 0.0


@compiled_in_place
def _detect_motion(track: Mixture, counts: Counts, since: float, sigma: float, least: float) -> None:
    """Detect standstill, slower than `least` [rad/s], and reversals; `sigma` [rad/s] is the speed's deviation.

    `since`: samples since the track began.
    """
    track.still = track.still + 1.0 if abs(track.speed) < least else 0.0
    if since < SETTLING:
        track.motion = STARTING
    elif track.still > SETTLING:
        counts.standstills += track.motion != STANDSTILL
        track.motion = STANDSTILL
    elif track.still == 0.0 or track.motion != STANDSTILL:
        track.motion = RUNNING
    if abs(track.speed) > 10.0 * least + 3.0 * sigma:
        sense = 1.0 if track.speed > 0.0 else -1.0
        counts.reversals += track.sense == -sense
        track.sense = sense


@compiled_in_place
def put_angle(row: FilterRow, angle: float) -> None:
    """Write an angle [rad], relative to the row's origin, as whole turns and phase."""
    turns = np.floor(angle / TURN + 0.5)
    row.phase = angle - turns * TURN
    row.turns = row.origin + turns
