"""Rauch-Tung-Striebel (1965) smoother over rows of readings with a known ripple, in square-root form.

Let L, L- and S be the factors of the filtered, the predicted and the next smoothed covariance, G that of the process
noise and F the transition over a step, with x, x- and x+ the states. With K = L-^-1 F L, M = L-^-1 G, W = L-^-1 S and
d = L-^-1 (x+ - x-) the smoothed factor is L times that of the sum of squares of K'K - I, K'M and K'W, positive by form,
the smoothed state x + L K'd, and M'd the smoothed normalised jerk.

The intensity of the white jerk follows the filter's memory, then the smoothed jerk (MacKay 1992); the variance of unit
weight follows the residuals (Baarda 1968).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import by_reference, compiled_in_place
from textile_twin_core.shaft import layout
from textile_twin_core.shaft.constants import (
    BOUND,
    BURST,
    CLIP,
    CLIPPED,
    DELAY,
    FAR,
    FAR_OFF,
    FINEST_MOTION,
    HALF_JERK,
    LAST_JERK,
    LEAST_REDUNDANCY,
    LONGEST,
    MOST_CORRELATED,
    MOST_PASSES,
    PRIOR_WEIGHT,
    REVOKED_NEARER,
    ROBUST,
    ROUNDED,
    SCALE_SAMPLES,
    SHORTEST,
    STEADY,
    SURELY_FAR,
    WIDEST_WINDOW,
    WINDOW_FREEDOM,
)
from textile_twin_core.shaft.filter import put_angle
from textile_twin_core.shaft.kalman import innovate, measurement_update, time_update
from textile_twin_core.shaft.outlier_gate import predicted_angle, set_start
from textile_twin_core.shaft.residual_orders import add_systematic
from textile_twin_core.shaft.ripple import (
    add_ripple_covariance,
    add_spread,
    copy_numbers,
    set_sensitivity,
    shaft_state,
    wave_at,
)
from textile_twin_core.shaft.settings import ShaftSettings
from textile_twin_core.shaft.status import MANOEUVRE, STRETCH, Bank, FilterRow, Records, new_bank


@by_reference
class Smoother(NamedTuple):
    """Arrays of a smoothing pass over n rows."""

    bank: Records  # (1,) BANK, of which filter SMOOTHER is used
    filtered: FloatArray  # (n, 9) its filtered state and factor at each row, initial ones at the first
    smoothed: FloatArray  # (9,) smoothed state and factor in the backward pass


def new_smoother(settings: ShaftSettings, rows: int) -> Smoother:
    """Allocate arrays for passes over at most `rows` rows."""
    bank = new_bank(settings)
    bank["filters"]["scale"][0, layout.SMOOTHER] = 1.0
    return Smoother(bank, np.zeros((rows, 9)), np.zeros(9))


@compiled_in_place
def set_ripple(bank: Bank, source: Bank, model: int) -> None:
    """Copy the ripple of a model's best filter, and the covariance factor of its coefficients in radians."""
    index, width = source.models.best[model], 2 * source.models.waves[model]
    root = math.sqrt(source.filters.scale[index])
    bank.models.leading, bank.models.waves[model] = model, source.models.waves[model]
    copy_numbers(source.models.second[model], bank.models.second[model])
    copy_numbers(source.models.shaft_second[model], bank.models.shaft_second[model])
    for i in range(width):
        bank.filters.ripple[i, layout.SMOOTHER] = source.filters.ripple[i, index]
        for j in range(i + 1):
            bank.filters.factor[j, i, layout.SMOOTHER] = source.filters.factor[j, i, index] * root


@compiled_in_place
def begin_at_state(smoother: Smoother, theta: float, omega: float, alpha: float, added: FloatArray) -> None:
    """Set the initial clock state from the shaft's; `filtered[0, 3:]` already holds the initial covariance factor.

    `added` (., .) is `shaft_second`, or `second` where the angle is a reading.
    """
    bank: Bank = smoother.bank[0]
    start = smoother.filtered[0]
    g = wave_at(bank, bank.models.leading, layout.SMOOTHER, added, theta)
    start[layout.ANGLE] = theta + g[0]
    start[layout.RATE] = omega * (1.0 + g[1])
    start[layout.ACCELERATION] = alpha * (1.0 + g[1]) + omega * omega * g[2]


