"""The recursion behind every view: one reading after the other is foreseen, gated, weighed and taken in."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.compiling import compiled
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.bank import predict, predict_reading, predictive_density
from textile_twin_core.shaft.families import is_active, is_observed, memory_of, update_mode_probabilities
from textile_twin_core.shaft.gating import (
    bridge_gap,
    is_continued,
    is_false_start,
    is_manoeuvre,
    is_predicted,
    restart,
    start,
)
from textile_twin_core.shaft.measurement_noise import (
    SETTLING,
    adapt_additive_noise,
    adapt_jitter,
    guess_resolution,
    is_repetition,
    learn_repetitions,
    measurement_variance,
    set_correlated,
    standstill_speed,
    unwrap_reading,
)
from textile_twin_core.shaft.mixture import combine
from textile_twin_core.shaft.samples import Block, admit
from textile_twin_core.shaft.status import RUNNING, STANDSTILL, STARTING, Record, Records
from textile_twin_core.shaft.turns import TURN, TURN_TAIL, split_turn
from textile_twin_core.shaft.unmodelled_orders import add_unmodelled, listen_for_orders

OUTLYING = 0.02
"""Density [1/rad] of outliers, as `bank.predictive_density` counts it: with the 0.38 that it leaves out, of one
reading in 130 anywhere within a radian. What the filters give less is set aside."""
LOST = 9
"""Readings set aside, more than fitted since, before everything begins anew."""
GAP_SAMPLES = 50.0
"""A pause of so many intervals is a gap: the motion is found anew where it was not foretold."""
UNSURE, SLOW = 0.25, 0.3
"""Standard deviation of the speed, in parts of it and of this part of full speed at least, above which a state is not
called settled: so it is for some samples where the motion changed at once.
"""
APART = 1.5
"""Steps of the encoder beyond the foretold move from which a reading is not rounded as the last one was."""
MOVES_OFF = 1.5
"""Moves from a reading to the next, off by which one set aside is heard where the encoder's step is looked for."""
ADAPT_EVERY = 32.0
"""Samples between two lessons about the noise."""
PERIOD_SAMPLES = 500.0
"""Readings that the sampling interval is learnt from."""


@compiled
def run_filter(record: Records, block: Block, table: Records) -> int:
    """Take a block of samples. Writes a row of `table` for each accepted one and returns their number."""
    count = 0
    for i in range(block.stamps.size):
        if process_sample(record[0], block, i, table[count]):
            count += 1
    return count


@compiled
def process_sample(status: Record, block: Block, i: int, row: Record) -> bool:
    """Take sample `i` of a block; whether it was accepted, and its row filled."""
    stamp, angle = block.stamps[i], block.angles[i]
    block.heard[i] = math.nan
    if not admit(status, block.last, stamp, angle):
        return False
    status.sensor_speed = block.velocities[i] if block.velocities.size > 0 else math.nan
    _process(status, (stamp - block.last[0]) * status.unit, angle, row)
    block.last[0] = stamp
    if status.samples > 1.0:
        _report_state(status, row)
    # Set aside it tells of the encoder, too, if it is off by a move: readings in step with the sampling skip one.
    if row.noise > 0.0 or abs(row.reading - status.angle) <= MOVES_OFF * abs(status.speed) * status.interval:
        block.heard[i] = row.reading
    return True


@compiled
def _process(status: Record, step: float, angle: float, row: Record) -> None:
    """One accepted sample, `step` [s] after the one before."""
    turns, phase = split_turn(angle)
    status.samples += 1.0
    row.index, row.settled, row.noise, row.cut = status.received - 1.0, -1.0, 0.0, 0.0
    if status.samples == 1.0:
        status.origin, status.time = turns, 0.0
        status.first = status.angle = status.low = status.high = phase
        row.reading, row.theta, row.origin = phase, phase, turns
        return
    raw = phase + (turns - status.origin) * TURN
    status.time += step
    status.longest = max(status.longest, step)
    row.step, row.time, row.correlated = step, status.time, status.correlated
    if status.samples == 2.0:
        start(status, step, unwrap_reading(status, raw, status.first))
        row.reading, row.cut = status.angle, 1.0
        row.noise = row.unit = measurement_variance(status, status.speed)
    else:
        _process_reading(status, step, raw, row)


@compiled
def _report_state(status: Record, row: Record) -> None:
    """The state, and what smoothing needs of it."""
    combine(status, row)
    sigma = math.sqrt(max(row.covariance[4], 0.0))
    status.speed_sigma, status.acceleration_sigma = sigma, math.sqrt(max(row.covariance[8], 0.0))
    set_correlated(status)
    _watch_motion(status, sigma)
    if status.samples > 2.0:
        # A speed above all that were seen tells little of how sure one must be: outliers give such.
        speed = abs(status.speed) if status.fastest == 0.0 else min(abs(status.speed), status.fastest)
        sure = sigma <= max(UNSURE * max(speed, SLOW * status.fastest), standstill_speed(status))
        row.settled = 1.0 if sure and status.unconfirmed == 0.0 and status.since >= SETTLING else 0.0
    add_unmodelled(status, row)
    if row.noise > 0.0:
        status.unconfirmed = max(status.unconfirmed - 1.0, 0.0)
    row.theta, row.origin, row.leading = status.angle, status.origin, float(status.leading)
    put_angle(row, status.angle)
    for f in range(lanes.FAMILIES):
        row.memory[f] = memory_of(status, f)


