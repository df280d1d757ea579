"""From the filter's rows to smoothed states: the memory seen from both sides, then one chain there and back."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled, records
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.bank import expect_angle, log_memory, predict, take_angle
from textile_twin_core.shaft.chain import (
    BACK,
    stand_as,
    stand_on,
    step_back,
    step_there,
    tell,
    turn_round,
    wave_at,
    write_down,
)
from textile_twin_core.shaft.chain import STEP as ONE_STEP
from textile_twin_core.shaft.filter import put_angle
from textile_twin_core.shaft.settings import ShaftSettings
from textile_twin_core.shaft.status import Record, Records, new_status

ROUNDS = 1
"""Times that the jerk's intensity is made what the smoothed jerk says."""
CHANGED = 0.2
"""Change of the memory's logarithm from which it is worth to look at it from behind too."""
LATE = 8
"""Samples that a filter takes at most to notice a change that matters."""
WINDOW = 1.0
"""Samples on either side, in memories, over which the jerk is compared with what was expected of it."""
PRIOR_WEIGHT = 0.5
"""Degrees of freedom that the expectation weighs in this comparison."""
LONGEST, SHORTEST = 0.5 * 2.0**15, 0.25
"""Memories that a chain may have, in samples."""
FULLY_LEARNT = 100.0
"""Innovations that the scale of the noise counts as learnt from when filters go back."""
MARK = 512
"""Steps between two marks from which the way there is walked again: room for MARK steps is enough."""


class Smoother(NamedTuple):
    """What smoothing works with.

    Attributes:
        filters: (1,) a status, whose plain family goes back in search of the memory, and a lane of which is the chain.
        back: (1,) the way back of the chain.
        steps: (MARK + 1,) what its steps left behind, and the start.
        marks: (k,) where the chain stood at every MARK-th row.
    """

    filters: Records
    back: Records
    steps: Records
    marks: Records