@compiled_in_place
def begin_at_row(smoother: Smoother, row: FilterRow) -> None:
    """Set the initial state and covariance factor from the state of a row."""
    start, p = smoother.filtered[0], row.covariance
    start[layout.L00] = math.sqrt(p[8])
    start[layout.L10], start[layout.L20] = p[5] / start[layout.L00], p[2] / start[layout.L00]
    start[layout.L11] = math.sqrt(max(p[4] - start[layout.L10] ** 2, 1e-9 * p[4]))
    start[layout.L21] = (p[1] - start[layout.L10] * start[layout.L20]) / start[layout.L11]
    start[layout.L22] = math.sqrt(max(p[0] - start[layout.L20] ** 2 - start[layout.L21] ** 2, 1e-9 * p[0]))
    begin_at_state(smoother, row.angle, row.speed, row.acceleration, smoother.bank[0].models.shaft_second)


@compiled_in_place
def is_far(smoother: Smoother, row: FilterRow) -> bool:
    """Return whether the initial angle is far from the bank's at a row, and a used reading is not closer to it."""
    bank: Bank = smoother.bank[0]
    g = wave_at(bank, bank.models.leading, layout.SMOOTHER, bank.models.shaft_second, row.angle)
    angle = smoother.filtered[0, layout.ANGLE] - g[0]
    if row.noise > 0.0 and abs(row.reading - angle) <= 2.0 * abs(row.reading - row.angle):
        return False
    return bool((angle - row.angle) ** 2 > (FAR if row.noise > 0.0 else SURELY_FAR) * row.covariance[0])


@compiled_in_place
def smooth_model(smoother: Smoother, source: Bank, model: int, rows: Records, first: int, last: int) -> float:
    """Smooth (n,) rows with the ripple of a model in the bank `source`, from the first reading on.

    Writes the states of rows `first` .. `last`. Returns the log-likelihood of all readings but the first, up to a
    constant.
    """
    bank: Bank = smoother.bank[0]
    start: FilterRow = rows[0]
    set_ripple(bank, source, model)
    for i in range(rows.size):
        rows[i].intensity = 0.0
    if start.cut == STRETCH:
        begin_at_row(smoother, start)
    else:
        set_start(smoother.filtered[0], start.reading, start.speed, start.noise or start.unit, rows[1].step)
        begin_at_state(smoother, start.reading, start.speed, 0.0, bank.models.second)
    smooth(smoother, rows, 1, 0)
    total = filter_rows(smoother, rows)
    if first <= last:
        smooth_back(smoother, rows, first, last)
    return total


@compiled_in_place
def smooth(smoother: Smoother, rows: Records, first: int, last: int) -> None:
    """Smooth (n,) rows from the initial state on; write the states of rows `first` .. `last`.

    The process noise of all rows is adapted for the next call, and at once where it was far from right. Readings
    rejected before a detected manoeuvre are used again, with the shortest memory.
    """
    for i in range(3, rows.size):
        if rows[i].cut == MANOEUVRE and not _is_taken_back(rows, i):
            for j in range(i - 2, i + 1):
                if j == i or rows[j].noise == 0.0:
                    rows[j].memory[:] = math.log(0.5)
                    rows[j].noise = max(rows[j].noise, rows[i].unit)
    bank: Bank = smoother.bank[0]
    for i in range(rows.size):
        g = wave_at(bank, bank.models.leading, layout.SMOOTHER, bank.models.second, rows[i].angle)
        rows[i].clock = rows[i].reading + g[0]
    set_initial_intensities(rows, bank.models.leading)
    least = 1.0
    for _ in range(MOST_PASSES):
        filter_rows(smoother, rows)
        smooth_back(smoother, rows, first, last)
        if adapt_intensities(rows, least) < FAR_OFF:
            break
        least = FAR_OFF


@compiled_in_place
def _is_taken_back(rows: Records, i: int) -> bool:
    """Return whether a manoeuvre at row `i` was a burst of outliers: the next one leads back to the motion before.

    All readings in between are then rejected, and those rejected before the return are used again.
    """
    before, first = rows[i - 3], i - 2
    innovation = rows[i].reading - predicted_angle(before, rows[i].time - before.time)
    for k in range(i + 1, min(i + BURST, rows.size)):
        innovation_now = rows[k].reading - predicted_angle(before, rows[k].time - before.time)
        if rows[k].cut == MANOEUVRE and abs(innovation_now) < REVOKED_NEARER * abs(innovation):
            for j in range(first, k + 1):
                copy_numbers(before.memory, rows[j].memory)
                rows[j].cut = 0.0
                rows[j].noise = max(rows[j].noise, rows[k].unit) if j >= k - 2 else 0.0
            return True
    return False


