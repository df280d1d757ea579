"""Track initiation and the outlier gate: outliers against manoeuvres, gaps of the record, restarts."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import filter_bank, layout, measurement_noise
from textile_twin_core.shaft.clock import copy_numbers, wave_at
from textile_twin_core.shaft.kalman import time_update
from textile_twin_core.shaft.measurement_noise import REPEATING, SETTLING
from textile_twin_core.shaft.model_bank import FIRST_IDLE, UNBIASED
from textile_twin_core.shaft.status import MANOEUVRE, STRETCH, TRACK, Record, Records
from textile_twin_core.shaft.unwrapping import MAX_GAP_SIGMA, MAX_SPEED_RATIO, unwrap_reading

MAX_OUTLIERS = 2  # consecutive readings rejected as outliers before a manoeuvre may be declared
MAX_UNCONFIRMED = 9  # rejected readings, less those accepted since, beyond which the track is lost
CLEAN_SAMPLES = 100.0  # samples without an outlier, after which one rejection fewer is enough
# readings that must fit after a manoeuvre; growing outliers and overshoot of the speed have decayed by then
UNCONFIRMED = 7.0
# memory and bound of `abrupt`; an outlier ends the immediate acceptance of manoeuvres
FORGET_ABRUPT, MOST_ABRUPT = 0.97, 2.0
NEARER = 0.5  # ratio of distances: after a slip of the encoder both are equal
OUTLIER_WEIGHT = 3.0  # weight of an outlier in `abrupt`; a manoeuvre has 1
SLIPPED = 0.25  # part of an innovation by which innovations of a slipped encoder differ at most
SLIPS_APART = 15.0  # samples between two slips in the same direction
GROWTH = 1.25  # ratio of two successive innovations from which they grow as in a manoeuvre
RUNAWAY = 8.0  # ratio of the predicted to the mean measured move that no real shaft keeps up
FALSE_START = 4.0  # innovation, in deviations from the line through the latest readings
SENSOR_SPEED_SIGMA = 0.02  # relative standard deviation of a sensor's own speed


@compiled_in_place
def predicted_angle(state: Record, step: float) -> float:
    """Predict the angle [rad] `step` [s] after a status or a row, at constant acceleration."""
    return float(state.angle + step * (state.speed + 0.5 * step * state.acceleration))


@compiled_in_place
def set_start(start: FloatArray, angle: float, rate: float, noise: float, step: float) -> None:
    """Set state and covariance factor (9,) by two-point initiation; acceleration sigma: a tenth of the speed a step."""
    root = math.sqrt(noise)
    start[layout.ACCELERATION], start[layout.RATE], start[layout.ANGLE] = 0.0, rate, angle
    start[layout.L00], start[layout.L10], start[layout.L20] = 0.1 * abs(rate) / step + root / step**2, 0.0, 0.0
    start[layout.L11], start[layout.L21], start[layout.L22] = 1.5 * root / step, 0.7 * root, 0.7 * root


@compiled_in_place
def initiate(status: Record, step: float, angle: float, rate: float, row: Record) -> None:
    """Initiate the track, at first or after a loss, from the reading `angle`, `step` [s] after the last.

    A sensor's own speed replaces the speed `rate` [rad/s] where it agrees. It is not used later: drives mostly
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
    if abs(status.sensor_speed - rate) <= 3.0 * initial[layout.L11]:
        initial[layout.RATE] = status.speed = status.sensor_speed
        initial[layout.L11] = SENSOR_SPEED_SIGMA * (abs(status.speed) + initial[layout.L11])
        initial[layout.L21], initial[layout.L22] = 0.0, math.sqrt(noise)
    status.scale[UNBIASED] = status.recent_scale[UNBIASED] = status.scale_before[UNBIASED] = 1.0
    status.scale_samples[UNBIASED] = filter_bank.FIRST_SCALE_WEIGHT
    filter_bank.begin_model(status, layout.PLAIN, layout.PLAIN, UNBIASED, 0)
    status.active[:] = status.mode_probability[:] = status.idle[:] = 0.0
    status.active[0], status.mode_probability[0], status.leading, status.next_idle[:] = 1.0, 1.0, 0, FIRST_IDLE
    status.since = status.rejected_run = status.unconfirmed = status.clean = status.ripple_tried = 0.0
    status.innovation_before = status.last_innovation = status.runaway = 0.0
    row.reading, row.cut = angle, TRACK
    row.noise = row.unit = measurement_noise.measurement_variance(status)


