"""Rauch-Tung-Striebel (1965) smoother over rows of readings whose ripple is known, in square-root form.

Let L, L- and S be the factors of the filtered, the predicted and the next smoothed covariance, G that of the process
noise and F the transition over a step, with x, x- and x+ the states. With K = L-^-1 F L, M = L-^-1 G, W = L-^-1 S and
d = L-^-1 (x+ - x-) the smoothed factor is L times that of [K'K - I, K'M, K'W], positive by form, the smoothed state
x + L K'd, and M'd the smoothed normalised jerk.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import by_reference, compiled_in_place
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.bank import set_basis_at
from textile_twin_core.shaft.clock import add_spread, copy_numbers, dot, shaft_state, wave
from textile_twin_core.shaft.filter import put_angle
from textile_twin_core.shaft.gating import set_start
from textile_twin_core.shaft.kalman import HALF_JERK, LAST_JERK, ROBUST, innovate, measurement_update, time_update
from textile_twin_core.shaft.mixture import add_ripple_covariance
from textile_twin_core.shaft.process_noise import adapt_intensities, set_initial_intensities
from textile_twin_core.shaft.residual_orders import add_systematic
from textile_twin_core.shaft.ripple import set_sensitivity
from textile_twin_core.shaft.settings import ShaftSettings
from textile_twin_core.shaft.status import MANOEUVRE, Record, Records, new_status

FAR, SURELY_FAR = 9.0, 1e4  # squared distance from the bank's angle that is far, in its variances; without a reading
MOST_PASSES = 3
BURST, NEARER = 10, 0.25  # rows after a manoeuvre in which it is taken back, by a reading so much nearer to the motion
FAR_OFF = 10.0  # times too weak that some process noise was: smoothing begins again


@by_reference
class Smoother(NamedTuple):
    """Arrays of a smoothing pass over n rows."""

    filters: Records  # (1,) a status, of which lane CHAIN is the filter
    filtered: FloatArray  # (n, 9) its filtered state and factor at each row
    smoothed: FloatArray  # (9,) smoothed state and factor in the backward pass
    whitened: FloatArray  # (3, 10) K, M, W, d
    product: FloatArray  # (3, 10) [K'K - I, K'M, K'W, K'd]


def new_smoother(settings: ShaftSettings, rows: int) -> Smoother:
    """Arrays for passes over at most so many rows."""
    filters = new_status(settings, 0.0)
    filters["scale"][0, lanes.CHAIN] = 1.0
    return Smoother(filters, np.zeros((rows, 9)), np.zeros(9), np.zeros((3, 10)), np.zeros((3, 10)))


@compiled_in_place
def set_ripple(filters: Record, status: Record, family: int) -> None:
    """Copy the ripple of a family's best filter, the covariance factor of its coefficients in radians."""
    lane, width = status.best[family], 2 * status.waves[family]
    root = math.sqrt(status.scale[lane])
    filters.leading, filters.waves[family] = family, status.waves[family]
    copy_numbers(status.second[family], filters.second[family])
    copy_numbers(status.shaft_second[family], filters.shaft_second[family])
    for i in range(width):
        filters.ripple[i, lanes.CHAIN] = status.ripple[i, lane]
        for j in range(i + 1):
            filters.factor[j, i, lanes.CHAIN] = status.factor[j, i, lane] * root


@compiled_in_place
def begin_at_state(filters: Record, theta: float, omega: float, alpha: float, added: FloatArray) -> None:
    """Initial clock state from the shaft's; `filters.start[3:]` is already the initial covariance's factor.

    `added` (.) is `shaft_second`, or `second` where the angle is a reading.
    """
    g = _wave_at(filters, theta, added)
    filters.start[lanes.ANGLE] = theta + g[0]
    filters.start[lanes.RATE] = omega * (1.0 + g[1])
    filters.start[lanes.ACCELERATION] = alpha * (1.0 + g[1]) + omega * omega * g[2]


@compiled_in_place
def begin_at_row(filters: Record, row: Record) -> None:
    """Initial state and covariance factor from the state of a row."""
    start, p = filters.start, row.covariance
    start[lanes.L00] = math.sqrt(p[8])
    start[lanes.L10], start[lanes.L20] = p[5] / start[lanes.L00], p[2] / start[lanes.L00]
    start[lanes.L11] = math.sqrt(max(p[4] - start[lanes.L10] ** 2, 1e-9 * p[4]))
    start[lanes.L21] = (p[1] - start[lanes.L10] * start[lanes.L20]) / start[lanes.L11]
    start[lanes.L22] = math.sqrt(max(p[0] - start[lanes.L20] ** 2 - start[lanes.L21] ** 2, 1e-9 * p[0]))
    begin_at_state(filters, row.theta, row.speed, row.acceleration, filters.shaft_second[filters.leading])