@compiled_in_place
def filter_rows(smoother: Smoother, rows: Records) -> float:
    """Forward pass over all rows but the first; returns the readings' log-likelihood, up to a constant."""
    filters, m, total = smoother.bank[0].filters, layout.SMOOTHER, 0.0
    clock = filters.clock
    copy_numbers(smoother.filtered[0], clock[:, m])
    for i in range(1, rows.size):
        row = rows[i]
        time_update(filters, math.sqrt(row.intensity * row.step), row.step, m, m + 1)
        if row.noise > 0.0:
            innovate(filters, row.clock, row.noise, m, m + 1)
            if (row.reading - row.angle) ** 2 <= ROBUST * max(row.noise, row.gate_noise):  # accepted by the bank
                filters.noise_variance[m] = row.noise
            variance = filters.noise_variance[m] + filters.prior_variance[m]
            measurement_update(filters, m, m + 1)
            total -= 0.5 * (math.log(variance) + filters.innovation[m] ** 2 / variance)
        copy_numbers(clock[:, m], smoother.filtered[i])
    return total


@compiled_in_place
def smooth_back(smoother: Smoother, rows: Records, first: int, last: int) -> None:
    """Backward pass: states of rows `first` .. `last`, and of every row the jerk over the step to it.

    `jerk` (2,) of a row becomes the smoothed normalised jerk squared, and the reduction of its variance by the
    readings.
    """
    filters, filtered, smoothed, m = smoother.bank[0].filters, smoother.filtered, smoother.smoothed, layout.SMOOTHER
    noise = rows[0].unit
    copy_numbers(filtered[rows.size - 1], smoothed)
    for i in range(rows.size - 1, 0, -1):
        row = rows[i]
        noise = row.noise if row.noise > 0.0 else noise
        if first <= i <= last:
            _write_state(smoother, row, noise)
        copy_numbers(filtered[i - 1], filters.clock[:, m])
        strength = math.sqrt(row.intensity * row.step)
        time_update(filters, strength, row.step, m, m + 1)
        _step_back(smoother, filters.clock[:, m], filtered[i - 1], row.step, strength, row.jerk)


