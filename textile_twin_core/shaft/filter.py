"""The recursion behind every view: one reading after the other is foreseen, gated, weighed and taken in."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.compiling import compiled
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.bank import density, expect_angle, predict
from textile_twin_core.shaft.breaks import (
    begin_motion,
    bridge_gap,
    goes_on,
    is_false_start,
    is_foretold,
    is_motion,
    lose,
)
from textile_twin_core.shaft.families import has_seen, is_at_work, memory_for, weigh
from textile_twin_core.shaft.gate import Block, admit
from textile_twin_core.shaft.lacked_orders import add_lacked, listen
from textile_twin_core.shaft.mixture import mix
from textile_twin_core.shaft.readings import (
    SETTLING,
    guess_rounding,
    hardly,
    is_held,
    learn_hold,
    learn_unrest,
    noise_of,
    recalibrate,
    set_alike,
    unwrapped,
)
from textile_twin_core.shaft.status import RUNNING, STANDSTILL, STARTING, Record, Records
from textile_twin_core.shaft.turns import TURN, TURN_TAIL, split_turn

OUTLYING = 0.02
"""Density [1/rad] of outliers, as `bank.density` counts it: with the 0.38 that it leaves out, of one reading in 130
anywhere within a radian. What the filters give less is set aside."""
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
RECALIBRATE_EVERY = 32.0
"""Samples between two lessons about the noise."""
PERIOD_SAMPLES = 500.0
"""Readings that the sampling interval is learnt from."""


@compiled
def follow(record: Records, block: Block, table: Records) -> int:
    """Take a block of samples. Writes a row of `table` for each accepted one and returns their number."""
    count = 0
    for i in range(block.stamps.size):
        if take(record[0], block, i, table[count]):
            count += 1
    return count


@compiled
def take(status: Record, block: Block, i: int, row: Record) -> bool:
    """Take sample `i` of a block; whether it was accepted, and its row filled."""
    stamp, angle = block.stamps[i], block.angles[i]
    block.heard[i] = math.nan
    if not admit(status, block.last, stamp, angle):
        return False
    status.sensor_speed = block.velocities[i] if block.velocities.size > 0 else math.nan
    _take(status, (stamp - block.last[0]) * status.unit, angle, row)
    block.last[0] = stamp
    if status.samples > 1.0:
        _tell(status, row)
    # Set aside it tells of the encoder, too, if it is off by a move: readings in step with the sampling skip one.
    if row.noise > 0.0 or abs(row.reading - status.angle) <= MOVES_OFF * abs(status.speed) * status.interval:
        block.heard[i] = row.reading
    return True


@compiled
def _take(status: Record, step: float, angle: float, row: Record) -> None:
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
    row.step, row.time, row.alike = step, status.time, status.alike
    if status.samples == 2.0:
        begin_motion(status, step, unwrapped(status, raw, status.first))
        row.reading, row.cut = status.angle, 1.0
        row.noise = row.unit = noise_of(status, status.speed)
    else:
        _take_angle(status, step, raw, row)


@compiled
def _tell(status: Record, row: Record) -> None:
    """The state, and what smoothing needs of it."""
    mix(status, row)
    sigma = math.sqrt(max(row.covariance[4], 0.0))
    status.speed_sigma, status.acceleration_sigma = sigma, math.sqrt(max(row.covariance[8], 0.0))
    set_alike(status)
    _watch(status, sigma)
    if status.samples > 2.0:
        # A speed above all that were seen tells little of how sure one must be: outliers give such.
        speed = abs(status.speed) if status.fastest == 0.0 else min(abs(status.speed), status.fastest)
        sure = sigma <= max(UNSURE * max(speed, SLOW * status.fastest), hardly(status))
        row.settled = 1.0 if sure and status.doubt == 0.0 and status.since >= SETTLING else 0.0
    add_lacked(status, row)
    if row.noise > 0.0:
        status.doubt = max(status.doubt - 1.0, 0.0)
    row.theta, row.origin, row.lead = status.angle, status.origin, float(status.lead)
    put_angle(row, status.angle)
    for f in range(lanes.FAMILIES):
        row.memory[f] = memory_for(status, f)


@compiled
def put_angle(row: Record, angle: float) -> None:
    """Write an angle [rad beyond the row's origin] as whole turns and phase."""
    turns = np.floor(angle / TURN + 0.5)
    row.phase = angle - turns * TURN - turns * TURN_TAIL
    row.turns = row.origin + turns


@compiled
def _take_angle(status: Record, step: float, raw: float, row: Record) -> None:
    """One reading from the third on."""
    status.since += 1.0
    gain = max(1.0 / status.samples, 1.0 / PERIOD_SAMPLES)
    late = step > GAP_SAMPLES * status.interval
    if not late or status.since < GAP_SAMPLES:
        status.interval += (min(step, GAP_SAMPLES * status.interval) - status.interval) * gain
    expected = status.angle + step * (status.speed + 0.5 * step * status.acceleration)
    if late and status.since > 1.0:
        status.gaps += 1.0
        expected = unwrapped(status, raw, expected)
        if status.since < SETTLING or not is_foretold(status, step, expected):
            bridge_gap(status, step, raw, row)
            return
        late = False
    longest = max(step, status.interval) if status.since < SETTLING else status.interval
    if late or (status.period > 0.0 and 2.0 * abs(status.speed) * longest > status.period):
        # Where a gap follows another the interval was none. And an angle that wraps tells no such speed: its readings
        # would fit this one and any that is whole periods faster.
        reading = unwrapped(status, raw, status.read)
        lose(status, reading, (reading - status.read) / step, step, row)
        return
    reading = unwrapped(status, raw, expected)
    if is_false_start(status, reading, reading - expected, step):
        status.unrest = status.sense = 0.0
        lose(status, reading, (reading - status.read) / step, step, row)
        return
    guess_rounding(status, abs(reading - status.read))
    if abs(reading - status.read - status.speed * step) > APART * status.rounding:
        status.alike = 1.0
    repeated, held = status.holding, is_held(status, reading)
    status.read, noise = reading, noise_of(status, status.speed)
    off = reading - expected
    status.angle = expected
    row.reading, row.unit = reading, noise
    row.noise = status.scale[status.best[status.lead]] * noise
    foretold, turned = 0.0, abs(status.speed) * step
    for back in range(lanes.FAMILIES):
        f = lanes.FAMILIES - 1 - back
        if is_at_work(status, f, turned):
            predict(status, f, step, noise, status.interval)
            status.travelled[f] += turned
            # While the ripple is not known, no filter says where it should be taken better than the reading does.
            expect_angle(status, f, step, reading, expected if has_seen(status, f) else reading, noise)
            foretold += status.weight[f] * density(status, f)
    if held:
        row.noise = 0.0
        status.repeats += 1.0
        return
    if foretold < OUTLYING and status.since > 5.0:
        if not is_motion(status, off, step, row.noise, row):
            row.noise = 0.0
            status.aside += 1.0
            status.doubt += 1.0
            status.outliers += 1.0
            if status.doubt > LOST:
                lose(status, reading, 0.0 if status.holding > 0.0 else status.speed, step, row)
            return
        for f in range(lanes.FAMILIES):
            expect_angle(status, f, 0.0, reading, reading, noise)
    status.clean += 1.0
    if status.aside > 0.0 and row.cut == 0.0:
        gone_on = goes_on(status, off)
        status.motions = status.motions + 1.0 if gone_on else 0.0
        status.clean = status.clean if gone_on else 0.0
    status.aside = status.off_before = status.off_last = 0.0
    turning = abs(status.speed) * status.interval > 3.0 * math.sqrt(row.noise)
    weigh(status, noise, turning)
    if turning:
        listen(status, noise)
    learn_hold(status, reading, repeated)
    learn_unrest(status, reading)
    if status.samples % RECALIBRATE_EVERY == 0.0 and turning and status.since > RECALIBRATE_EVERY / 2.0:
        recalibrate(status, noise)


@compiled
def _watch(status: Record, sigma: float) -> None:
    """Standstill and reversals."""
    least = hardly(status)
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
