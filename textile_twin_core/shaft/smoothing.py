"""From the filter's table to smoothed states: the memory seen from both sides, then one chain there and back."""

from __future__ import annotations

import math

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.shaft.bank import expect_angle, log_memory, predict, take_angle
from textile_twin_core.shaft.chain import (
    carry_sensitivity,
    move_on,
    ripple_at,
    step_back,
    take_clock,
    tell,
    turn_round,
)
from textile_twin_core.shaft.filter import put_angle
from textile_twin_core.shaft.status import (
    CLOCK,
    COVARIANCE,
    CUT,
    END,
    MEMORY,
    NOISE,
    PHASE,
    READING,
    STEP,
    THETA,
    UNIT,
    WIDEST,
    Record,
    StatusArray,
)

ROUNDS = 1
"""Times that the jerk's intensity is made what the smoothed jerk says."""
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
MARK = 256
"""Steps between two marks from which the way there is walked again: room for MARK steps is enough."""


@compiled
def readmit(table: FloatArray) -> None:
    """Readings set aside that turned out to be motion are readings again, of a motion that changes fast."""
    for i in range(3, table.shape[0]):
        if table[i, CUT] == 2.0:
            for j in range(i - 2, i + 1):
                table[j, MEMORY:] = math.log(0.5)
                if table[j, NOISE] == 0.0:
                    table[j, NOISE] = table[i, UNIT]


@compiled
def set_clock(chain: Record, waves: int, table: FloatArray) -> None:
    """Readings of the clock, from those of the shaft and the chain's ripple."""
    for i in range(table.shape[0]):
        table[i, CLOCK] = table[i, READING] + ripple_at(chain, waves, table[i, THETA])


@compiled
def look_back(
    filters: Record, chain: Record, table: FloatArray, known: int, interval: float, memory: FloatArray
) -> None:
    """Log memory (n,) at each row as plain filters find it that run back over the readings of the clock.

    They start from where the chain arrived at the last row, with the memory in column `known` there. Coming from behind
    they are forewarned of what the filter noticed late.
    """
    last = table[table.shape[0] - 1]
    scale = last[NOISE] / last[UNIT] if last[NOISE] > 0.0 else 1.0
    root, total, plain = math.sqrt(scale), 0.0, filters.lead
    mean, factor = chain.state, chain.factor
    for m in range(END[0]):
        filters.clock_acceleration[m], filters.clock_rate[m], filters.clock_angle[m] = mean[0], -mean[1], mean[2]
        filters.l00[m], filters.l10[m], filters.l20[m] = factor[0, 0] / root, -factor[0, 1] / root, factor[0, 2] / root
        filters.l11[m], filters.l21[m], filters.l22[m] = factor[1, 1] / root, -factor[1, 2] / root, factor[2, 2] / root
        filters.scale[m], filters.learnt[m], filters.standing[m] = scale, FULLY_LEARNT, 1.0
        filters.probability[m] = 1.0 / (1.0 + (filters.logarithm[m] - last[known]) ** 4)
        total += filters.probability[m]
    for m in range(END[0]):
        filters.probability[m] /= total
    memory[table.shape[0] - 1] = last[known]
    for back in range(1, table.shape[0]):
        i = table.shape[0] - 1 - back
        predict(filters, plain, table[i + 1, STEP], table[i, UNIT], interval)
        if table[i, NOISE] > 0.0:
            expect_angle(filters, plain, 0.0, table[i, CLOCK], 0.0, table[i, UNIT])
            take_angle(filters, plain, table[i, UNIT], 0.0)
            memory[i] = log_memory(filters, plain)
        else:
            memory[i] = memory[i + 1]


@compiled
def take_shorter(table: FloatArray, known: int, unsure: int, memory: FloatArray) -> None:
    """Let each row's log memory be the shortest of what filter and way back, `memory`, find around it.

    Both notice a change some samples late, each on its side of it. The filter counts where it was sure: from row
    `unsure` on.
    """
    count = table.shape[0]
    for i in range(count - 1, -1, -1):
        shortest = memory[i]
        for j in range(max(i - LATE, 0), i):
            shortest = min(shortest, memory[j])
        for j in range(max(i, unsure), min(i + LATE + 1, count)):
            shortest = min(shortest, table[j, known])
        memory[i] = shortest


