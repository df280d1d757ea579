"""How strong the white jerk of the chain is, row by row: by the memory seen from both sides, then by the jerk found."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.bank import expect_angle, log_memory, predict, take_angle
from textile_twin_core.shaft.chain import stand_as, stand_on, write_down
from textile_twin_core.shaft.status import Record, Records

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


@compiled
def find_intensities(
    filters: Record, start: Record, rows: Records, interval: float, unsure: int, intensity: FloatArray
) -> None:
    """Intensities (n,) of the white jerk by the memory seen from both sides; the chain stands on the first row again.

    Where it stood is written down in `start`. The filter's memory counts from row `unsure` on.
    """
    count = rows.size
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
def sharpen(rows: Records, jerk: FloatArray, interval: float, intensity: FloatArray) -> None:
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