def new_smoother(settings: ShaftSettings, rows: int) -> Smoother:
    """What smoothing so many rows at a time needs."""
    filters = new_status(settings, 0.0)
    filters["weakness"][0, lanes.CHAIN] = 1.0
    return Smoother(filters, records(BACK), records(ONE_STEP, MARK + 1), records(ONE_STEP, rows // MARK + 1))


@compiled
def evidence(smoother: Smoother, status: Record, rows: Records) -> float:
    """Logarithm of the readings' likelihood under the chain, which stands on the first row."""
    filters, at, total = smoother.filters[0], smoother.steps[0], 0.0
    intensity = np.empty(rows.size)
    _set_clock(filters, rows)
    _find_intensities(smoother, rows, status.interval, 0, intensity)
    for i in range(1, rows.size):
        step_there(filters, at, rows[i], intensity[i], False)
        if at.trust > 0.0:
            total += 0.5 * (math.log(at.trust) - at.surprise * at.surprise / at.trust)
    return total


@compiled
def smooth_rows(smoother: Smoother, status: Record, rows: Records, unsure: int, told: int) -> None:
    """Smooth rows 1 .. `told` of (n,), on the first of which the chain stands; write their states there.

    The filter's memory counts from row `unsure` on.
    """
    intensity, jerk = np.empty(rows.size), np.zeros((rows.size, 2))
    _readmit(rows)
    _set_clock(smoother.filters[0], rows)
    _find_intensities(smoother, rows, status.interval, unsure, intensity)
    for again in range(ROUNDS + 1):
        if again > 0:
            _sharpen(rows, jerk, status.interval, intensity)
            stand_as(smoother.filters[0], smoother.steps[MARK])
        _there_and_back(smoother, rows, intensity, jerk, told if again == ROUNDS else 0)


@compiled
def _find_intensities(smoother: Smoother, rows: Records, interval: float, unsure: int, intensity: FloatArray) -> None:
    """Intensities (n,) of the white jerk by the memory seen from both sides; the chain stands on the first row again.

    Where it stood is kept in the last of the steps.
    """
    filters, start, count = smoother.filters[0], smoother.steps[MARK], rows.size
    memory = np.empty(count)
    shortest = longest = rows[0].memory[filters.lead]
    for i in range(count):
        memory[i] = rows[i].memory[filters.lead]
        shortest, longest = min(shortest, memory[i]), max(longest, memory[i])
    write_down(filters, start)
    if shortest < longest - CHANGED:
        stand_on(filters, rows[count - 1])
        _look_back(filters, rows, interval, memory)
        _take_shorter(rows, filters.lead, unsure, memory)
        stand_as(filters, start)
    _set_intensities(rows, memory, interval, intensity)


@compiled
def _set_clock(filters: Record, rows: Records) -> None:
    """Readings of the clock, from those of the shaft and the chain's ripple."""
    for i in range(rows.size):
        rows[i].clock = rows[i].reading + wave_at(filters, rows[i].theta)[0]


@compiled
def _readmit(rows: Records) -> None:
    """Readings set aside that turned out to be motion are readings again, of a motion that changes fast."""
    for i in range(3, rows.size):
        if rows[i].cut == 2.0:
            for j in range(i - 2, i + 1):
                for f in range(lanes.FAMILIES):
                    rows[j].memory[f] = math.log(0.5)
                rows[j].noise = max(rows[j].noise, rows[i].unit)


@compiled
def _look_back(filters: Record, rows: Records, interval: float, memory: FloatArray) -> None:
    """Log memory (n,) at each row as plain filters find it that run back over the readings of the clock.

    They start from where the chain stands, on the last row. Coming from behind they are forewarned of what the filter
    noticed late.
    """
    last, known, m, total = rows[rows.size - 1], memory[rows.size - 1], lanes.CHAIN, 0.0
    scale = last.noise / last.unit if last.noise > 0.0 else 1.0
    root = math.sqrt(scale)
    for k in range(lanes.END[0]):
        for part in range(9):
            sign = -1.0 if part == lanes.RATE or part == lanes.L10 or part == lanes.L21 else 1.0
            filters.clock[part, k] = sign * filters.clock[part, m] / (root if part >= lanes.L00 else 1.0)
        filters.scale[k], filters.learnt[k], filters.standing[k] = scale, FULLY_LEARNT, 1.0
        filters.probability[k] = 1.0 / (1.0 + (filters.logarithm[k] - known) ** 4)
        total += filters.probability[k]
    for k in range(lanes.END[0]):
        filters.probability[k] /= total
    for i in range(rows.size - 2, -1, -1):
        row = rows[i]
        predict(filters, lanes.PLAIN, rows[i + 1].step, row.unit, interval)
        memory[i] = memory[i + 1]
        if row.noise > 0.0:
            expect_angle(filters, lanes.PLAIN, 0.0, row.clock, 0.0, row.unit)
            take_angle(filters, lanes.PLAIN, row.unit, 0.0)
            memory[i] = log_memory(filters, lanes.PLAIN)


@compiled
def _take_shorter(rows: Records, family: int, unsure: int, memory: FloatArray) -> None:
    """Let each row's log memory be the shortest of what filter and way back, `memory`, find around it.

    Both notice a change some samples late, each on its side of it. The filter counts where it was sure: from row
    `unsure` on.
    """
    for i in range(rows.size - 1, -1, -1):
        shortest = memory[i]
        for j in range(max(i - LATE, 0), i):
            shortest = min(shortest, memory[j])
        for j in range(max(i, unsure), min(i + LATE + 1, rows.size)):
            shortest = min(shortest, rows[j].memory[family])
        memory[i] = shortest


@compiled
def _set_intensities(rows: Records, memory: FloatArray, interval: float, intensity: FloatArray) -> None:
    """Intensity of the white jerk at each row from the log memory there, as in `bank.predict`."""
    noise = 0.0
    for i in range(rows.size):
        if rows[i].noise > 0.0:
            noise = rows[i].noise
        intensity[i] = noise / (math.exp(6.0 * memory[i]) * interval**5)


@compiled
def _sharpen(rows: Records, jerk: FloatArray, interval: float, intensity: FloatArray) -> None:
    """Make each row's intensity what the smoothed jerk around it says.

    The ratio of the jerk's mean squared to the variance that the readings took away (MacKay 1992) is 1 where the
    intensity is right. `jerk` (n, 2) as `chain.step_back` gives it; it becomes the sums up to each row.
    """
    count, noise = rows.size, 0.0
    for i in range(1, count):
        jerk[i, 0] += jerk[i - 1, 0]
        jerk[i, 1] += jerk[i - 1, 1]
    for i in range(count):
        if rows[i].noise > 0.0:
            noise = rows[i].noise
        unit = noise / interval**5
        if unit == 0.0 or intensity[i] == 0.0:
            continue
        half = int(min(max(WINDOW * (unit / intensity[i]) ** (1.0 / 6.0), 2.0), float(count)))
        before, last = max(i - half - 1, 0), min(i + half, count - 1)
        found = jerk[last, 0] - jerk[before, 0] + PRIOR_WEIGHT
        expected = jerk[last, 1] - jerk[before, 1] + PRIOR_WEIGHT
        change = min(max(found / expected, 1e-3), 1e3)
        intensity[i] = min(max(intensity[i] * change, unit / LONGEST**6), unit / SHORTEST**6)


@compiled
def _there_and_back(smoother: Smoother, rows: Records, intensity: FloatArray, jerk: FloatArray, told: int) -> None:
    """Over all rows but the first, where the chain stands; the states of rows 1 .. `told` are written there."""
    filters, back, steps, marks = smoother.filters[0], smoother.back[0], smoother.steps, smoother.marks
    count, owing, width = rows.size, told > 0, 2 * lanes.WAVES[filters.lead]
    pieces = (count - 2) // MARK + 1
    for k in range(pieces):
        write_down(filters, marks[k])
        for i in range(1 + k * MARK, min(1 + (k + 1) * MARK, count)):
            step_there(filters, steps[i - 1 - k * MARK], rows[i], intensity[i], owing)
    turn_round(back)
    for k in range(pieces - 1, -1, -1):
        first, end = 1 + k * MARK, min(1 + (k + 1) * MARK, count)
        if k < pieces - 1:
            stand_as(filters, marks[k])
            for i in range(first, end):
                step_there(filters, steps[i - first], rows[i], intensity[i], owing)
        for i in range(end - 1, first - 1, -1):
            at, row = steps[i - first], rows[i]
            if i <= told:
                tell(filters, back, at, row)
                put_angle(row, row.phase)
            step_back(back, at, row.step, intensity[i], jerk[i], width, owing)
