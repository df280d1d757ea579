"""The recursion behind every view: one reading after the other is foreseen, gated, weighed and taken in.

Four banks stand side by side: a plain one, and with 2, 6 and 12 orders of ripple. Their weights are their likelihoods,
with a fixed share; a bank with ripple has a say once it saw the shaft turn for 1.25 cycles.
"""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.compiling import compiled
from textile_twin_core.shaft.bank import (
    BEST,
    LEARNT,
    LOG_MEMORY,
    LOWEST,
    MEAN,
    MINOR,
    PROBABILITY,
    RIPPLE_SIZE,
    SCALE,
    Bank,
    angle,
    bank_room,
    begin,
    blend,
    expect_angle,
    nearest,
    open_bank,
    open_motion,
    predict,
    take_angle,
    take_speed,
)
from textile_twin_core.shaft.gate import admit
from textile_twin_core.shaft.status import (
    ACCELERATION,
    COVARIANCE,
    CUT,
    INDEX,
    LEAD,
    MEMORY,
    NOISE,
    OFF,
    ORDERS,
    ORIGIN,
    PHASE,
    READING,
    RUNNING,
    SETTLED,
    SPEED,
    STANDSTILL,
    STARTING,
    STEP,
    THETA,
    TIME,
    TURNS,
    UNIT,
    StatusArray,
)
from textile_twin_core.shaft.turns import TURN, TURN_TAIL, split_turn

_FINE: FloatArray = 0.5 * 2.0 ** np.arange(16.0)
_COARSE: FloatArray = 4.0 ** np.arange(8.0)
_WIDE_APART: FloatArray = 4.0 * 8.0 ** np.arange(4.0)
_MEMORIES = (_FINE, _FINE, _COARSE, _WIDE_APART)
"""In samples, up to longer than any record is steady. Twice too long or too short costs little: the error of the speed
goes with the root of the memory; where there are many states, fewer models must do."""
GATE = 49.0
"""Normalised innovation squared (7 sigma) from which a reading is set aside."""
LIKELY = 0.03
"""Weight of a model that is asked about a reading's place."""
SET_ASIDE = 2
"""Readings in a row that may be set aside as outliers before the motion is believed to have changed."""
LOST = 9
"""Readings in a row that follow no motion before everything begins anew."""
BANK_SHARE = 1e-5
"""Weight that passes between banks at each sample: ripple comes and goes with the work done, not with the sample."""
SEEN_CYCLES = 1.25
RESTLESS_CYCLES, REST_CYCLES = 2.0, 16.0
"""Cycles that a bank of no weight works until it rests, and rests until it tries again: work that is not needed."""
NO_WEIGHT = 0.05
NEWCOMER = 1e-5
"""Weight of a bank that comes to have a say where another one with ripple has it already."""
SAMPLES_A_WAVE = 4.0
"""Samples a turn that the highest order of a bank needs, per order."""
GAP_SAMPLES = 50.0
"""A pause of so many intervals is a gap: the motion is found anew."""
FIRST_JITTER = 0.01
"""First guess of the stamps' error, in intervals; learnt within some dozens of samples."""
SETTLING = 25.0
"""Samples until a state is called settled, and at rest until it is called standstill."""
FINEST_RAD2 = 1e-14
"""Least variance of a reading: the rounding of float64 angles some hundred turns away."""
RECALIBRATE_EVERY = 32.0
LEARN_JITTER = 0.5
"""Samples between two lessons about the jitter, and the part of it that each one gives."""
PERIOD_SAMPLES = 500.0
MOST_IN_STEP = 10.0
SPEED_SAMPLES = 100.0
"""Readings that the sampling interval, and the noise of a sensor's own speed, are learnt from."""

Rooms = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
Banks = tuple[Bank, Bank, Bank, Bank]


def bank_rooms(cycle_turns: float) -> Rooms:
    """Room for the four banks."""
    plain, few, some, many = (bank_room(k, cycle_turns, memory) for k, memory in zip(ORDERS, _MEMORIES, strict=True))
    return plain, few, some, many


@compiled
def open_banks(rooms: Rooms) -> Banks:
    """The banks that live in these rooms."""
    return open_bank(rooms[0]), open_bank(rooms[1]), open_bank(rooms[2]), open_bank(rooms[3])