@compiled_in_place
def _begin_differences(status: Record, reading: float) -> None:
    """Restart the differences of readings at a reading: moves from earlier ones are meaningless."""
    status.last_reading, status.last_used, status.last_used_at, status.moved, status.bent = (
        reading,
        reading,
        status.time,
        0.0,
        0.0,
    )
    status.differences = 0.0


@compiled_in_place
def is_false_start(status: Record, reading: float, innovation: float, step: float) -> bool:
    """Return whether one of the first two readings was an outlier: the next three lie on a line of their own.

    Readings in bunches are excluded, as they imitate lines.
    """
    if status.samples != 5.0 or step < 0.5 * status.interval:
        return False
    bend = reading - status.last_used - status.moved * step / status.interval
    limit = FALSE_START * (abs(bend) + math.sqrt(measurement_noise.measurement_variance(status)))
    return abs(innovation) > limit


@compiled_in_place
def is_runaway(status: Record, moved: float, step: float) -> bool:
    """Return whether the estimated speed has long been many times that of the readings, which moved by `moved` [rad].

    No reading would correct it: the readings' variance grows with the speed.
    """
    status.travel += (abs(moved) - status.travel) / SETTLING
    runs = status.still == 0.0 and abs(status.speed) * step > RUNAWAY * (status.travel + status.resolution)
    status.runaway = status.runaway + 1.0 if runs else 0.0
    return status.runaway > UNCONFIRMED


@compiled_in_place
def is_growing(status: Record, innovation: float) -> bool:
    """Return whether an innovation has the sign of the last rejected one and is larger."""
    return innovation * status.last_innovation >= 0.0 and abs(innovation) > GROWTH * abs(status.last_innovation)


@compiled_in_place
def is_alike(status: Record, innovation: float) -> bool:
    """Return whether an innovation equals the one just rejected while the gate widens, or undoes the last slip."""
    undone = -status.slip if status.since_slip < SETTLING else 0.0
    alike = abs(innovation - (status.last_innovation if status.rejected_run > 0.0 else undone)) < SLIPPED * abs(
        innovation
    )
    return alike and status.used > CLEAN_SAMPLES and not _slipped_before(status, innovation)


@compiled_in_place
def _slipped_before(status: Record, innovation: float) -> bool:
    """Return whether the encoder seemed to slip in the same direction just before."""
    return bool(status.slip * innovation > 0.0 and status.since_slip < SLIPS_APART)


@compiled_in_place
def accept_manoeuvre(record: Records, reading: float, innovation: float, step: float, row: Record) -> bool:
    """Accept an innovation outside the gate as a manoeuvre, or reject the reading.

    A manoeuvre lies on a line with the last two rejected innovations, on one side; fewer are enough where `early` or
    `at_once` (see `reconsider`). Equal innovations are a slip of the encoder.
    """
    status = record[0]
    early = status.rejected_run == 1.0 and status.clean >= CLEAN_SAMPLES
    at_once = (
        status.rejected_run == 0.0 and status.abrupt > 0.0 and status.fastest > 0.0 and status.repeat_share <= REPEATING
    )
    if early or at_once:
        span, grown, slipped = step, innovation - status.last_innovation, False
        straight = at_once or is_growing(status, innovation)
    else:
        span, grown = step + status.last_rejected_step, innovation - status.innovation_before
        slipped = abs(grown) < SLIPPED * abs(innovation)
        if slipped and _slipped_before(status, innovation):  # stamps that lag increasingly: the speed has changed
            slipped, grown, span = False, innovation, status.since_slip * status.interval
            status.additive = max(status.additive, innovation * innovation / 12.0)
        one_side = min(innovation * status.last_innovation, innovation * status.innovation_before) > 0.0
        bend = innovation - 2.0 * status.last_innovation + status.innovation_before
        on_line = abs(bend) <= 0.5 * max(abs(innovation), abs(status.innovation_before))
        straight = one_side and on_line and status.rejected_run >= MAX_OUTLIERS
    too_fast = not slipped and 0.0 < MAX_SPEED_RATIO * status.fastest < abs(status.speed + grown / span)
    if not straight or (too_fast and status.rejected_run <= MAX_OUTLIERS):
        row.noise = 0.0
        _reject(status, innovation, step)
        none = status.rejected_run > (MAX_UNCONFIRMED if slipped else MAX_OUTLIERS)
        if none and status.unconfirmed > MAX_UNCONFIRMED:
            status.losses += 1.0
            initiate(status, step, reading, 0.0 if status.repeat_run > 0.0 else status.speed, row)
        return False
    if at_once:
        record[1] = record[0]
        _reject(record[1], innovation, step)
        status.provisional = 1.0
    elif not slipped:
        learn_abruptness(status, True)
    status.clean = 0.5 * CLEAN_SAMPLES if early else status.clean
    row.cut = STRETCH if slipped else MANOEUVRE
    rate, sigma = 0.0 if slipped else grown / span, math.sqrt(row.noise)  # a slip of the encoder keeps the speed
    by_rate = 0.0 if slipped else (sigma + abs(grown)) / span
    filter_bank.open_manoeuvre(
        status, row, innovation, rate, sigma + filter_bank.RIPPLE_SIZE * abs(innovation), by_rate, abs(rate) / span
    )
    row.unit += (filter_bank.RIPPLE_SIZE * innovation) ** 2
    if slipped:
        status.jumps += 1.0
        # Until repetitions of the sensor are known, the moves after them look like slips.
        status.slip, status.since_slip = innovation if status.used > CLEAN_SAMPLES else 0.0, 0.0
    status.outliers -= status.rejected_run
    more = UNCONFIRMED if early or at_once else status.rejected_run
    status.unconfirmed = max(min(status.unconfirmed + more, MAX_UNCONFIRMED), UNCONFIRMED)
    return True


