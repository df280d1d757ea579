"""Recursion shared by all views: for each sample predict, gate, update filters and models, adapt the noise.

The estimators `causal` and `smooth` call `run_filter`, the estimator `lag` calls `process_sample`; live nodes and
recordings run the same compiled code. `status` declares the fields of a status and of a row. docs/shaft.md has the
method, its sources, the cost of a sample and the accuracy. tests/shaft/test_beside_the_textbook.py compares the
states with textbook filters tuned to each record, test_accuracy.py with known motions.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import by_reference, compiled_in_place
from textile_twin_core.shaft import layout, measurement_noise, model_bank, outlier_gate
from textile_twin_core.shaft.filter_bank import predict_reading, reset_ripple_covariance, update_second_order
from textile_twin_core.shaft.kalman import time_update
from textile_twin_core.shaft.residual_orders import add_systematic, average_orders, set_systematic
from textile_twin_core.shaft.status import MANOEUVRE, RUNNING, STANDSTILL, STARTING, Record, Records, Stamps
from textile_twin_core.shaft.turns import TURN, split_turn
from textile_twin_core.shaft.unwrapping import USUAL_STEP, begin_unwrapping, unwrap_move, unwrap_reading

LARGEST = 1e12  # angle [rad] and stamp [s]: larger ones are no motion, and their squares would overflow
# density of outliers in the gate [1/rad]; densities omit the constant 0.38 of Student's t: 0.02 * 0.38 = 1 / 130
OUTLIER_DENSITY = 0.02
GAP_SAMPLES = 50.0  # intervals without a sample that make a gap
MAX_SPREAD = 1.0 / 6.0  # sigma of a predicted angle, in periods, from which the turn of a wrapped angle is ambiguous
# largest speed sigma of a converged state, over the speed; least speed in that rule, over the highest speed so far
MAX_SPEED_SIGMA, LEAST_SPEED = 0.25, 0.3
ROUNDED_APART = 1.3  # encoder steps beyond the predicted move from which two rounding errors are uncorrelated
# innovation, in moves per interval, up to which a rejected reading still counts for the encoder's step
MAX_STEP_INNOVATION = 1.5
BUNCHED = 0.1  # part of the mean interval: readings closer in time arrived late, together, and are not used
MOST_GAIN = 0.2  # maximum weight of a single move in their mean
FORGET_NOISE = 0.9  # decay, per sample, of the noise that the process noise is relative to
ADAPT_EVERY = 32.0  # samples between two adaptations of the jitter
INTERVAL_SAMPLES, INTERVAL_EDGES = 500.0, 60.0  # memory of the mean interval; edges' intervals follow the speed


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

    `record` (2,) holds the status and, while the latest reading is provisional, the status without that reading.
    """
    count = 0
    for i in range(block.stamps.size):
        count += process_sample(record, block, i, table[count])
    return count


@compiled_in_place
def process_sample(record: Records, block: Block, i: int, row: Record) -> bool:
    """Filter sample `i` of a block and fill its row; return whether it was accepted.

    An outlier is accepted, too: its row has the predicted state and `noise` 0. `_admit` has the causes of a rejection.
    """
    status, stamp, angle = record[0], block.stamps[i], block.angles[i]
    block.unwrapped[i] = math.nan
    if not _admit(status, block.last, stamp, angle):
        return False
    step, confirmed = (stamp - block.last[0]) * status.unit, False
    turns, phase = split_turn(angle)
    raw = phase + (turns - status.origin) * TURN
    if status.provisional > 0.0:
        confirmed = outlier_gate.reconsider(record, raw, step, step > GAP_SAMPLES * status.interval)
    block.last[0] = stamp
    status.sensor_speed = block.velocities[i] if block.velocities.size > 0 else math.nan
    status.samples += 1.0
    row.index, row.settled = status.received - 1.0, -1.0
    row.noise = row.gate_noise = row.cut = row.intensity = row.residual = 0.0
    if status.samples == 1.0:
        status.origin, status.time = turns, 0.0
        status.angle = row.reading = row.angle = phase
        row.origin = turns
        begin_unwrapping(status, angle, phase)
        put_angle(row, phase)
    else:
        status.time += step
        status.longest = max(status.longest, step)
        row.step, row.time, row.correlated = step, status.time, status.correlated
        if status.samples == 2.0:
            reading = unwrap_reading(status, raw, status.angle)
            outlier_gate.initiate(status, step, reading, (reading - status.angle) / step, row)
        else:
            _process_reading(record, step, raw, row)
        if status.provisional > 0.0:
            _report_provisional(record, row)
        else:
            _report_state(status, row)
        row.interval = status.interval
        if confirmed and row.cut == 0.0 and row.noise > 0.0:
            row.cut = MANOEUVRE
    # Samples at the rate of the encoder's steps may skip a step and look like outliers: within a move they count, too.
    if row.noise > 0.0 or abs(row.reading - status.angle) <= MAX_STEP_INNOVATION * abs(status.speed) * status.interval:
        block.unwrapped[i] = row.reading
    return True