@compiled
def follow(
    record: StatusArray,
    rooms: Rooms,
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
    banks = open_banks(rooms)
    count = 0
    heard[:] = math.nan
    for i in range(stamps.size):
        if admit(record, last, stamps[i], angles[i]):
            velocity = velocities[i] if velocities.size > 0 else math.nan
            take(record, banks, (stamps[i] - last[0]) * record[0].unit, angles[i], velocity, table[count])
            last[0] = stamps[i]
            if table[count, NOISE] > 0.0:
                heard[i] = table[count, READING]
            count += 1
    return count


@compiled
def take(record: StatusArray, banks: Banks, step: float, angle: float, velocity: float, row: FloatArray) -> None:
    """One accepted sample, `step` [s] after the one before; fills its row of the table."""
    status = record[0]
    turns, phase = split_turn(angle)
    status.samples += 1.0
    row[:] = 0.0
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
        _begin_motion(record, banks, step, _unwrapped(record, raw, status.first))
        row[READING], row[CUT] = status.angle, 1.0
        row[NOISE] = row[UNIT] = _noise(record, status.speed)
    else:
        _take_angle(record, banks, step, raw, row)
    if not math.isnan(velocity):
        _take_velocity(record, banks, velocity)
    _mix(record, banks, row)
    _watch(record, math.sqrt(max(row[COVARIANCE + 4], 0.0)))
    row[SETTLED] = -1.0 if status.samples == 2.0 else 1.0 if status.since >= SETTLING else 0.0
    row[THETA], row[ORIGIN], row[LEAD] = status.angle, status.origin, status.lead_bank
    put_angle(row, status.angle)
    row[MEMORY : MEMORY + len(ORDERS)] = status.memory


@compiled
def put_angle(row: FloatArray, angle: float) -> None:
    """Write an angle [rad beyond the row's origin] as whole turns and phase."""
    turns = np.floor(angle / TURN + 0.5)
    row[PHASE] = angle - turns * TURN - turns * TURN_TAIL
    row[TURNS] = row[ORIGIN] + turns


@compiled
def _unwrapped(record: StatusArray, raw: float, expected: float) -> float:
    """The reading nearest to where the shaft should be; an angle that leaves one period counts its turns."""
    status = record[0]
    if status.auto > 0.0 and status.period > 0.0:
        status.low, status.high = min(status.low, raw), max(status.high, raw)
        if status.high - status.low > 1.25 * status.period:
            status.period = 0.0
    if status.period > 0.0:
        status.slips = status.period * np.rint((expected - raw) / status.period)
    return float(raw + status.slips)


@compiled
def _noise(record: StatusArray, speed: float) -> float:
    """Variance of a reading [rad^2]: rounding, of which only one reading in each step says anything new, and jitter."""
    status = record[0]
    in_step = status.rounding / max(abs(speed) * status.interval, 1e-30)
    rounding = status.rounding**2 / 12.0 * min(max(in_step, 1.0), MOST_IN_STEP)
    return float(rounding + status.jitter * speed * speed + FINEST_RAD2)


@compiled
def first_uncertainty(rate: float, noise: float, step: float) -> FloatArray:
    """Lower factor (3, 3) of acceleration, rate, angle after two readings: their noise, and a tenth more speed in a
    step.
    """
    root = math.sqrt(noise)
    kinematic = np.zeros((3, 3))
    kinematic[0, 0] = 0.1 * abs(rate) / step + root / step**2
    kinematic[1, 1] = 1.5 * root / step
    kinematic[2, 1] = kinematic[2, 2] = 0.7 * root
    return kinematic


@compiled
def _begin_motion(record: StatusArray, banks: Banks, step: float, angle: float) -> None:
    """Begin with two readings: what a straight line through them leaves open is the banks' uncertainty."""
    status = record[0]
    rate = (angle - status.first) / step
    status.interval = step
    if status.jitter_told == 0.0:
        status.jitter = (FIRST_JITTER * step) ** 2
    status.angle, status.speed, status.acceleration = angle, rate, 0.0
    kinematic = first_uncertainty(rate, _noise(record, rate), step)
    for number, bank in enumerate(banks):
        begin(bank, angle, rate, 0.0, kinematic, 1.0)
        status.active[number] = 1.0 if _can_tell(record, bank, 1.0) else 0.0
    status.weight[:] = status.travelled[:] = status.rest[:] = status.best[:] = 0.0
    status.scale[:] = 1.0
    status.weight[0] = 1.0
    status.lead_bank = status.since = status.aside = 0.0
    status.off_before = status.off_last = status.judged = 0.0


@compiled
def _can_tell(record: StatusArray, bank: Bank, margin: float) -> bool:
    """Whether there are samples enough in a turn for the bank's highest order."""
    status = record[0]
    a_turn = TURN / max(abs(status.speed) * status.interval, 1e-9)
    return a_turn >= margin * SAMPLES_A_WAVE * bank.head[LOWEST] * (bank.regressor.size // 2)  # type: ignore[no-any-return]


@compiled
def _has_seen(record: StatusArray, bank: Bank, number: int) -> bool:
    return record[0].travelled[number] * bank.head[LOWEST] >= SEEN_CYCLES * TURN  # type: ignore[no-any-return]


@compiled
def _take_angle(record: StatusArray, banks: Banks, step: float, raw: float, row: FloatArray) -> None:
    """One reading from the third on."""
    status = record[0]
    status.since += 1.0
    if step > GAP_SAMPLES * status.interval:
        _bridge_gap(record, banks, step, raw, row)
        return
    gain = max(1.0 / status.samples, 1.0 / PERIOD_SAMPLES)
    status.interval += (min(step, 3.0 * status.interval) - status.interval) * gain
    noise = _noise(record, status.speed)
    expected = status.angle + step * (status.speed + 0.5 * step * status.acceleration)
    reading = _unwrapped(record, raw, expected)
    off = reading - expected
    status.angle = expected
    row[READING], row[UNIT], row[OFF] = reading, noise, off
    scale = _lead_scale(record)
    least, turned = math.inf, abs(status.speed) * step
    for number, bank in enumerate(banks):
        if _is_at_work(record, bank, number, banks[0], turned):
            predict(bank, step, noise, status.interval)
            status.travelled[number] += turned
            # While the ripple is not known, no model says where it should be taken better than the reading does.
            expect_angle(bank, reading, expected if _has_seen(record, bank, number) else reading, noise)
            if status.weight[number] > LIKELY:
                least = min(least, nearest(bank, noise, LIKELY / status.weight[number]))
    row[NOISE] = scale * noise
    if least > GATE and status.since > 5.0:
        if not _is_motion(record, banks, off, step, noise * scale, row):
            row[NOISE] = 0.0
            status.aside += 1.0
            status.outliers += 1.0
            if status.aside > LOST:
                _lose(record, banks, reading, step, row)
            return
        for bank in banks:
            expect_angle(bank, reading, reading, noise)
    status.aside = status.off_before = status.off_last = 0.0
    _absorb(record, banks, noise)


@compiled
def _is_at_work(record: StatusArray, bank: Bank, number: int, plain: Bank, turned: float) -> bool:
    """A bank with ripple works while there are samples enough in a turn for its orders, and rests while it has no
    weight.

    In the middle of a motion it begins from the plain model that ripple has biased least, that of the shortest
    memories.
    """
    status = record[0]
    if number == 0:
        return True
    status.rest[number] = 0.0 if status.weight[number] > NO_WEIGHT else status.rest[number] - turned
    if status.active[number] == 0.0 and status.rest[number] <= 0.0 and _can_tell(record, bank, 1.1):
        m = 1
        kinematic = np.zeros((3, 3))
        for j in range(3):
            for i in range(j, 3):
                kinematic[i, j] = plain.factor[j, i, m]
        state = plain.states[MEAN]
        begin(bank, state[2, m], state[1, m], state[0, m], kinematic, plain.models[SCALE, m])
        bank.models[LEARNT] = plain.models[LEARNT, m]
        status.active[number], status.rest[number], status.travelled[number] = 1.0, 0.0, 0.0
    elif status.active[number] > 0.0 and not _can_tell(record, bank, 0.9):
        status.active[number] = status.weight[number] = 0.0
        status.weight[0] = max(status.weight[0], NEWCOMER)
    elif status.active[number] > 0.0 and status.rest[number] * bank.head[LOWEST] < -RESTLESS_CYCLES * TURN:
        status.active[number] = status.weight[number] = 0.0
        status.rest[number] = REST_CYCLES * TURN / bank.head[LOWEST]
    return status.active[number] > 0.0  # type: ignore[no-any-return]


@compiled
def _lead_scale(record: StatusArray) -> float:
    return record[0].scale[int(record[0].lead_bank)]  # type: ignore[no-any-return]


@compiled
def _is_motion(record: StatusArray, banks: Banks, off: float, step: float, noise: float, row: FloatArray) -> bool:
    """Whether readings far off are the shaft's motion and not outliers: the third of three that follow a line.

    Then the motion is opened: where they are equally far off (an encoder that slipped) the angle alone, else speed and
    acceleration too.
    """
    status = record[0]
    bend = off - 2.0 * status.off_last + status.off_before
    if status.aside < SET_ASIDE or abs(bend) > 0.5 * max(abs(off), abs(status.off_before)):
        status.off_before, status.off_last, status.step_last = status.off_last, off, step
        return False
    span, grown = step + status.step_last, off - status.off_before
    slipped = abs(grown) < 0.25 * abs(off)
    rate = 0.0 if slipped else grown / span
    by_rate = 0.0 if slipped else (math.sqrt(noise) + abs(grown)) / span
    for bank in banks:
        open_motion(bank, off, rate, math.sqrt(noise) + RIPPLE_SIZE * abs(off), by_rate, abs(rate) / span)
    row[CUT] = 1.0 if slipped else 2.0
    status.jumps += row[CUT] == 1.0
    status.outliers -= status.aside
    return True


@compiled
def _bridge_gap(record: StatusArray, banks: Banks, step: float, raw: float, row: FloatArray) -> None:
    """After a pause the ripple is still known, the motion is not."""
    status = record[0]
    status.gaps += 1.0
    reading = _unwrapped(record, raw, status.angle + status.speed * step)
    row[UNIT] = _noise(record, status.speed)
    row[READING], row[CUT], row[NOISE] = reading, 1.0, row[UNIT] * _lead_scale(record)
    root = math.sqrt(row[NOISE])
    by_rate = 0.5 * abs(status.speed) + root / status.interval
    for number, bank in enumerate(banks):
        open_motion(bank, reading - status.angle, 0.0, RIPPLE_SIZE, by_rate, by_rate / (10.0 * status.interval))
        if status.active[number] > 0.0:
            expect_angle(bank, reading, reading, row[UNIT])
            take_angle(bank, row[UNIT], 0.0, False)
    status.angle = reading
    status.since = 0.0


@compiled
def _lose(record: StatusArray, banks: Banks, reading: float, step: float, row: FloatArray) -> None:
    """Readings that follow no motion: begin anew."""
    status = record[0]
    status.losses += 1.0
    status.first = reading - status.speed * step
    _begin_motion(record, banks, step, reading)
    row[CUT] = 1.0
    row[NOISE] = row[UNIT] = _noise(record, status.speed)


@compiled
def _absorb(record: StatusArray, banks: Banks, noise: float) -> None:
    """Take the reading in, and weigh the banks by their likelihoods while the shaft turns."""
    status = record[0]
    moved = abs(status.speed) * status.interval
    turning = moved > 3.0 * math.sqrt(noise)
    # While the shaft stands, all readings may be equal: none the less they are rounded.
    least = 0.3 * status.rounding**2 / 12.0 / noise if moved < status.rounding else 1e-6
    plain, total, count = 0.0, 0.0, 0
    weight = status.weight
    for number, bank in enumerate(banks):
        if status.active[number] > 0.0:
            seen = number > 0 and _has_seen(record, bank, number)
            together = take_angle(bank, noise, least, seen)
            plain = together if number == 0 else plain
            weight[number] *= together if turning else plain
            if seen and weight[number] == 0.0:
                weight[number] = -1.0
            best = int(bank.head[BEST])
            status.best[number], status.memory[number] = best, bank.head[LOG_MEMORY]
            status.top[number], status.scale[number] = bank.models[PROBABILITY, best], bank.models[SCALE, best]
            total += max(weight[number], 0.0)
            count += 1
    known = total * (NEWCOMER if status.judged > 0.0 else 1.0)
    for k in range(weight.size):
        if weight[k] < 0.0:
            weight[k] = known
            total += known
            status.judged = 1.0
    for k in range(weight.size):
        if weight[k] > 0.0:
            weight[k] = weight[k] / total * (1.0 - BANK_SHARE) + BANK_SHARE / count
    if status.samples % RECALIBRATE_EVERY == 0.0 and turning and status.since > RECALIBRATE_EVERY / 2.0:
        _recalibrate(record, banks, noise)


@compiled
def _recalibrate(record: StatusArray, banks: Banks, noise: float) -> None:
    """Give what the leading model has learnt of the noise to jitter and rounding, so that it follows the speed.

    Readings on a lattice that are much better than its step are edges of teeth, timed: they are not rounded.
    """
    status = record[0]
    found = _lead_scale(record) * noise
    rounding = status.rounding**2 / 12.0
    moved = abs(status.speed) * status.interval
    if rounding > 0.0 and found < 0.1 * rounding and moved > 0.5 * status.rounding:
        status.rounding = rounding = 0.0
    if status.jitter_told == 0.0:
        learnt = max(found - rounding, 0.01 * found) / status.speed**2
        status.jitter += LEARN_JITTER * (learnt - status.jitter)
    _rescale(banks, noise / _noise(record, status.speed))


@compiled
def _rescale(banks: Banks, change: float) -> None:
    """The unit of noise has become so many times smaller: what scale and factor stand for must stay."""
    for bank in banks:
        bank.models[SCALE] *= change
        bank.factor[:, :, :] /= math.sqrt(change)


@compiled
def set_rounding(record: StatusArray, rooms: Rooms, rounding: float) -> None:
    """From now on the encoder's step is known, 0 for none [rad]."""
    status = record[0]
    before = _noise(record, status.speed)
    status.rounding = rounding
    if status.samples > 1.0:
        _rescale(open_banks(rooms), before / _noise(record, status.speed))


@compiled
def _take_velocity(record: StatusArray, banks: Banks, velocity: float) -> None:
    """The sensor's own speed as a further reading, of a noise that is learnt."""
    status = record[0]
    off = velocity - status.speed
    if status.speed_noise == 0.0:
        status.speed_noise = max(off * off, (0.02 * status.speed) ** 2) + FINEST_RAD2
    status.speed_noise += (off * off - status.speed_noise) / SPEED_SAMPLES
    for number, bank in enumerate(banks):
        if status.active[number] > 0.0:
            take_speed(bank, velocity, status.angle, status.speed_noise)


@compiled
def _mix(record: StatusArray, banks: Banks, row: FloatArray) -> None:
    """Mean and covariance of the mixture of all models that count, about the leading one's angle."""
    status = record[0]
    moments, about = status.moments, status.about
    top = 0.0
    for k in range(status.weight.size):
        if status.weight[k] * status.top[k] > top:
            top, status.lead_bank = status.weight[k] * status.top[k], float(k)
    lead = int(status.lead_bank)
    about[0] = angle(banks[lead], int(status.best[lead]), status.angle)
    about[1], about[2] = status.speed, status.acceleration
    moments[:] = 0.0
    for number, bank in enumerate(banks):
        if status.weight[number] >= MINOR * top:
            blend(bank, status.weight[number], about, top, moments)
    for p in range(3):
        moments[1 + p] /= moments[0]
    place = 4
    for p in range(3):
        for q in range(p, 3):
            value = moments[place] / moments[0] - moments[1 + p] * moments[1 + q]
            row[COVARIANCE + 3 * p + q] = row[COVARIANCE + 3 * q + p] = value
            place += 1
    status.angle = about[0] + moments[1]
    status.speed = row[SPEED] = about[1] + moments[2]
    status.acceleration = row[ACCELERATION] = about[2] + moments[3]
    if abs(status.speed) * status.interval < status.rounding:
        row[COVARIANCE] += status.rounding**2 / 12.0


@compiled
def _watch(record: StatusArray, sigma: float) -> None:
    """Standstill and reversals: the shaft moves when it leaves its reading's noise within some samples."""
    status = record[0]
    hardly = max(status.rounding, 3.0 * math.sqrt(_noise(record, status.speed))) / (SETTLING * status.interval)
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


def ripple_amplitudes(record: StatusArray, rooms: Rooms) -> FloatArray:
    """Amplitude of the speed's ripple relative to the speed, by orders of the leading bank; empty for a plain one."""
    status = record[0]
    bank = open_bank(rooms[int(status["lead_bank"])])
    ripple = bank.states[MEAN, :-3, int(bank.head[BEST])]
    amplitudes: FloatArray = (
        np.hypot(ripple[0::2], ripple[1::2]) * bank.head[LOWEST] * np.arange(1, ripple.size // 2 + 1)
    )
    return amplitudes
