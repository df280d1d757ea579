"""The recursion behind every view: one reading after the other is foreseen, gated, weighed and taken in."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.compiling import compiled
from textile_twin_core.shaft.bank import (
    RIPPLE_SIZE,
    begin,
    expect_angle,
    nearest,
    open_motion,
    predict,
    take_angle,
    take_speed,
)
from textile_twin_core.shaft.families import can_tell, has_seen, is_at_work, weigh
from textile_twin_core.shaft.gate import admit
from textile_twin_core.shaft.mixture import mix
from textile_twin_core.shaft.readings import FINEST_RAD2, FIRST_JITTER, noise_in_step, noise_of, recalibrate, unwrapped
from textile_twin_core.shaft.status import (
    COVARIANCE,
    CUT,
    FAMILIES,
    INDEX,
    LEAD,
    MEMORY,
    NOISE,
    ORIGIN,
    PHASE,
    READING,
    RUNNING,
    SETTLED,
    STANDSTILL,
    STARTING,
    STEP,
    THETA,
    TIME,
    TURNS,
    UNIT,
    Record,
    StatusArray,
)
from textile_twin_core.shaft.turns import TURN, TURN_TAIL, split_turn

GATE = 49.0
"""Normalised innovation squared (7 sigma) from which a reading is set aside."""
LIKELY = 0.03
"""Weight of a filter that is asked about a reading's place."""
SET_ASIDE = 2
"""Readings in a row that may be set aside as outliers before the motion is believed to have changed."""
LOST = 9
"""Readings in a row that follow no motion before everything begins anew."""
GAP_SAMPLES = 50.0
"""A pause of so many intervals is a gap: the motion is found anew."""
SETTLING = 25.0
"""Samples until a state is called settled, and at rest until it is called standstill."""
RECALIBRATE_EVERY = 32.0
"""Samples between two lessons about the noise."""
PERIOD_SAMPLES, SPEED_SAMPLES = 500.0, 100.0
"""Readings that the sampling interval, and the noise of a sensor's own speed, are learnt from."""


@compiled
def follow(
    record: StatusArray,
    last: FloatArray | IntArray,
    stamps: FloatArray | IntArray,
    angles: FloatArray,
    velocities: FloatArray,
    heard: FloatArray,
    table: FloatArray,
) -> int:
    """Take samples: stamps (n,) [ns] or [s], angles [rad], velocities [rad/s], NaN for none, or an empty array.

    Writes a row of `table` (n, WIDTH) for each accepted sample and returns their number. `last` (1,) is the newest
    stamp; `heard` (n,) becomes each sample's unwrapped reading, NaN where it was not used.
    """
    count = 0
    for i in range(stamps.size):
        heard[i] = math.nan
        if admit(record, last, stamps[i], angles[i]):
            velocity = velocities[i] if velocities.size > 0 else math.nan
            take(record, (stamps[i] - last[0]) * record[0].unit, angles[i], velocity, table[count])
            last[0] = stamps[i]
            if table[count, NOISE] > 0.0:
                heard[i] = table[count, READING]
            count += 1
    return count


@compiled
def take(record: StatusArray, step: float, angle: float, velocity: float, row: FloatArray) -> None:
    """One accepted sample, `step` [s] after the one before; fills its row of the table."""
    status = record[0]
    turns, phase = split_turn(angle)
    status.samples += 1.0
    for k in range(row.size):
        row[k] = 0.0
    row[INDEX] = status.received - 1.0
    if status.samples == 1.0:
        status.origin, status.time = turns, 0.0
        status.first = status.angle = status.low = status.high = phase
        row[READING], row[THETA], row[ORIGIN] = phase, phase, turns
        row[SETTLED] = -1.0
        return
    raw = phase + (turns - status.origin) * TURN
    status.time += step
    status.longest = max(status.longest, step)
    row[STEP], row[TIME] = step, status.time
    if status.samples == 2.0:
        _begin_motion(status, step, unwrapped(status, raw, status.first))
        row[READING], row[CUT] = status.angle, 1.0
        row[NOISE] = row[UNIT] = noise_of(status, status.speed)
    else:
        _take_angle(status, step, raw, row)
    if not math.isnan(velocity):
        _take_velocity(status, velocity)
    mix(status, row)
    if abs(status.speed) * status.interval < status.rounding:
        row[COVARIANCE] += status.rounding**2 / 12.0
    _watch(status, math.sqrt(max(row[COVARIANCE + 4], 0.0)))
    row[SETTLED] = -1.0 if status.samples == 2.0 else 1.0 if status.since >= SETTLING else 0.0
    row[THETA], row[ORIGIN], row[LEAD] = status.angle, status.origin, float(status.lead)
    put_angle(row, status.angle)
    for f in range(FAMILIES):
        row[MEMORY + f] = status.log_memory[f]