@compiled_in_place
def _admit(status: Record, last: Stamps, stamp: float, angle: float) -> bool:
    """Accept a sample with finite angle and stamp, newer than `last` (1,); count the cause of a rejection."""
    status.received += 1.0
    if not (abs(angle) <= LARGEST and abs(stamp * status.unit) <= LARGEST):  # false of NaN, too
        status.not_finite += 1.0
        return False
    since = (stamp - last[0]) * status.unit
    if status.accepted > 0.0 and since < measurement_noise.FINEST_S:
        status.duplicate_stamp += since >= 0.0
        status.older_stamp += since < 0.0
        return False
    status.accepted += 1.0
    return True


@compiled_in_place
def _process_reading(record: Records, step: float, raw: float, row: Record) -> None:
    """Process a reading from the third on, `raw` [rad] before unwrapping, `step` [s] after the one before."""
    status = record[0]
    status.bunched = status.bunched + 1.0 if step < BUNCHED * status.interval else 0.0
    # More than `most` in a row did not arrive late: the rate rose after a pause. Edges are stamped as they pass.
    most = 1.0 if status.edges > 0.0 else measurement_noise.SETTLING
    bunched, rate_rose = 0.0 < status.bunched <= most, status.bunched > most
    if not bunched:
        status.since += 1.0
        status.since_slip += 1.0
    spread = step * (status.speed_sigma + 0.5 * step * status.acceleration_sigma)
    turn_unknown = step > 2.0 * status.interval and spread > MAX_SPREAD * status.period > 0.0
    gap = turn_unknown or step > GAP_SAMPLES * status.interval
    if not gap or status.since < GAP_SAMPLES:
        gain = 1.0 / min(status.samples, INTERVAL_EDGES if status.edges > 0.0 else INTERVAL_SAMPLES)
        status.interval += (min(step, GAP_SAMPLES * status.interval) - status.interval) * gain
    expected = outlier_gate.predicted_angle(status, step)
    if gap and status.since > 1.0:
        status.gaps += 1.0
        expected = unwrap_reading(status, raw, expected)
        if status.since < measurement_noise.SETTLING or not outlier_gate.is_predicted(status, step, expected):
            outlier_gate.bridge_gap(status, step, raw, row)
            return
    longest = max(step, status.interval) if status.since < measurement_noise.SETTLING else status.interval
    if status.repeat_share > measurement_noise.REPEATING:
        longest *= 1.0 + status.longest_repeat
    aliased = status.period > 0.0 and 2.0 * abs(status.speed) * longest > status.period
    # Above half a period per interval the turn is ambiguous. A gap just after an initiation: its interval was wrong.
    begins = (aliased and not bunched) or (gap and status.since <= 1.0)
    if begins or bunched:
        reading = unwrap_reading(status, raw, status.last_reading if begins else expected)
    else:
        reading = unwrap_move(status, raw, expected, step)
    innovation, rate = reading - expected, math.nan
    if begins and (reading != status.last_reading or status.repeat_share <= measurement_noise.REPEATING):
        rate = (reading - status.last_reading) / (step * (1.0 + status.repeat_run))
    elif outlier_gate.is_false_start(status, reading, innovation, step):
        status.additive, status.sense, rate = 0.0, 0.0, (reading - status.last_reading) / step
    elif not bunched and outlier_gate.is_runaway(status, reading - status.last_reading, step):
        status.fastest, rate = 0.0, math.copysign(status.travel, status.large_move) / status.interval
    elif rate_rose:
        rate = (reading - status.last_reading) / step
    if not math.isnan(rate):
        status.losses += not rate_rose
        outlier_gate.initiate(status, step, reading, rate, row)
        return
    if status.guessed > 0.0:
        measurement_noise.guess_resolution(status, reading - status.last_reading)
    if (
        max(abs(reading - status.last_reading - status.speed * step), abs(innovation))
        > ROUNDED_APART * status.resolution
    ):
        status.correlated = row.correlated = 1.0
    repeated = status.repeat_run
    copied = bunched or measurement_noise.is_repetition(status, reading)
    status.angle, row.reading = expected, reading
    if status.bunched == 0.0 or status.bunched == most:
        status.last_reading = reading
    row.unit = noise = measurement_noise.measurement_variance(status)
    row.noise = status.scale[status.best[status.leading]] * noise
    density, turned = 0.0, abs(status.speed) * step
    if not copied and step < USUAL_STEP * status.interval:
        moved = measurement_noise.samples_between(status, repeated) * turned
        status.move += (moved - status.move) * min(moved / TURN, MOST_GAIN)  # the mean of a turn
    for f in range(1, layout.MODELS):
        model_bank.begin_or_suspend(status, f, turned)
    # Memory N: q = r / (N^6 T^5) (Kalata 1984). The noise of stamps vanishes at a stop, but q must follow the stop.
    status.recent_noise = max(noise, FORGET_NOISE * status.recent_noise, measurement_noise.FINEST_MOTION)
    strength = math.sqrt(status.recent_noise * step / status.interval**5)
    for f in range(layout.MODELS - 1, -1, -1):
        if status.active[f] > 0.0:
            time_update(status, strength, step, layout.FIRST[f], layout.STOP[f])
            was_observed = model_bank.is_observed(status, f)
            status.travelled[f] = max(status.travelled[f], abs(status.angle - status.start_angle[f]))
            if model_bank.is_observed(status, f) and not was_observed:
                update_second_order(status, f)  # needed by the first likelihood that counts
            # The ripple is evaluated at the reading until the model is observed, then at the predicted angle.
            predict_reading(status, f, step, reading, expected if model_bank.is_observed(status, f) else reading, noise)
            density += status.mode_probability[f] * status.density[f]
    outlying = (density < OUTLIER_DENSITY or outlier_gate.is_alike(status, innovation)) and status.since > 5.0
    if copied:
        row.noise = 0.0
        status.repeats += 1.0
    elif not outlying or outlier_gate.accept_manoeuvre(record, reading, innovation, step, row):
        _update(status, innovation, reading, repeated, noise, row)