@compiled
def set_intensities(table: FloatArray, memory: FloatArray, interval: float, intensity: FloatArray) -> None:
    """Intensity of the white jerk at each row from the log memory there, as in `bank.predict`."""
    noise = 0.0
    for i in range(table.shape[0]):
        if table[i, NOISE] > 0.0:
            noise = table[i, NOISE]
        intensity[i] = noise / (math.exp(6.0 * memory[i]) * interval**5)


@compiled
def sharpen(table: FloatArray, jerk: FloatArray, interval: float, intensity: FloatArray, sums: FloatArray) -> None:
    """Make each row's intensity what the smoothed jerk around it says.

    The ratio of the jerk's mean squared to the variance that the readings took away (MacKay 1992) is 1 where the
    intensity is right. `jerk` (n, 2) as `chain.step_back` gives it; `sums` (n + 1, 2) is room to work in.
    """
    count = table.shape[0]
    sums[0, :] = 0.0
    for i in range(count):
        sums[i + 1, 0] = sums[i, 0] + jerk[i, 0]
        sums[i + 1, 1] = sums[i, 1] + jerk[i, 1]
    noise = 0.0
    for i in range(count):
        if table[i, NOISE] > 0.0:
            noise = table[i, NOISE]
        unit = noise / interval**5
        if unit == 0.0 or intensity[i] == 0.0:
            continue
        half = int(min(max(WINDOW * (unit / intensity[i]) ** (1.0 / 6.0), 2.0), float(count)))
        low, high = max(i - half, 0), min(i + half + 1, count)
        found = sums[high, 0] - sums[low, 0] + PRIOR_WEIGHT
        expected = sums[high, 1] - sums[low, 1] + PRIOR_WEIGHT
        change = min(max(found / expected, 1e-3), 1e3)
        intensity[i] = min(max(intensity[i] * change, unit / LONGEST**6), unit / SHORTEST**6)


@compiled
def there(
    chain: Record, steps: StatusArray, waves: int, table: FloatArray, intensity: FloatArray, first: int, end: int
) -> None:
    """Walk rows first .. end - 1; step s is row first + s. `waves` of 0 leaves out what the states owe to ripple."""
    for i in range(first, end):
        at, row = steps[i - first], table[i]
        move_on(chain, at, row[STEP], intensity[i])
        take_clock(chain, at, row[CLOCK], row[NOISE])
        if waves > 0:
            carry_sensitivity(chain, at, waves, row[STEP], row[THETA])


@compiled
def back(
    chain: Record, steps: StatusArray, waves: int, table: FloatArray, first: int, end: int, told: int, jerk: FloatArray
) -> None:
    """Walk back over rows end - 1 .. first, as `there` came; the states of those before `told` are written there."""
    for again in range(end - first):
        i = end - 1 - again
        at = steps[i - first]
        if i < told:
            row = table[i]
            tell(chain, at, waves, row[THETA], row[PHASE : PHASE + 3], row[COVARIANCE : COVARIANCE + 9])
            put_angle(row, row[PHASE])
        step_back(chain, at, 2 * waves if told > 0 else 0, jerk[i])


@compiled
def stand_as(source: Record, target: Record) -> None:
    """Put a chain where a step stood, or write down where a chain stands."""
    for i in range(3):
        target.state[i] = source.state[i]
        for j in range(3):
            target.factor[j, i] = source.factor[j, i]
        for w in range(WIDEST):
            target.sensitivity[i, w] = source.sensitivity[i, w]


@compiled
def there_and_back(
    chain: Record, steps: StatusArray, marks: StatusArray, waves: int, table: FloatArray, intensity: FloatArray,
    jerk: FloatArray, write: bool,
) -> None:  # fmt: skip
    """Over all rows but the first, where the chain stands; the states are written into the table if wanted.

    `marks` (k,) is room for the chain at every MARK-th row.
    """
    count = table.shape[0]
    pieces, owed = (count - 1 + MARK - 1) // MARK, waves if write else 0
    for k in range(pieces):
        stand_as(chain, marks[k])
        there(chain, steps, owed, table, intensity, 1 + k * MARK, min(1 + (k + 1) * MARK, count))
    turn_round(chain)
    for again in range(pieces):
        k = pieces - 1 - again
        first, end = 1 + k * MARK, min(1 + (k + 1) * MARK, count)
        if k < pieces - 1:
            stand_as(marks[k], chain)
            there(chain, steps, owed, table, intensity, first, end)
        back(chain, steps, waves, table, first, end, end if write else 0, jerk)