@compiled
def put_angle(row: FloatArray, angle: float) -> None:
    """Write an angle [rad beyond the row's origin] as whole turns and phase."""
    turns = np.floor(angle / TURN + 0.5)
    row[PHASE] = angle - turns * TURN - turns * TURN_TAIL
    row[TURNS] = row[ORIGIN] + turns


@compiled
def set_uncertainty(kinematic: FloatArray, rate: float, noise: float, step: float) -> None:
    """Factor l00 .. l22 (6,) after two readings: their noise, and a tenth more speed in a step."""
    root = math.sqrt(noise)
    kinematic[0] = 0.1 * abs(rate) / step + root / step**2
    kinematic[1] = kinematic[2] = 0.0
    kinematic[3] = 1.5 * root / step
    kinematic[4] = kinematic[5] = 0.7 * root


@compiled
def _begin_motion(status: Record, step: float, angle: float) -> None:
    """Begin with two readings: what a straight line through them leaves open is the filters' uncertainty."""
    rate = (angle - status.first) / step
    status.interval = step
    if status.jitter_told == 0.0:
        status.jitter = (FIRST_JITTER * step) ** 2
    status.angle, status.speed, status.acceleration = angle, rate, 0.0
    set_uncertainty(status.kinematic, rate, noise_of(status, rate), step)
    for f in range(FAMILIES):
        begin(status, f, angle, rate, 0.0, status.kinematic, 1.0)
        status.active[f] = 1.0 if can_tell(status, f, 1.0) else 0.0
        status.weight[f] = status.travelled[f] = status.rest[f] = 0.0
    status.weight[0] = 1.0
    status.lead = 0
    status.since = status.aside = status.off_before = status.off_last = status.judged = 0.0


@compiled
def _take_angle(status: Record, step: float, raw: float, row: FloatArray) -> None:
    """One reading from the third on."""
    status.since += 1.0
    if step > GAP_SAMPLES * status.interval:
        _bridge_gap(status, step, raw, row)
        return
    gain = max(1.0 / status.samples, 1.0 / PERIOD_SAMPLES)
    status.interval += (min(step, 3.0 * status.interval) - status.interval) * gain
    expected = status.angle + step * (status.speed + 0.5 * step * status.acceleration)
    reading = unwrapped(status, raw, expected)
    moved, status.read = abs(reading - status.read), reading
    noise = noise_of(status, status.speed) if 2.0 * moved < status.rounding else noise_in_step(status, 1.0)
    off = reading - expected
    status.angle = expected
    row[READING], row[UNIT] = reading, noise
    row[NOISE] = status.scale[status.best[status.lead]] * noise
    least, turned = math.inf, abs(status.speed) * step
    for back in range(FAMILIES):
        f = FAMILIES - 1 - back
        if is_at_work(status, f, turned):
            predict(status, f, step, noise, status.interval)
            status.travelled[f] += turned
            # While the ripple is not known, no filter says where it should be taken better than the reading does.
            expect_angle(status, f, step, reading, expected if has_seen(status, f) else reading, noise)
            if status.weight[f] > LIKELY:
                least = min(least, nearest(status, f, noise, LIKELY / status.weight[f]))
    if least > GATE and status.since > 5.0:
        if not _is_motion(status, off, step, row[NOISE], row):
            row[NOISE] = 0.0
            status.aside += 1.0
            status.outliers += 1.0
            if status.aside > LOST:
                _lose(status, reading, step, row)
            return
        for f in range(FAMILIES):
            expect_angle(status, f, 0.0, reading, reading, noise)
    status.aside = status.off_before = status.off_last = 0.0
    weigh(status, noise)
    turning = abs(status.speed) * status.interval > 3.0 * math.sqrt(noise)
    if status.samples % RECALIBRATE_EVERY == 0.0 and turning and status.since > RECALIBRATE_EVERY / 2.0:
        recalibrate(status, noise)