@compiled_in_place
def _step_back(
    smoother: Smoother, predicted: FloatArray, filtered: FloatArray, step: float, strength: float, jerk: FloatArray
) -> None:
    """Compute smoothed state and factor before a step from those after it, and the step's jerk."""
    s, half = smoother.smoothed, 0.5 * step * step
    f00, f10, f20 = filtered[layout.L00], filtered[layout.L10], filtered[layout.L20]
    f11, f21, f22 = filtered[layout.L11], filtered[layout.L21], filtered[layout.L22]
    for place in (layout.L00, layout.L11, layout.L22):
        predicted[place] = 1.0 / predicted[place]
    k0 = _whitened(predicted, f00, f10 + step * f00, f20 + step * f10 + half * f00)
    k1 = _whitened(predicted, 0.0, f11, f21 + step * f11)
    k2 = _whitened(predicted, 0.0, 0.0, f22)
    m0 = _whitened(predicted, strength, 0.5 * strength * step, strength * half / 3.0)
    m1 = _whitened(predicted, 0.0, strength * step * HALF_JERK, strength * half * HALF_JERK)
    m2 = _whitened(predicted, 0.0, 0.0, strength * step * step * LAST_JERK)
    w0 = _whitened(predicted, s[layout.L00], s[layout.L10], s[layout.L20])
    w1 = _whitened(predicted, 0.0, s[layout.L11], s[layout.L21])
    w2 = _whitened(predicted, 0.0, 0.0, s[layout.L22])
    d = _whitened(predicted, s[0] - predicted[0], s[1] - predicted[1], s[2] - predicted[2])
    jerk[0] = jerk[1] = 0.0
    for m in (m0, m1, m2):
        jerk[0] += _product(m, d) ** 2
        jerk[1] += _product(m, m) - _product(m, w0) ** 2 - _product(m, w1) ** 2 - _product(m, w2) ** 2
    jerk[1] = max(jerk[1], 0.0)
    k10, k20, k21 = _product(k1, k0), _product(k2, k0), _product(k2, k1)
    c = _squares(_product(k0, k0) - 1.0, k10, k20, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    c = _squares(k10, _product(k1, k1) - 1.0, k21, c)
    c = _squares(k20, k21, _product(k2, k2) - 1.0, c)
    for v in (m0, m1, m2, w0, w1, w2):
        c = _squares(_product(k0, v), _product(k1, v), _product(k2, v), c)
    t00 = math.sqrt(c[0])  # its factor, by Cholesky
    t10, t20 = c[1] / t00, c[2] / t00
    t11 = math.sqrt(max(c[3] - t10 * t10, ROUNDED * c[3]))
    t21 = (c[4] - t20 * t10) / t11
    t22 = math.sqrt(max(c[5] - t20 * t20 - t21 * t21, ROUNDED * c[5]))
    by0, by1, by2 = _product(k0, d), _product(k1, d), _product(k2, d)
    s[0] = filtered[0] + f00 * by0
    s[1] = filtered[1] + f10 * by0 + f11 * by1
    s[2] = filtered[2] + f20 * by0 + f21 * by1 + f22 * by2
    s[layout.L00], s[layout.L10], s[layout.L20] = f00 * t00, f10 * t00 + f11 * t10, f20 * t00 + f21 * t10 + f22 * t20
    s[layout.L11], s[layout.L21], s[layout.L22] = f11 * t11, f21 * t11 + f22 * t21, f22 * t22


@compiled_in_place
def _whitened(predicted: FloatArray, a: float, b: float, c: float) -> tuple[float, float, float]:
    """Divide a vector by the factor in `predicted`, whose diagonal is inverted."""
    a *= predicted[layout.L00]
    b = (b - predicted[layout.L10] * a) * predicted[layout.L11]
    return a, b, (c - predicted[layout.L20] * a - predicted[layout.L21] * b) * predicted[layout.L22]


@compiled_in_place
def _product(a: tuple[float, float, float], b: tuple[float, float, float]) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled_in_place
def _squares(a: float, b: float, c: float, sums: tuple[float, ...]) -> tuple[float, ...]:
    """Add the products of three numbers to the lower triangle of their sums, column by column."""
    s00, s10, s20, s11, s21, s22 = sums
    return s00 + a * a, s10 + b * a, s20 + c * a, s11 + b * b, s21 + c * b, s22 + c * c


@compiled_in_place
def _write_state(smoother: Smoother, row: FilterRow, noise: float) -> None:
    """Write state and covariance of the shaft from the smoothed clock, with that of ripple which it does not follow."""
    bank: Bank = smoother.bank[0]
    s = smoother.smoothed
    wave, leading, sensitivity = bank.wave, bank.models.leading, bank.filters.sensitivity
    waves = bank.models.waves[leading]
    row.residual = row.clock - s[layout.ANGLE]
    theta, row.speed, row.acceleration = shaft_state(bank, leading, layout.SMOOTHER, s, row.angle)
    set_sensitivity(sensitivity, wave.basis, wave.lowest, row.speed, 2 * waves, layout.SMOOTHER, layout.SMOOTHER + 1)
    for k in range(2 * waves):
        rejected = noise * row.step * (wave.lowest * (k // 2 + 1) * row.speed) ** 6
        for i in range(3):
            sensitivity[i, k, layout.SMOOTHER] *= row.intensity / (row.intensity + rejected)
    row.covariance[:] = 0.0
    add_ripple_covariance(bank, waves, layout.SMOOTHER, 1.0, row.covariance)
    add_spread(s, wave.slopes, bank.filters.scale[layout.SMOOTHER], row.covariance)
    add_systematic(row, 1.0)
    put_angle(row, theta)


@compiled_in_place
def set_initial_intensities(rows: Records, model: int) -> None:
    """Raise each row's intensity [rad^2/s^5] to r / (N^6 T^5), N the model's memory there (see `filter_bank`).

    A filter detects a change some samples late, later with a longer memory. N is therefore the shortest memory within
    that delay ahead, and within the shortest delay behind.
    """
    noise, shortest, oldest, newest, behind, ahead = rows[0].unit, 0, 0, 0, 0.0, 0.0
    for i in range(rows.size):
        if rows[i].noise > 0.0:
            noise = rows[i].noise
        if i > 0:
            behind += 1.0 / max(rows[i].correlated, 1.0)
            ahead -= _independent(rows[i], model)
        while newest + 1 < rows.size and ahead < DELAY:
            newest += 1
            ahead += _independent(rows[newest], model)
            if rows[newest].memory[model] <= rows[shortest].memory[model]:
                shortest = newest
        while behind > DELAY:
            oldest += 1
            behind -= 1.0 / max(rows[oldest].correlated, 1.0)
        if shortest < oldest:
            shortest = oldest
            for j in range(oldest, newest + 1):
                if rows[j].memory[model] <= rows[shortest].memory[model]:
                    shortest = j
        expected = max(noise, FINEST_MOTION) / (math.exp(6.0 * rows[shortest].memory[model]) * rows[i].interval ** 5)
        rows[i].intensity = max(rows[i].intensity, expected)


@compiled_in_place
def _independent(row: FilterRow, model: int) -> float:
    """Return the number of independent samples that a row counts for, at most 1."""
    return float(1.0 / max(row.correlated, min(math.exp(row.memory[model]) / STEADY, MOST_CORRELATED), 1.0))


@compiled_in_place
def adapt_intensities(rows: Records, least: float) -> float:
    """Scale each row's intensity by the smoothed jerk's mean square over its expectation, in a window around the row.

    The expectation is the variance that the measurements removed (MacKay 1992): the ratio is 1 where the intensity is
    right. Changes by less than the factor `least` are not made. `jerk` (2,) of each row becomes the sums of both up to
    it. Returns the factor of the largest change.
    """
    count, noise, half, largest = rows.size, rows[0].unit, 2, 1.0
    rows[0].jerk[0] = rows[0].jerk[1] = 0.0
    for i in range(1, count):
        rows[i].jerk[0] += rows[i - 1].jerk[0]
        rows[i].jerk[1] += rows[i - 1].jerk[1]
    for i in range(count):
        if rows[i].noise > 0.0:
            noise = rows[i].noise
        unit = max(noise, FINEST_MOTION) / rows[i].interval ** 5
        half = max(half - half // 3, 2)
        before, last = max(i - half - 1, 0), min(i + half, count - 1)
        while rows[last].jerk[1] - rows[before].jerk[1] < WINDOW_FREEDOM and half < min(WIDEST_WINDOW, count):
            half += half // 2
            before, last = max(i - half - 1, 0), min(i + half, count - 1)
        found = rows[last].jerk[0] - rows[before].jerk[0] + PRIOR_WEIGHT
        expected = rows[last].jerk[1] - rows[before].jerk[1] + PRIOR_WEIGHT
        change = min(max(found / expected, 1e-3), 1e3)
        if max(change, 1.0 / change) < least:
            continue
        largest = max(largest, change, 1.0 / change)
        rows[i].intensity = min(max(rows[i].intensity * change, unit / LONGEST**6), unit / SHORTEST**6)
    return largest


@compiled_in_place
def _weigh_residual(weight: FloatArray, row: FilterRow) -> float:
    """Update `weight` (2,), the factor and its redundancy, with a smoothed row's residual; return the factor."""
    if row.noise > 0.0 and row.residual != 0.0 and abs(row.speed) * row.step > 3.0 * math.sqrt(row.noise):
        redundancy = max(1.0 - (row.covariance[0] - row.systematic[0]) / row.noise, LEAST_REDUNDANCY)
        found = min(row.residual * row.residual / (row.noise * redundancy), CLIP * weight[0]) / CLIPPED
        weight[1] = min(weight[1] + redundancy, SCALE_SAMPLES)
        weight[0] += redundancy / weight[1] * (found - weight[0])
        weight[0] = min(max(weight[0], 1.0 / BOUND), BOUND)
    return float(weight[0])


@compiled_in_place
def scale_covariances(weight: FloatArray, rows: Records) -> None:
    """Multiply the covariances of smoothed rows by the current factor, except the part that no residual shows.

    `weight` (2,) starts as FIRST_WEIGHT.
    """
    for k in range(rows.size):
        factor = _weigh_residual(weight, rows[k])
        for i in range(9):
            rows[k].covariance[i] *= factor
        add_systematic(rows[k], 1.0 - factor)


def adopt_weight(record: Records, weight: FloatArray) -> None:
    """Scale the estimated jitter of the stamps by the factor from the residuals of a whole record."""
    if record["noise"]["jitter_configured"][0] == 0.0:
        record["noise"]["jitter"] *= weight[0]