@compiled
def put_angle(row: Record, angle: float) -> None:
    """Write an angle [rad beyond the row's origin] as whole turns and phase."""
    turns = np.floor(angle / TURN + 0.5)
    row.phase = angle - turns * TURN - turns * TURN_TAIL
    row.turns = row.origin + turns


@compiled
def _process_reading(status: Record, step: float, raw: float, row: Record) -> None:
    """One reading from the third on."""
    status.since += 1.0
    gain = max(1.0 / status.samples, 1.0 / PERIOD_SAMPLES)
    late = step > GAP_SAMPLES * status.interval
    if not late or status.since < GAP_SAMPLES:
        status.interval += (min(step, GAP_SAMPLES * status.interval) - status.interval) * gain
    expected = status.angle + step * (status.speed + 0.5 * step * status.acceleration)
    if late and status.since > 1.0:
        status.gaps += 1.0
        expected = unwrap_reading(status, raw, expected)
        if status.since < SETTLING or not is_predicted(status, step, expected):
            bridge_gap(status, step, raw, row)
            return
        late = False
    longest = max(step, status.interval) if status.since < SETTLING else status.interval
    if late or (status.period > 0.0 and 2.0 * abs(status.speed) * longest > status.period):
        # Where a gap follows another the interval was none. And an angle that wraps tells no such speed: its readings
        # would fit this one and any that is whole periods faster.
        reading = unwrap_reading(status, raw, status.read)
        restart(status, reading, (reading - status.read) / step, step, row)
        return
    reading = unwrap_reading(status, raw, expected)
    if is_false_start(status, reading, reading - expected, step):
        status.additive = status.sense = 0.0
        restart(status, reading, (reading - status.read) / step, step, row)
        return
    guess_resolution(status, abs(reading - status.read))
    if abs(reading - status.read - status.speed * step) > APART * status.resolution:
        status.correlated = 1.0
    repeated, held = status.holding, is_repetition(status, reading)
    status.read, noise = reading, measurement_variance(status, status.speed)
    off = reading - expected
    status.angle = expected
    row.reading, row.unit = reading, noise
    row.noise = status.scale[status.best[status.leading]] * noise
    foretold, turned = 0.0, abs(status.speed) * step
    for back in range(lanes.FAMILIES):
        f = lanes.FAMILIES - 1 - back
        if is_active(status, f, turned):
            predict(status, f, step, noise, status.interval)
            status.travelled[f] += turned
            # While the ripple is not known, no filter says where it should be taken better than the reading does.
            predict_reading(status, f, step, reading, expected if is_observed(status, f) else reading, noise)
            foretold += status.mode_probability[f] * predictive_density(status, f)
    if held:
        row.noise = 0.0
        status.repeats += 1.0
        return
    if foretold < OUTLYING and status.since > 5.0:
        if not is_manoeuvre(status, off, step, row.noise, row):
            row.noise = 0.0
            status.rejected_run += 1.0
            status.unconfirmed += 1.0
            status.outliers += 1.0
            if status.unconfirmed > LOST:
                restart(status, reading, 0.0 if status.holding > 0.0 else status.speed, step, row)
            return
        for f in range(lanes.FAMILIES):
            predict_reading(status, f, 0.0, reading, reading, noise)
    status.clean += 1.0
    if status.rejected_run > 0.0 and row.cut == 0.0:
        gone_on = is_continued(status, off)
        status.motions = status.motions + 1.0 if gone_on else 0.0
        status.clean = status.clean if gone_on else 0.0
    status.rejected_run = status.off_before = status.off_last = 0.0
    turning = abs(status.speed) * status.interval > 3.0 * math.sqrt(row.noise)
    update_mode_probabilities(status, noise, turning)
    if turning:
        listen_for_orders(status, noise)
    learn_repetitions(status, reading, repeated)
    adapt_additive_noise(status, reading)
    if status.samples % ADAPT_EVERY == 0.0 and turning and status.since > ADAPT_EVERY / 2.0:
        adapt_jitter(status, noise)


@compiled
def _watch_motion(status: Record, sigma: float) -> None:
    """Standstill and reversals."""
    least = standstill_speed(status)
    status.still = status.still + 1.0 if abs(status.speed) < least else 0.0
    if status.since < SETTLING:
        status.motion = STARTING
    elif status.still > SETTLING:
        status.standstills += status.motion != STANDSTILL
        status.motion = STANDSTILL
    elif status.still == 0.0 or status.motion != STANDSTILL:
        status.motion = RUNNING
    if abs(status.speed) > 10.0 * least + 3.0 * sigma:
        sense = 1.0 if status.speed > 0.0 else -1.0
        status.reversals += status.sense == -sense
        status.sense = sense