@compiled_in_place
def _update(status: Record, innovation: float, reading: float, repeated: float, noise: float, row: Record) -> None:
    """Update filters and model probabilities with an accepted measurement, and adapt the measurement noise."""
    status.used += 1.0
    was_outlier = status.rejected_run > 0.0 and row.cut == 0.0 and not outlier_gate.is_growing(status, innovation)
    if was_outlier:
        outlier_gate.learn_abruptness(status, False)
    status.clean = 0.0 if was_outlier else status.clean + 1.0
    settles = status.since - status.rejected_run <= measurement_noise.SETTLING <= status.since
    status.rejected_run = status.innovation_before = status.last_innovation = 0.0
    span, noticed = measurement_noise.samples_between(status, repeated) * status.interval, 3.0 * math.sqrt(row.noise)
    turning = span * abs(status.speed) > noticed
    # A ripple model may take a start for ripple, so that the mixture stands still; the plain model shows the start.
    starting = span * abs(status.clock[layout.RATE, status.best[layout.PLAIN]]) > noticed
    model_bank.update_mode_probabilities(status, noise, turning or starting)
    if turning:
        average_orders(status, noise)
    share_before = status.repeat_share
    measurement_noise.learn_repetitions(status, reading, repeated)
    if share_before <= measurement_noise.REPEATING < status.repeat_share:
        model_bank.reset_adaptation(status)
    measurement_noise.adapt_additive_noise(status, reading)
    if settles and status.ripple_tried == 0.0:
        for f in range(1, layout.MODELS):  # prior covariances in units of the noise scale, which has converged now
            reset_ripple_covariance(status, f, 0)
    if status.used % ADAPT_EVERY == 0.0 and turning and status.since > ADAPT_EVERY / 2.0:
        measurement_noise.adapt_jitter(status, noise)


