"""The recursion of all views: for each sample predict, gate, update filters and mode probabilities, adapt the noise."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import by_reference, compiled_in_place
from textile_twin_core.shaft import families, gating, lanes, measurement_noise
from textile_twin_core.shaft.bank import doubt_ripple, predict_reading, update_second_order
from textile_twin_core.shaft.kalman import time_update
from textile_twin_core.shaft.residual_orders import add_systematic, listen_for_orders, set_systematic
from textile_twin_core.shaft.status import MANOEUVRE, RUNNING, STANDSTILL, STARTING, Record, Records, Stamps
from textile_twin_core.shaft.turns import TURN, split_turn

LARGEST = 1e12  # angle [rad] and stamp [s]: larger ones tell no motion, and squared often enough they overflow
# [1/rad], the gate: density of outliers without the constant 0.38 of Student's t, one sample in 130 within a radian
OUTLIER_DENSITY = 0.02
GAP_SAMPLES = 50.0  # intervals without a sample that make a gap
FAR_ROUND = 2.0  # periods from the encoder's 0 from which a first reading is not wrapped
MAX_SPREAD = 1.0 / 6.0  # deviation of a predicted angle, in periods, from which the turn of a wrapped one is not known
MAX_SPEED_SIGMA, LEAST_SPEED = 0.25, 0.3  # a settled state's, relative to the speed; that at least, part of full speed
ROUNDED_APART = 1.3  # encoder steps beyond the predicted move from which two rounding errors are uncorrelated
MAX_HEARD = 1.5  # moves per interval, innovation up to which a rejected measurement still tells the encoder's step
BUNCHED = 0.1  # of the mean interval: readings nearer to each other in time came late, together, and tell nothing
USUAL_STEP = 1.5  # intervals up to which no sample was lost between two
MOST_GAIN = 0.2  # of a single move in their mean, however few make a turn
FORGET_NOISE = 0.9  # decay, per sample, of the noise that the process noise is relative to
ADAPT_EVERY = 32.0  # samples between two adaptations of the jitter
INTERVAL_SAMPLES, INTERVAL_EDGES = 500.0, 60.0  # memory of the mean interval; that of edges goes with the speed


@by_reference
class Block(NamedTuple):
    """A block of n input samples."""

    last: Stamps  # (1,) the newest stamp accepted
    stamps: Stamps  # (n,)
    angles: FloatArray  # (n,) [rad]
    velocities: FloatArray  # (n,) [rad/s], NaN for none, or empty
    heard: FloatArray  # (n,) set: unwrapped readings that tell of the encoder's resolution, else NaN


@compiled_in_place
def run_filter(record: Records, block: Block, table: Records) -> int:
    """Filter a block of samples; fills a row of `table` for each accepted one and returns their number.

    `record` (2,) is the status, and while its latest reading is in doubt what it would be without it.
    """
    count = 0
    for i in range(block.stamps.size):
        count += process_sample(record, block, i, table[count])
    return count


@compiled_in_place
def process_sample(record: Records, block: Block, i: int, row: Record) -> bool:
    """Filter sample `i` of a block; whether it was accepted and its row filled."""
    status, stamp, angle = record[0], block.stamps[i], block.angles[i]
    block.heard[i] = math.nan
    if not _admit(status, block.last, stamp, angle):
        return False
    step, confirmed = (stamp - block.last[0]) * status.unit, False
    turns, phase = split_turn(angle)
    raw = phase + (turns - status.origin) * TURN
    if status.doubtful > 0.0:
        confirmed = gating.reconsider(record, raw, step, step > GAP_SAMPLES * status.interval)
    block.last[0] = stamp
    status.sensor_speed = block.velocities[i] if block.velocities.size > 0 else math.nan
    status.samples += 1.0
    row.index, row.settled = status.received - 1.0, -1.0
    row.noise, row.cut, row.intensity, row.residual = 0.0, 0.0, 0.0, 0.0
    if status.samples == 1.0:
        status.origin, status.time = turns, 0.0
        status.angle = status.low = status.high = phase
        row.reading, row.angle, row.origin = phase, phase, turns
        if status.auto > 0.0 and abs(angle - status.encoder_zero) > FAR_ROUND * status.period:
            status.period = 0.0
        put_angle(row, phase)
    else:
        status.time += step
        status.longest = max(status.longest, step)
        row.step, row.time, row.correlated = step, status.time, status.correlated
        if status.samples == 2.0:
            reading = measurement_noise.unwrap_reading(status, raw, status.angle)
            gating.initiate(status, step, reading, (reading - status.angle) / step, row)
        else:
            _process_reading(record, step, raw, row)
        if status.doubtful > 0.0:
            _report_in_doubt(record, row)
        else:
            _report_state(status, row)
        row.interval = status.interval
        if confirmed and row.cut == 0.0 and row.noise > 0.0:
            row.cut = MANOEUVRE
    # Sampling in step with the encoder may skip one of its steps: rejected measurements within a move count here, too.
    if row.noise > 0.0 or abs(row.reading - status.angle) <= MAX_HEARD * abs(status.speed) * status.interval:
        block.heard[i] = row.reading
    return True


@compiled_in_place
def _admit(status: Record, last: Stamps, stamp: float, angle: float) -> bool:
    """Whether to accept a sample: angle and stamp finite, the stamp newer than `last` (1,); counts the cause if not."""
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
    """One measurement from the third on, `raw` [rad] before unwrapping, `step` [s] after the one before."""
    status = record[0]
    status.bunched = status.bunched + 1.0 if step < BUNCHED * status.interval else 0.0
    # More of them come more often now: the interval before was a pause. An edge is timed as it passes.
    most = 1.0 if status.edges > 0.0 else measurement_noise.SETTLING
    bunched, quicker = 0.0 < status.bunched <= most, status.bunched > most
    if not bunched:
        status.since += 1.0
        status.since_slip += 1.0
    spread = step * (status.speed_sigma + 0.5 * step * status.acceleration_sigma)
    turn_unknown = step > 2.0 * status.interval and spread > MAX_SPREAD * status.period > 0.0
    gap = turn_unknown or step > GAP_SAMPLES * status.interval
    if not gap or status.since < GAP_SAMPLES:
        gain = 1.0 / min(status.samples, INTERVAL_EDGES if status.edges > 0.0 else INTERVAL_SAMPLES)
        status.interval += (min(step, GAP_SAMPLES * status.interval) - status.interval) * gain
    expected = gating.foretold(status, step)
    if gap and status.since > 1.0:
        status.gaps += 1.0
        expected = measurement_noise.unwrap_reading(status, raw, expected)
        if status.since < measurement_noise.SETTLING or not gating.is_predicted(status, step, expected):
            gating.bridge_gap(status, step, raw, row)
            return
    longest = max(step, status.interval) if status.since < measurement_noise.SETTLING else status.interval
    if status.held > measurement_noise.OFTEN_HELD:
        longest *= 1.0 + status.longest_hold
    aliased = status.period > 0.0 and 2.0 * abs(status.speed) * longest > status.period
    # A wrapped angle leaves speeds above half a period per interval open; and a gap after a gap was none.
    begins = (aliased and not bunched) or (gap and status.since <= 1.0)
    reading = measurement_noise.unwrap_reading(status, raw, status.read if begins else expected)
    off, rate = reading - expected, math.nan
    if begins and (reading != status.read or status.held <= measurement_noise.OFTEN_HELD):
        rate = (reading - status.read) / (step * (1.0 + status.holding))
    elif gating.is_false_start(status, reading, off, step):
        status.additive, status.sense, rate = 0.0, 0.0, (reading - status.read) / step
    elif not bunched and gating.is_runaway(status, reading - status.read, step):
        status.fastest, rate = 0.0, math.copysign(status.travel, status.leapt) / status.interval
    elif quicker:
        rate = (reading - status.read) / step
    if not math.isnan(rate):
        status.losses += not quicker
        gating.initiate(status, step, reading, rate, row)
        return
    if status.guessed > 0.0:
        measurement_noise.guess_resolution(status, reading - status.read)
    if max(abs(reading - status.read - status.speed * step), abs(off)) > ROUNDED_APART * status.resolution:
        status.correlated = row.correlated = 1.0
    repeated = status.holding
    held = bunched or measurement_noise.is_repetition(status, reading)
    status.angle, row.reading = expected, reading
    if status.bunched == 0.0 or status.bunched == most:
        status.read = reading
    row.unit = noise = measurement_noise.measurement_variance(status)
    row.noise = status.scale[status.best[status.leading]] * noise
    density, turned = 0.0, abs(status.speed) * step
    if not held and step < USUAL_STEP * status.interval:
        moved = measurement_noise.samples_between(status, repeated) * turned
        status.move += (moved - status.move) * min(moved / TURN, MOST_GAIN)  # the mean of a turn
    for f in range(1, lanes.FAMILIES):
        families.begin_or_rest(status, f, turned)
    # Of memory N: q = r / (N^6 T^5) (Kalata 1984). At a stop late stamps are no noise, but it is motion.
    status.noise_of_late = max(noise, FORGET_NOISE * status.noise_of_late, measurement_noise.FINEST_MOTION)
    strength = math.sqrt(status.noise_of_late * step / status.interval**5)
    for f in range(lanes.FAMILIES - 1, -1, -1):
        if status.active[f] > 0.0:
            time_update(status, strength, step, lanes.FIRST[f], lanes.STOP[f])
            seen = families.is_observed(status, f)
            status.travelled[f] = max(status.travelled[f], abs(status.angle - status.began_at[f]))
            if families.is_observed(status, f) and not seen:
                update_second_order(status, f)  # which the first likelihood that counts must have
            # Until the ripple is observed, its angle is better known from the measurement than from the prediction.
            predict_reading(status, f, step, reading, expected if families.is_observed(status, f) else reading, noise)
            density += status.mode_probability[f] * status.density[f]
    outlying = (density < OUTLIER_DENSITY or gating.is_alike(status, off)) and status.since > 5.0
    if held:
        row.noise = 0.0
        status.repeats += 1.0
    elif not outlying or gating.accept_manoeuvre(record, reading, off, step, row):
        _update(status, off, reading, repeated, noise, row)


@compiled_in_place
def _update(status: Record, off: float, reading: float, repeated: float, noise: float, row: Record) -> None:
    """Update filters and mode probabilities with an accepted measurement, and adapt the measurement noise."""
    status.used += 1.0
    was_outlier = status.rejected_run > 0.0 and row.cut == 0.0 and not gating.is_growing(status, off)
    if was_outlier:
        gating.learn_abruptness(status, False)
    status.clean = 0.0 if was_outlier else status.clean + 1.0
    settles = status.since - status.rejected_run <= measurement_noise.SETTLING <= status.since
    status.rejected_run = status.off_before = status.off_last = 0.0
    span, noticed = measurement_noise.samples_between(status, repeated) * status.interval, 3.0 * math.sqrt(row.noise)
    turning = span * abs(status.speed) > noticed
    # A ripple that takes a start for its own keeps the estimate at rest, but not the plain family's.
    starting = span * abs(status.clock[lanes.RATE, status.best[lanes.PLAIN]]) > noticed
    families.update_mode_probabilities(status, noise, turning or starting)
    if turning:
        listen_for_orders(status, noise)
    held = status.held
    measurement_noise.learn_repetitions(status, reading, repeated)
    if held <= measurement_noise.OFTEN_HELD < status.held:
        families.forget_lessons(status)
    measurement_noise.adapt_additive_noise(status, reading)
    if settles and status.ripple_tried == 0.0:
        for f in range(1, lanes.FAMILIES):  # while the noise scale was found, their prior covariance went with it
            doubt_ripple(status, f, 0)
    if status.used % ADAPT_EVERY == 0.0 and turning and status.since > ADAPT_EVERY / 2.0:
        measurement_noise.adapt_jitter(status, noise)


@compiled_in_place
def _report_state(status: Record, row: Record) -> None:
    """The mixture's state and covariance, whether it is settled, and what the smoothers need, into a row."""
    families.combine(status, row)
    sigma = math.sqrt(max(row.covariance[4], 0.0))
    status.speed_sigma, status.acceleration_sigma = sigma, math.sqrt(max(row.covariance[8], 0.0))
    measurement_noise.set_correlated(status)
    least = measurement_noise.standstill_speed(status)
    _detect_motion(status, sigma, least)
    if status.samples > 2.0:
        # Bounded by the highest speed seen: outliers feign speeds that would excuse any sigma.
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
    for f in range(lanes.FAMILIES):
        row.memory[f] = families.memory_of(status, f)


@compiled_in_place
def _report_in_doubt(record: Records, row: Record) -> None:
    """The state with a reading that is in doubt; the smoothers take it for set aside until the next confirms it."""
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
