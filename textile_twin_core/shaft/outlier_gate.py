"""Track initiation and the outlier gate: outliers against manoeuvres, gaps of the record, restarts."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft import filter_bank, layout, measurement_noise
from textile_twin_core.shaft.constants import (
    CLEAN_SAMPLES,
    FALSE_START,
    FIRST_IDLE,
    FIRST_SCALE_WEIGHT,
    FORGET_ABRUPT,
    GROWTH,
    MAX_GAP_SIGMA,
    MAX_OUTLIERS,
    MAX_SPEED_RATIO,
    MAX_UNCONFIRMED,
    MOST_ABRUPT,
    NEARER,
    OUTLIER_WEIGHT,
    REPEATING,
    RIPPLE_SIZE,
    RUNAWAY,
    SENSOR_SPEED_SIGMA,
    SETTLING,
    SLIPPED,
    SLIPS_APART,
    UNBIASED,
    UNCONFIRMED,
)
from textile_twin_core.shaft.kalman import time_update
from textile_twin_core.shaft.ripple import copy_numbers, wave_at
from textile_twin_core.shaft.samples import unwrap_reading
from textile_twin_core.shaft.status import (
    MANOEUVRE,
    STRETCH,
    TRACK,
    Bank,
    Counts,
    Differences,
    FilterRow,
    FilterStatus,
    Gate,
    Mixture,
    Records,
    Sampling,
    Unwrapping,
)


@compiled_in_place
def predicted_angle(state: Mixture | FilterRow, step: float) -> float:
    """Predict the angle [rad] `step` [s] after a state, at constant acceleration."""
    return float(state.angle + step * (state.speed + 0.5 * step * state.acceleration))


@compiled_in_place
def set_start(start: FloatArray, angle: float, rate: float, noise: float, step: float) -> None:
    """Set state and covariance factor (9,) by two-point initiation; acceleration sigma: a tenth of the speed a step."""
    root = math.sqrt(noise)
    start[layout.ACCELERATION], start[layout.RATE], start[layout.ANGLE] = 0.0, rate, angle
    start[layout.L00], start[layout.L10], start[layout.L20] = 0.1 * abs(rate) / step + root / step**2, 0.0, 0.0
    start[layout.L11], start[layout.L21], start[layout.L22] = 1.5 * root / step, 0.7 * root, 0.7 * root


@compiled_in_place
def initiate(status: FilterStatus, step: float, angle: float, rate: float, row: FilterRow) -> None:
    """Initiate the track, at first or after a loss, from the reading `angle`, `step` [s] after the last.

    A sensor's own speed replaces the speed `rate` [rad/s] where it agrees. It is not used later: drives mostly
    differentiate the same angles, smoothed and late, which made the acceleration's error ten times larger.
    """
    sampling, track, noise, gate = status.sampling, status.track, status.noise, status.gate
    filters, models = status.bank.filters, status.bank.models
    sampling.interval = step
    measurement_noise.begin_jitter(noise, step)
    track.angle, track.speed, track.acceleration = angle, rate, 0.0
    sampling.move = abs(rate) * step
    _begin_differences(status, angle)
    measurement_noise.set_correlated(noise, track, step)
    initial, variance = filters.clock[:, UNBIASED], measurement_noise.measurement_variance(noise, rate)
    set_start(initial, angle, rate, variance, step)
    if abs(track.sensor_speed - rate) <= 3.0 * initial[layout.L11]:
        initial[layout.RATE] = track.speed = track.sensor_speed
        initial[layout.L11] = SENSOR_SPEED_SIGMA * (abs(track.speed) + initial[layout.L11])
        initial[layout.L21], initial[layout.L22] = 0.0, math.sqrt(variance)
    filters.scale[UNBIASED] = filters.recent_scale[UNBIASED] = filters.scale_before[UNBIASED] = 1.0
    filters.scale_samples[UNBIASED] = FIRST_SCALE_WEIGHT
    filter_bank.begin_model(status.bank, layout.PLAIN, layout.PLAIN, UNBIASED, layout.MOST_WAVES[layout.PLAIN])
    models.active[:] = models.mode_probability[:] = models.idle[:] = 0.0
    models.active[0], models.mode_probability[0], models.leading, models.next_idle[:] = 1.0, 1.0, 0, FIRST_IDLE
    sampling.since = models.ripple_tried = gate.rejected_run = gate.unconfirmed = gate.clean = 0.0
    gate.innovation_before = gate.last_innovation = gate.runaway = 0.0
    row.reading, row.cut = angle, TRACK
    row.noise = row.unit = measurement_noise.measurement_variance(noise, track.speed)


@compiled_in_place
def _begin_differences(status: FilterStatus, reading: float) -> None:
    """Restart the differences of readings at a reading: moves from earlier ones are meaningless."""
    differences = status.differences
    status.unwrapping.last = differences.last_used = reading
    differences.last_used_at = status.sampling.time
    differences.moved = differences.bent = differences.count = 0.0


@compiled_in_place
def is_false_start(
    sampling: Sampling, differences: Differences, variance: float, reading: float, innovation: float, step: float
) -> bool:
    """Return whether one of the first two readings was an outlier: the next three lie on a line of their own.

    Readings in bunches are excluded, as they imitate lines.
    """
    if sampling.samples != 5.0 or step < 0.5 * sampling.interval:
        return False
    bend = reading - differences.last_used - differences.moved * step / sampling.interval
    return abs(innovation) > FALSE_START * (abs(bend) + math.sqrt(variance))


@compiled_in_place
def is_runaway(gate: Gate, track: Mixture, resolution: float, moved: float, step: float) -> bool:
    """Return whether the estimated speed has long been many times that of the readings, which moved by `moved` [rad].

    No reading would correct it: the readings' variance grows with the speed.
    """
    gate.travel += (abs(moved) - gate.travel) / SETTLING
    runs = track.still == 0.0 and abs(track.speed) * step > RUNAWAY * (gate.travel + resolution)
    gate.runaway = gate.runaway + 1.0 if runs else 0.0
    return gate.runaway > UNCONFIRMED


@compiled_in_place
def is_growing(gate: Gate, innovation: float) -> bool:
    """Return whether an innovation has the sign of the last rejected one and is larger."""
    return innovation * gate.last_innovation >= 0.0 and abs(innovation) > GROWTH * abs(gate.last_innovation)


@compiled_in_place
def is_alike(gate: Gate, innovation: float, used: float) -> bool:
    """Return whether an innovation equals the one just rejected while the gate widens, or undoes the last slip.

    `used`: readings used so far.
    """
    undone = -gate.slip if gate.since_slip < SETTLING else 0.0
    compared = gate.last_innovation if gate.rejected_run > 0.0 else undone
    alike = abs(innovation - compared) < SLIPPED * abs(innovation)
    return alike and used > CLEAN_SAMPLES and not _slipped_before(gate, innovation)


@compiled_in_place
def _slipped_before(gate: Gate, innovation: float) -> bool:
    """Return whether the encoder seemed to slip in the same direction just before."""
    return bool(gate.slip * innovation > 0.0 and gate.since_slip < SLIPS_APART)


@compiled_in_place
def accept_manoeuvre(record: Records, reading: float, innovation: float, step: float, row: FilterRow) -> bool:
    """Accept an innovation outside the gate as a manoeuvre, or reject the reading.

    A manoeuvre lies on a line with the last two rejected innovations, on one side; fewer are enough where `early` or
    `at_once` (see `reconsider`). Equal innovations are a slip of the encoder.
    """
    status: FilterStatus = record[0]
    gate, track, sampling, repeats = status.gate, status.track, status.sampling, status.repeats
    early = gate.rejected_run == 1.0 and gate.clean >= CLEAN_SAMPLES
    at_once = gate.rejected_run == 0.0 and gate.abrupt > 0.0 and track.fastest > 0.0 and repeats.share <= REPEATING
    if early or at_once:
        span, grown, slipped = step, innovation - gate.last_innovation, False
        straight = at_once or is_growing(gate, innovation)
    else:
        span, grown = step + gate.last_rejected_step, innovation - gate.innovation_before
        slipped = abs(grown) < SLIPPED * abs(innovation)
        if slipped and _slipped_before(gate, innovation):  # stamps that lag increasingly: the speed has changed
            slipped, grown, span = False, innovation, gate.since_slip * sampling.interval
            status.noise.additive = max(status.noise.additive, innovation * innovation / 12.0)
        one_side = min(innovation * gate.last_innovation, innovation * gate.innovation_before) > 0.0
        bend = innovation - 2.0 * gate.last_innovation + gate.innovation_before
        on_line = abs(bend) <= 0.5 * max(abs(innovation), abs(gate.innovation_before))
        straight = one_side and on_line and gate.rejected_run >= MAX_OUTLIERS
    too_fast = not slipped and 0.0 < MAX_SPEED_RATIO * track.fastest < abs(track.speed + grown / span)
    if not straight or (too_fast and gate.rejected_run <= MAX_OUTLIERS):
        row.noise = 0.0
        _reject(gate, status.counts, innovation, step)
        none = gate.rejected_run > (MAX_UNCONFIRMED if slipped else MAX_OUTLIERS)
        if none and gate.unconfirmed > MAX_UNCONFIRMED:
            status.counts.losses += 1.0
            initiate(status, step, reading, 0.0 if repeats.run > 0.0 else track.speed, row)
        return False
    if at_once:
        record[1] = record[0]
        _reject(record[1].gate, record[1].counts, innovation, step)
        gate.provisional = 1.0
    elif not slipped:
        learn_abruptness(gate, True)
    gate.clean = 0.5 * CLEAN_SAMPLES if early else gate.clean
    row.cut = STRETCH if slipped else MANOEUVRE
    rate, sigma = 0.0 if slipped else grown / span, math.sqrt(row.noise)  # a slip of the encoder keeps the speed
    by_angle = sigma + RIPPLE_SIZE * abs(innovation)
    by_rate = 0.0 if slipped else (sigma + abs(grown)) / span
    filter_bank.open_manoeuvre(status.bank, row, innovation, rate, by_angle, by_rate, abs(rate) / span)
    row.unit += (RIPPLE_SIZE * innovation) ** 2
    if slipped:
        status.counts.jumps += 1.0
        # Until repetitions of the sensor are known, the moves after them look like slips.
        gate.slip, gate.since_slip = innovation if sampling.used > CLEAN_SAMPLES else 0.0, 0.0
    status.counts.outliers -= gate.rejected_run
    more = UNCONFIRMED if early or at_once else gate.rejected_run
    gate.unconfirmed = max(min(gate.unconfirmed + more, MAX_UNCONFIRMED), UNCONFIRMED)
    return True


@compiled_in_place
def _reject(gate: Gate, counts: Counts, innovation: float, step: float) -> None:
    """Count a rejected reading and store its innovation."""
    gate.innovation_before, gate.last_innovation = gate.last_innovation, innovation
    gate.last_rejected_step = step
    gate.rejected_run += 1.0
    gate.unconfirmed += 1.0
    counts.outliers += 1.0


@compiled_in_place
def learn_abruptness(gate: Gate, manoeuvre: bool) -> None:
    """Update `abrupt` by what was outside the gate: a manoeuvre, or an outlier."""
    gate.abrupt = min(FORGET_ABRUPT * gate.abrupt + (1.0 if manoeuvre else -OUTLIER_WEIGHT), MOST_ABRUPT)


@compiled_in_place
def reconsider(record: Records, raw: float, step: float, gap: bool) -> bool:
    """Return whether the next reading, `raw` before unwrapping, confirms a provisional manoeuvre.

    The manoeuvre stays if the reading is much nearer to it than to the track without it, stored in `record[1]`;
    otherwise that track is restored. After a gap neither track predicts the reading.
    """
    status: FilterStatus = record[0]
    without: FilterStatus = record[1]
    status.gate.provisional = 0.0
    near = abs(_distance(status.unwrapping, status.track, raw, step))
    if not gap and near < NEARER * abs(_distance(without.unwrapping, without.track, raw, step)):
        learn_abruptness(status.gate, True)
        return True
    counts, before = status.counts, without.counts
    before.accepted, before.received, before.not_finite = counts.accepted, counts.received, counts.not_finite
    before.duplicate_stamp, before.older_stamp = counts.duplicate_stamp, counts.older_stamp
    record[0] = record[1]
    return False


@compiled_in_place
def _distance(unwrapping: Unwrapping, track: Mixture, raw: float, step: float) -> float:
    """Return the distance of a reading from the prediction [rad]."""
    innovation, period = raw + unwrapping.slips - predicted_angle(track, step), unwrapping.period
    return float(innovation - period * np.rint(innovation / period) if period > 0.0 else innovation)


@compiled_in_place
def is_predicted(bank: Bank, variance: float, interval: float, step: float, reading: float) -> bool:
    """Return whether the best filter predicts a reading [rad] after a gap of `step` [s]: the track then continues.

    `variance` [rad^2] is the reading's, `interval` [s] the mean one.
    """
    filters, f = bank.filters, bank.models.leading
    m, trial = bank.models.best[f], layout.SMOOTHER
    copy_numbers(filters.clock[:, m], filters.clock[:, trial])
    filters.jerk_strength[trial] = filters.jerk_strength[m]
    time_update(filters, math.sqrt(variance * step / interval**5), step, trial, trial + 1)
    x, g = filters.clock[:, trial], wave_at(bank, f, m, bank.models.second, reading)
    predicted = filters.scale[m] * (variance + x[layout.L20] ** 2 + x[layout.L21] ** 2 + x[layout.L22] ** 2)
    return predicted <= MAX_GAP_SIGMA**2 and (reading + g[0] - x[layout.ANGLE]) ** 2 <= 9.0 * predicted


@compiled_in_place
def bridge_gap(status: FilterStatus, step: float, raw: float, row: FilterRow) -> None:
    """Continue after a gap: keep the ripple, move the angle to the reading, inflate the state's covariance."""
    bank, sampling, track = status.bank, status.sampling, status.track
    reading = unwrap_reading(status.unwrapping, sampling.samples, raw, track.angle + track.speed * step)
    row.unit = measurement_noise.measurement_variance(status.noise, track.speed)
    row.reading, row.cut = reading, STRETCH
    row.noise = row.unit * bank.filters.scale[bank.models.best[bank.models.leading]]
    by_rate = 0.5 * abs(track.speed) + math.sqrt(row.noise) / sampling.interval
    filter_bank.open_manoeuvre(
        bank, row, reading - track.angle, 0.0, RIPPLE_SIZE, by_rate, by_rate / (10.0 * sampling.interval)
    )
    for f in range(layout.MODELS):
        if bank.models.active[f] > 0.0:
            filter_bank.update_filters(bank, f, row.unit, 0.0, track.speed, sampling.move)
    track.angle = reading
    _begin_differences(status, reading)
    sampling.since = status.gate.rejected_run = status.gate.innovation_before = status.gate.last_innovation = 0.0