@compiled
def _is_motion(status: Record, off: float, step: float, noise: float, row: FloatArray) -> bool:
    """Whether readings far off are the shaft's motion and not outliers: the third of three that follow a line.

    Then the motion is opened: where they are equally far off (an encoder that slipped) the angle alone, else speed and
    acceleration too.
    """
    bend = off - 2.0 * status.off_last + status.off_before
    if status.aside < SET_ASIDE or abs(bend) > 0.5 * max(abs(off), abs(status.off_before)):
        status.off_before, status.off_last, status.step_last = status.off_last, off, step
        return False
    span, grown = step + status.step_last, off - status.off_before
    slipped = abs(grown) < 0.25 * abs(off)
    rate = 0.0 if slipped else grown / span
    by_rate = 0.0 if slipped else (math.sqrt(noise) + abs(grown)) / span
    for f in range(FAMILIES):
        open_motion(status, f, off, rate, math.sqrt(noise) + RIPPLE_SIZE * abs(off), by_rate, abs(rate) / span)
    row[CUT] = 1.0 if slipped else 2.0
    status.jumps += row[CUT] == 1.0
    status.outliers -= status.aside
    return True


@compiled
def _bridge_gap(status: Record, step: float, raw: float, row: FloatArray) -> None:
    """After a pause the ripple is still known, the motion is not."""
    status.gaps += 1.0
    reading = unwrapped(status, raw, status.angle + status.speed * step)
    row[UNIT] = noise_of(status, status.speed)
    row[READING], row[CUT], row[NOISE] = reading, 1.0, row[UNIT] * status.scale[status.best[status.lead]]
    root = math.sqrt(row[NOISE])
    by_rate = 0.5 * abs(status.speed) + root / status.interval
    for f in range(FAMILIES):
        open_motion(status, f, reading - status.angle, 0.0, RIPPLE_SIZE, by_rate, by_rate / (10.0 * status.interval))
        if status.active[f] > 0.0:
            expect_angle(status, f, 0.0, reading, reading, row[UNIT])
            take_angle(status, f, row[UNIT], 0.0)
    status.angle = reading
    status.since = 0.0


@compiled
def _lose(status: Record, reading: float, step: float, row: FloatArray) -> None:
    """Readings that follow no motion: begin anew."""
    status.losses += 1.0
    status.first = reading - status.speed * step
    _begin_motion(status, step, reading)
    row[CUT] = 1.0
    row[NOISE] = row[UNIT] = noise_of(status, status.speed)


@compiled
def _take_velocity(status: Record, velocity: float) -> None:
    """The sensor's own speed as a further reading, of a noise that is learnt."""
    off = velocity - status.speed
    if status.speed_noise == 0.0:
        status.speed_noise = max(off * off, (0.02 * status.speed) ** 2) + FINEST_RAD2
    status.speed_noise += (off * off - status.speed_noise) / SPEED_SAMPLES
    for f in range(FAMILIES):
        if status.active[f] > 0.0:
            take_speed(status, f, velocity, status.angle, status.speed_noise)


@compiled
def _watch(status: Record, sigma: float) -> None:
    """Standstill and reversals: the shaft moves when it leaves its reading's noise within some samples."""
    hardly = max(status.rounding, 3.0 * math.sqrt(noise_of(status, status.speed))) / (SETTLING * status.interval)
    status.still = status.still + 1.0 if abs(status.speed) < hardly else 0.0
    if status.since < SETTLING:
        status.motion = STARTING
    elif status.still > SETTLING:
        status.standstills += status.motion != STANDSTILL
        status.motion = STANDSTILL
    elif status.still == 0.0 or status.motion != STANDSTILL:
        status.motion = RUNNING
    if abs(status.speed) > 10.0 * hardly + 3.0 * sigma:
        sense = 1.0 if status.speed > 0.0 else -1.0
        status.reversals += status.sense == -sense
        status.sense = sense