@compiled_in_place
def is_far(filters: Record, row: Record) -> bool:
    """Whether the initial angle is far from the bank's at a row, whose reading, if not set aside, is closer to it."""
    angle = filters.start[lanes.ANGLE] - _wave_at(filters, row.theta, filters.shaft_second[filters.leading])[0]
    squared = (angle - row.theta) ** 2
    closer = abs(row.reading - angle) > 2.0 * abs(row.reading - row.theta)
    return (
        squared > SURELY_FAR * row.covariance[0] if row.noise == 0.0 else squared > FAR * row.covariance[0] and closer
    )


@compiled_in_place
def smooth_family(smoother: Smoother, record: Records, family: int, rows: Records, first: int, last: int) -> float:
    """Smooth (n,) rows under a family's ripple, from the first reading on: rows `first` .. `last` get their states.

    Returns the log-likelihood of all readings but the first, up to a constant.
    """
    filters, start = smoother.filters[0], rows[0]
    set_ripple(filters, record[0], family)
    for i in range(rows.size):
        rows[i].intensity = 0.0
    set_start(filters.start, start.reading, start.speed, start.noise or start.unit, rows[1].step)
    begin_at_state(filters, start.reading, start.speed, 0.0, filters.second[filters.leading])
    smooth(smoother, record[0].interval, rows, 1, 0)
    total = filter_rows(smoother, rows)
    if first <= last:
        smooth_back(smoother, rows, first, last)
    return total


@compiled_in_place
def smooth(smoother: Smoother, interval: float, rows: Records, first: int, last: int) -> None:
    """Smooth (n,) rows from the initial state on: rows `first` .. `last` get their states.

    The process noise of all rows is adapted for the next call; at once where it was far too weak. Readings rejected
    ahead of a detected manoeuvre are used again, with the shortest memory.
    """
    for i in range(3, rows.size):
        if rows[i].cut == MANOEUVRE and not _is_taken_back(rows, i):
            for j in range(i - 2, i + 1):
                if j == i or rows[j].noise == 0.0:
                    rows[j].memory[:] = math.log(0.5)
                    rows[j].noise = max(rows[j].noise, rows[i].unit)
    filters = smoother.filters[0]
    for i in range(rows.size):
        rows[i].clock = rows[i].reading + _wave_at(filters, rows[i].theta, filters.second[filters.leading])[0]
    set_initial_intensities(rows, filters.leading, interval)
    for _ in range(MOST_PASSES):
        filter_rows(smoother, rows)
        smooth_back(smoother, rows, first, last)
        if adapt_intensities(rows, interval) < FAR_OFF:
            break


@compiled_in_place
def _is_taken_back(rows: Records, i: int) -> bool:
    """Whether a manoeuvre at row `i` was a burst of wrong readings: the next one leads back to the motion before it.

    Then all readings between are set aside, and those that were rejected before the way back are used again.
    """
    before, first = rows[i - 3], i - 2
    off = rows[i].reading - _foretold(before, rows[i])
    for k in range(i + 1, min(i + BURST, rows.size)):
        if rows[k].cut == MANOEUVRE and abs(rows[k].reading - _foretold(before, rows[k])) < NEARER * abs(off):
            for j in range(first, k + 1):
                copy_numbers(before.memory, rows[j].memory)
                rows[j].cut = 0.0
                rows[j].noise = max(rows[j].noise, rows[k].unit) if j >= k - 2 else 0.0
            return True
    return False


@compiled_in_place
def _foretold(before: Record, row: Record) -> float:
    """The angle at a row by the state at another."""
    step = row.time - before.time
    return float(before.theta + step * (before.speed + 0.5 * step * before.acceleration))


@compiled_in_place
def filter_rows(smoother: Smoother, rows: Records) -> float:
    """Forward pass over all rows but the first; returns the readings' log-likelihood, up to a constant."""
    filters, m, total = smoother.filters[0], lanes.CHAIN, 0.0
    clock = filters.clock
    copy_numbers(filters.start, clock[:, m])
    copy_numbers(filters.start, smoother.filtered[0])
    for i in range(1, rows.size):
        row = rows[i]
        time_update(filters, math.sqrt(row.intensity * row.step), row.step, m, m + 1)
        if row.noise > 0.0:
            innovate(filters, row.clock, row.noise, m, m + 1)
            if (row.reading - row.theta) ** 2 <= ROBUST * row.noise:  # the bank believed it
                filters.noise_variance[m] = row.noise
            variance = filters.noise_variance[m] + filters.prior_variance[m]
            measurement_update(filters, m, m + 1)
            total -= 0.5 * (math.log(variance) + filters.innovation[m] ** 2 / variance)
        copy_numbers(clock[:, m], smoother.filtered[i])
    return total