@compiled_in_place
def _reject(status: Record, innovation: float, step: float) -> None:
    """Count a rejected reading and store its innovation."""
    status.innovation_before, status.last_innovation, status.last_rejected_step = (
        status.last_innovation,
        innovation,
        step,
    )
    status.rejected_run += 1.0
    status.unconfirmed += 1.0
    status.outliers += 1.0


@compiled_in_place
def learn_abruptness(status: Record, manoeuvre: bool) -> None:
    """Update `abrupt` by what was outside the gate: a manoeuvre, or an outlier."""
    status.abrupt = min(FORGET_ABRUPT * status.abrupt + (1.0 if manoeuvre else -OUTLIER_WEIGHT), MOST_ABRUPT)


@compiled_in_place
def reconsider(record: Records, raw: float, step: float, gap: bool) -> bool:
    """Return whether the next reading, `raw` before unwrapping, confirms a provisional manoeuvre.

    The manoeuvre stays if the reading is much nearer to it than to the track without it, stored in `record[1]`;
    otherwise that track is restored. After a gap neither track predicts the reading.
    """
    status, without = record[0], record[1]
    status.provisional = 0.0
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
    """Return the distance of a reading from the prediction [rad]."""
    innovation = raw + status.slips - predicted_angle(status, step)
    return float(
        innovation - status.period * np.rint(innovation / status.period) if status.period > 0.0 else innovation
    )


@compiled_in_place
def is_predicted(status: Record, step: float, reading: float) -> bool:
    """Return whether the best filter predicts a reading [rad] after a gap of `step` [s]: the track then continues."""
    f, noise = status.leading, measurement_noise.measurement_variance(status)
    m, trial = status.best[f], layout.SMOOTHER
    copy_numbers(status.clock[:, m], status.clock[:, trial])
    status.jerk_strength[trial] = status.jerk_strength[m]
    time_update(status, math.sqrt(noise * step / status.interval**5), step, trial, trial + 1)
    x, g = status.clock[:, trial], wave_at(status, f, m, status.second, reading)
    variance = status.scale[m] * (noise + x[layout.L20] ** 2 + x[layout.L21] ** 2 + x[layout.L22] ** 2)
    return variance <= MAX_GAP_SIGMA**2 and (reading + g[0] - x[layout.ANGLE]) ** 2 <= 9.0 * variance


@compiled_in_place
def bridge_gap(status: Record, step: float, raw: float, row: Record) -> None:
    """Continue after a gap: keep the ripple, move the angle to the reading, inflate the state's covariance."""
    reading = unwrap_reading(status, raw, status.angle + status.speed * step)
    row.unit = measurement_noise.measurement_variance(status)
    row.reading, row.cut, row.noise = reading, STRETCH, row.unit * status.scale[status.best[status.leading]]
    by_rate = 0.5 * abs(status.speed) + math.sqrt(row.noise) / status.interval
    filter_bank.open_manoeuvre(
        status, row, reading - status.angle, 0.0, filter_bank.RIPPLE_SIZE, by_rate, by_rate / (10.0 * status.interval)
    )
    for f in range(layout.MODELS):
        if status.active[f] > 0.0:
            filter_bank.update_filters(status, f, row.unit, 0.0)
    status.angle = reading
    _begin_differences(status, reading)
    status.since = status.rejected_run = status.innovation_before = status.last_innovation = 0.0
