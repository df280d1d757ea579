"""Track initiation, gating: outliers against manoeuvres, gaps in the record, and restarts."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import bank, lanes, measurement_noise
from textile_twin_core.shaft.clock import copy_numbers, wave_at
from textile_twin_core.shaft.families import FIRST_REST, UNBIASED
from textile_twin_core.shaft.kalman import time_update
from textile_twin_core.shaft.measurement_noise import LEAP_GUESSED, OFTEN_HELD, SETTLING
from textile_twin_core.shaft.status import MANOEUVRE, STRETCH, TRACK, Record, Records

MAX_OUTLIERS = 2  # consecutive measurements rejected as outliers before a manoeuvre may be declared
MAX_UNCONFIRMED = 9  # rejected measurements, less those accepted since, beyond which the track is lost
CLEAN_SAMPLES = 100.0  # samples without an outlier, from which one rejection fewer is enough
UNCONFIRMED = 7.0  # that must fit after a manoeuvre: outliers that grew, or a speed overshot, are forgotten by then
FORGET_ABRUPT, MOST_ABRUPT = 0.97, 2.0  # memory and bound of `abrupt`: an outlier ends the belief in what comes next
NEARER = 0.5  # ratio of distances: an encoder that slipped is as far from either
OUTLIER_WEIGHT = 3.0  # of an outlier in `abrupt`, a manoeuvre's being 1
SLIPPED = 0.25  # part of an innovation by which those of an encoder that slipped differ at most
SLIPS_APART = 15.0  # samples between two slips the same way
GROWTH = 1.25  # ratio of two successive innovations from which they grow as in a manoeuvre
MAX_SPEED_RATIO = 2.0  # of the highest speed seen, above which one rejection more is needed: outliers line up by chance
MAX_GAP_SIGMA = 0.05  # [rad] predicted across a gap: at most 1 in 20 other motions passes a gate of 3 sigma by chance
RUNAWAY = 8.0  # times the mean move of readings, beyond which no shaft moves between them for long
FALSE_START = 4.0  # innovation in deviations from the line through the latest measurements
SENSOR_SPEED_SIGMA = 0.02  # standard deviation of a sensor's own speed, relative


@compiled_in_place
def foretold(state: Record, step: float) -> float:
    """The angle [rad] that the acceleration foretells `step` [s] after a status or a row."""
    return float(state.angle + step * (state.speed + 0.5 * step * state.acceleration))


@compiled_in_place
def set_start(start: FloatArray, angle: float, rate: float, noise: float, step: float) -> None:
    """Two-point initiation: state and covariance factor (9,); acceleration may change the speed by a tenth a step."""
    root = math.sqrt(noise)
    start[lanes.ACCELERATION], start[lanes.RATE], start[lanes.ANGLE] = 0.0, rate, angle
    start[lanes.L00], start[lanes.L10], start[lanes.L20] = 0.1 * abs(rate) / step + root / step**2, 0.0, 0.0
    start[lanes.L11], start[lanes.L21], start[lanes.L22] = 1.5 * root / step, 0.7 * root, 0.7 * root


@compiled_in_place
def initiate(status: Record, step: float, angle: float, rate: float, row: Record) -> None:
    """Initiate the track, at first or after its loss, from the measurement `angle`, `step` [s] after the last.

    A sensor's own speed replaces the speed `rate` [rad/s] where it agrees. It is no measurement later: drives mostly
    differentiate the same angles, smoothed and late, which made the acceleration's error ten times larger.
    """
    status.interval = step
    measurement_noise.begin_jitter(status)
    status.angle, status.speed, status.acceleration = angle, rate, 0.0
    status.move = abs(rate) * step
    _begin_differences(status, angle)
    measurement_noise.set_correlated(status)
    initial, noise = status.clock[:, UNBIASED], measurement_noise.measurement_variance(status)
    set_start(initial, angle, rate, noise, step)
    if abs(status.sensor_speed - rate) <= 3.0 * initial[lanes.L11]:
        initial[lanes.RATE] = status.speed = status.sensor_speed
        initial[lanes.L11] = SENSOR_SPEED_SIGMA * (abs(status.speed) + initial[lanes.L11])
        initial[lanes.L21], initial[lanes.L22] = 0.0, math.sqrt(noise)
    status.scale[UNBIASED] = status.recent_scale[UNBIASED] = status.scale_before[UNBIASED] = 1.0
    status.scale_samples[UNBIASED] = bank.FIRST_SCALE_WEIGHT
    bank.begin_family(status, lanes.PLAIN, lanes.PLAIN, UNBIASED, 0)
    status.active[:] = status.mode_probability[:] = status.rest[:] = 0.0
    status.active[0], status.mode_probability[0], status.leading, status.pause[:] = 1.0, 1.0, 0, FIRST_REST
    status.since = status.rejected_run = status.unconfirmed = status.clean = status.ripple_tried = 0.0
    status.off_before = status.off_last = status.runaway = 0.0
    row.reading, row.cut = angle, TRACK
    row.noise = row.unit = measurement_noise.measurement_variance(status)


@compiled_in_place
def _begin_differences(status: Record, reading: float) -> None:
    """Forget the readings before one, where moves from them to later ones tell nothing."""
    status.read, status.kept, status.kept_at, status.moved, status.bent = reading, reading, status.time, 0.0, 0.0
    status.differences = 0.0


@compiled_in_place
def is_false_start(status: Record, reading: float, off: float, step: float) -> bool:
    """Whether one of the first two measurements was an outlier: the next three lie on a line of their own.

    `off` is the innovation. Stamps that come in bunches are left out, as they feign lines.
    """
    if status.samples != 5.0 or step < 0.5 * status.interval:
        return False
    bend = reading - status.kept - status.moved * step / status.interval
    limit = FALSE_START * (abs(bend) + math.sqrt(measurement_noise.measurement_variance(status)))
    return abs(off) > limit


@compiled_in_place
def is_runaway(status: Record, moved: float, step: float) -> bool:
    """Whether the estimated speed has for long been many times that of the readings, which `moved` [rad] now.

    No reading would correct it: their noise follows the speed.
    """
    status.travel += (abs(moved) - status.travel) / SETTLING
    runs = status.still == 0.0 and abs(status.speed) * step > RUNAWAY * (status.travel + status.resolution)
    status.runaway = status.runaway + 1.0 if runs else 0.0
    return status.runaway > UNCONFIRMED


@compiled_in_place
def is_growing(status: Record, off: float) -> bool:
    """Whether an innovation has the sign of the last rejected one and is larger."""
    return off * status.off_last >= 0.0 and abs(off) > GROWTH * abs(status.off_last)


@compiled_in_place
def is_alike(status: Record, off: float) -> bool:
    """Whether an innovation is like the one just rejected, no nearer as the gate widens, or undoes the last slip."""
    undone = -status.slip if status.since_slip < SETTLING else 0.0
    alike = abs(off - (status.off_last if status.rejected_run > 0.0 else undone)) < SLIPPED * abs(off)
    return alike and status.used > CLEAN_SAMPLES and not _slipped_before(status, off)


@compiled_in_place
def _slipped_before(status: Record, off: float) -> bool:
    """Whether the encoder seemed to slip the same way just before."""
    return bool(status.slip * off > 0.0 and status.since_slip < SLIPS_APART)


@compiled_in_place
def accept_manoeuvre(record: Records, reading: float, off: float, step: float, row: Record) -> bool:
    """Whether an innovation outside the gate is a manoeuvre: it lies on a line with the last two rejected, on one side.

    Or fewer are enough (`early`, `at_once`, see `reconsider`). Where the innovations are alike the encoder slipped.
    What is no manoeuvre is rejected.
    """
    status = record[0]
    early = status.rejected_run == 1.0 and status.clean >= CLEAN_SAMPLES
    at_once = status.rejected_run == 0.0 and status.abrupt > 0.0 and status.fastest > 0.0 and status.held <= OFTEN_HELD
    if early or at_once:
        span, grown, slipped = step, off - status.off_last, False
        straight = at_once or is_growing(status, off)
    else:
        span, grown = step + status.step_last, off - status.off_before
        slipped = abs(grown) < SLIPPED * abs(off)
        if slipped and _slipped_before(status, off):  # stamps that lag behind more and more: the speed is another
            slipped, grown, span = False, off, status.since_slip * status.interval
            status.additive = max(status.additive, off * off / 12.0)
        one_side = min(off * status.off_last, off * status.off_before) > 0.0
        bend = off - 2.0 * status.off_last + status.off_before
        on_line = abs(bend) <= 0.5 * max(abs(off), abs(status.off_before))
        straight = one_side and on_line and status.rejected_run >= MAX_OUTLIERS
    # A bus that dropped out repeats a reading, behind a shaft that moved by many encoder steps; more last at a stop.
    behind = off * status.moved < 0.0 and abs(status.moved) > LEAP_GUESSED * status.resolution
    dropout = behind and status.holding > status.rejected_run
    too_fast = not slipped and 0.0 < MAX_SPEED_RATIO * status.fastest < abs(status.speed + grown / span)
    if not straight or dropout or (too_fast and status.rejected_run <= MAX_OUTLIERS):
        row.noise = 0.0
        _set_aside(status, off, step)
        none = status.rejected_run > (MAX_UNCONFIRMED if slipped else MAX_OUTLIERS)
        if none and status.unconfirmed > MAX_UNCONFIRMED:
            status.losses += 1.0
            initiate(status, step, reading, 0.0 if status.holding > 0.0 else status.speed, row)
        return False
    if at_once:
        record[1] = record[0]
        _set_aside(record[1], off, step)
        status.doubtful = 1.0
    elif not slipped:
        learn_abruptness(status, True)
    status.clean = 0.5 * CLEAN_SAMPLES if early else status.clean
    row.cut = STRETCH if slipped else MANOEUVRE
    rate, sigma = 0.0 if slipped else grown / span, math.sqrt(row.noise)  # speeds stay where the encoder slipped
    by_rate = 0.0 if slipped else (sigma + abs(grown)) / span
    bank.open_manoeuvre(status, row, off, rate, sigma + bank.RIPPLE_SIZE * abs(off), by_rate, abs(rate) / span)
    row.unit += (bank.RIPPLE_SIZE * off) ** 2
    if slipped:
        status.jumps += 1.0
        # Until it is known whether the sensor repeats readings, the moves after these look like slips.
        status.slip, status.since_slip = off if status.used > CLEAN_SAMPLES else 0.0, 0.0
    status.outliers -= status.rejected_run
    more = UNCONFIRMED if early or at_once else status.rejected_run
    status.unconfirmed = max(min(status.unconfirmed + more, MAX_UNCONFIRMED), UNCONFIRMED)
    return True


@compiled_in_place
def _set_aside(status: Record, off: float, step: float) -> None:
    """Count a rejected measurement, and keep its innovation."""
    status.off_before, status.off_last, status.step_last = status.off_last, off, step
    status.rejected_run += 1.0
    status.unconfirmed += 1.0
    status.outliers += 1.0


@compiled_in_place
def learn_abruptness(status: Record, manoeuvre: bool) -> None:
    """Learn from what was outside the gate: a manoeuvre, or an outlier."""
    status.abrupt = min(FORGET_ABRUPT * status.abrupt + (1.0 if manoeuvre else -OUTLIER_WEIGHT), MOST_ABRUPT)


@compiled_in_place
def reconsider(record: Records, raw: float, step: float, gap: bool) -> bool:
    """Whether the next measurement, `raw` before unwrapping, confirms a manoeuvre that is in doubt.

    Unless it is much nearer to it than to the track without, which `record[1]` has kept, that takes its place. Across a
    gap neither foretells it.
    """
    status, without = record[0], record[1]
    status.doubtful = 0.0
    if not gap and abs(_distance(status, raw, step)) < NEARER * abs(_distance(without, raw, step)):
        learn_abruptness(status, True)
        return True
    without.accepted, without.received = status.accepted, status.received
    without.not_finite = status.not_finite
    without.duplicate_stamp, without.older_stamp = status.duplicate_stamp, status.older_stamp
    record[0] = record[1]
    return False


@compiled_in_place
def _distance(status: Record, raw: float, step: float) -> float:
    """Of a measurement from the prediction [rad]."""
    off = raw + status.slips - foretold(status, step)
    return float(off - status.period * np.rint(off / status.period) if status.period > 0.0 else off)


@compiled_in_place
def is_predicted(status: Record, step: float, reading: float) -> bool:
    """Whether the best filter predicts a measurement [rad] after a gap of `step` [s], so that the track continues."""
    f, noise = status.leading, measurement_noise.measurement_variance(status)
    m, trial = status.best[f], lanes.CHAIN
    copy_numbers(status.clock[:, m], status.clock[:, trial])
    status.jerk_strength[trial] = status.jerk_strength[m]
    time_update(status, math.sqrt(noise * step / status.interval**5), step, trial, trial + 1)
    x, g = status.clock[:, trial], wave_at(status, f, m, status.second, reading)
    variance = status.scale[m] * (noise + x[lanes.L20] ** 2 + x[lanes.L21] ** 2 + x[lanes.L22] ** 2)
    return variance <= MAX_GAP_SIGMA**2 and (reading + g[0] - x[lanes.ANGLE]) ** 2 <= 9.0 * variance


@compiled_in_place
def bridge_gap(status: Record, step: float, raw: float, row: Record) -> None:
    """After a gap: keep the ripple, shift the angle to the measurement and inflate the state's covariance."""
    reading = measurement_noise.unwrap_reading(status, raw, status.angle + status.speed * step)
    row.unit = measurement_noise.measurement_variance(status)
    row.reading, row.cut, row.noise = reading, STRETCH, row.unit * status.scale[status.best[status.leading]]
    by_rate = 0.5 * abs(status.speed) + math.sqrt(row.noise) / status.interval
    bank.open_manoeuvre(
        status, row, reading - status.angle, 0.0, bank.RIPPLE_SIZE, by_rate, by_rate / (10.0 * status.interval)
    )
    for f in range(lanes.FAMILIES):
        if status.active[f] > 0.0:
            bank.update_filters(status, f, row.unit, 0.0)
    status.angle = reading
    _begin_differences(status, reading)
    status.since = status.rejected_run = status.off_before = status.off_last = 0.0