@compiled_in_place
def smooth_back(smoother: Smoother, rows: Records, first: int, last: int) -> None:
    """Backward pass: states of rows `first` .. `last`, and of every row the jerk over the step to it.

    Its `jerk` (2,) is the smoothed normalised jerk squared, and by how much the readings reduced its variance.
    """
    filters, filtered, smoothed, m = smoother.filters[0], smoother.filtered, smoother.smoothed, lanes.CHAIN
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
    """Smoothed state and factor before a step from those after it, and the step's jerk."""
    s, A, B, place, half = smoother.smoothed, smoother.whitened, smoother.product, lanes.FACTOR, 0.5 * step * step
    A[0, 1] = A[0, 2] = A[1, 2] = A[0, 4] = A[0, 5] = A[1, 5] = A[0, 7] = A[0, 8] = A[1, 8] = 0.0
    for j in range(3):
        for i in range(j, 3):
            A[i, j], A[i, 6 + j] = filtered[place[i, j]], s[place[i, j]]
        A[2, j] += step * A[1, j] + half * A[0, j]
        A[1, j] += step * A[0, j]
        A[j, 9] = s[j] - predicted[j]
    A[0, 3], A[1, 3], A[2, 3] = strength, 0.5 * strength * step, strength * half / 3.0
    A[1, 4], A[2, 4] = strength * step * HALF_JERK, strength * half * HALF_JERK
    A[2, 5] = strength * step * step * LAST_JERK
    i00, i11, i22 = 1.0 / predicted[lanes.L00], 1.0 / predicted[lanes.L11], 1.0 / predicted[lanes.L22]
    p10, p20, p21 = predicted[lanes.L10], predicted[lanes.L20], predicted[lanes.L21]
    for j in range(10):
        a = A[0, j] * i00
        b = (A[1, j] - p10 * a) * i11
        A[0, j], A[1, j], A[2, j] = a, b, (A[2, j] - p20 * a - p21 * b) * i22
    jerk[0] = jerk[1] = 0.0
    for j in range(3, 6):
        jerk[0] += (A[0, j] * A[0, 9] + A[1, j] * A[1, 9] + A[2, j] * A[2, 9]) ** 2
        for k in range(3):
            jerk[1] += A[k, j] ** 2
            jerk[1] -= (A[0, j] * A[0, 6 + k] + A[1, j] * A[1, 6 + k] + A[2, j] * A[2, 6 + k]) ** 2
    jerk[1] = max(jerk[1], 0.0)
    for i in range(3):
        for j in range(10):
            B[i, j] = A[0, i] * A[0, j] + A[1, i] * A[1, j] + A[2, i] * A[2, j] - (1.0 if i == j else 0.0)
    for i in range(3):  # modified Gram-Schmidt on the rows of B: the triangle takes the place of K
        for k in range(i):
            part = dot(B[i], B[k], 9) / max(dot(B[k], B[k], 9), 1e-300)
            for j in range(9):
                B[i, j] -= part * B[k, j]
            A[i, k] = part * A[k, k]
        A[i, i] = math.sqrt(dot(B[i], B[i], 9))
    for i in range(3):
        s[i] = filtered[i]
        for k in range(i + 1):
            s[i] += filtered[place[i, k]] * B[k, 9]
            s[place[i, k]] = 0.0
            for j in range(k, i + 1):
                s[place[i, k]] += filtered[place[i, j]] * A[j, k]


@compiled_in_place
def _wave_at(filters: Record, theta: float, added: FloatArray) -> tuple[float, float, float, float]:
    """g of the known ripple and its first three derivatives at an angle; `added` (.) is `second` or `shaft_second`."""
    waves = filters.waves[filters.leading]
    set_basis_at(filters, theta, waves)
    return wave(filters.ripple[:, lanes.CHAIN], added, waves, filters.lowest, filters.basis)


@compiled_in_place
def _write_state(smoother: Smoother, row: Record, noise: float) -> None:
    """State and covariance of the shaft from the smoothed clock, the uncertainty of its ripple included.

    An error of the ripple at frequency w makes the smoothed clock follow q / (q + r T w^6) of it (q process noise
    intensity, r measurement noise, T sampling interval); the rest is an error of the state.
    """
    filters, s = smoother.filters[0], smoother.smoothed
    waves, sensitivity = filters.waves[filters.leading], filters.sensitivity
    row.residual = row.clock - s[lanes.ANGLE]
    g = _wave_at(filters, row.theta, filters.shaft_second[filters.leading])
    theta, row.speed, row.acceleration = shaft_state(s[2], s[1], s[0], row.theta, g, filters.slopes)
    set_sensitivity(sensitivity, filters.basis, filters.lowest, row.speed, 2 * waves, lanes.CHAIN, lanes.CHAIN + 1)
    for k in range(2 * waves):
        rejected = noise * row.step * (filters.lowest * (k // 2 + 1) * row.speed) ** 6
        for i in range(3):
            sensitivity[i, k, lanes.CHAIN] *= row.intensity / (row.intensity + rejected)
    row.covariance[:] = 0.0
    add_ripple_covariance(filters, waves, lanes.CHAIN, 1.0, row.covariance)
    add_spread(s, filters.slopes, 1.0, row.covariance)
    add_systematic(row, 1.0)
    put_angle(row, theta)