@compiled_in_place
def _report_state(status: Record, row: Record) -> None:
    """Write the mixture's state and covariance, its convergence, and the smoothers' data into a row."""
    model_bank.combine(status, row)
    sigma = math.sqrt(max(row.covariance[4], 0.0))
    status.speed_sigma, status.acceleration_sigma = sigma, math.sqrt(max(row.covariance[8], 0.0))
    measurement_noise.set_correlated(status)
    least = measurement_noise.standstill_speed(status)
    _detect_motion(status, sigma, least)
    if status.samples > 2.0:
        # Bounded by the highest speed so far: outliers imitate speeds at which any sigma would pass.
        speed = abs(status.speed) if status.fastest == 0.0 else min(abs(status.speed), status.fastest)
        limit = max(MAX_SPEED_SIGMA * max(speed, LEAST_SPEED * status.fastest), least)
        settled = sigma <= limit and status.unconfirmed == 0.0 and status.since >= measurement_noise.SETTLING
        row.settled = 1.0 if settled else 0.0
    set_systematic(status, row)
    add_systematic(row, 1.0)
    if row.noise > 0.0:
        status.unconfirmed = max(status.unconfirmed - 1.0, 0.0)
    row.angle, row.origin, row.leading = status.angle, status.origin, float(status.leading)
    put_angle(row, status.angle)
    for f in range(layout.MODELS):
        row.memory[f] = model_bank.memory_of(status, f)


@compiled_in_place
def _report_provisional(record: Records, row: Record) -> None:
    """Report the state with a provisional reading; smoothers treat it as rejected until the next one confirms it."""
    noise, row.noise = row.noise, 0.0
    _report_state(record[1], row)
    theta, row.noise = row.angle, noise
    _report_state(record[0], row)
    row.angle, row.noise, row.cut = theta, 0.0, 0.0


@compiled_in_place
def _detect_motion(status: Record, sigma: float, least: float) -> None:
    """Detect standstill, slower than `least` [rad/s], and reversals; `sigma` [rad/s] is the speed's deviation."""
    status.still = status.still + 1.0 if abs(status.speed) < least else 0.0
    if status.since < measurement_noise.SETTLING:
        status.motion = STARTING
    elif status.still > measurement_noise.SETTLING:
        status.standstills += status.motion != STANDSTILL
        status.motion = STANDSTILL
    elif status.still == 0.0 or status.motion != STANDSTILL:
        status.motion = RUNNING
    if abs(status.speed) > 10.0 * least + 3.0 * sigma:
        sense = 1.0 if status.speed > 0.0 else -1.0
        status.reversals += status.sense == -sense
        status.sense = sense


@compiled_in_place
def put_angle(row: Record, angle: float) -> None:
    """Write an angle [rad], relative to the row's origin, as whole turns and phase."""
    turns = np.floor(angle / TURN + 0.5)
    row.phase = angle - turns * TURN
    row.turns = row.origin + turns
