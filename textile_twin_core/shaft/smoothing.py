"""From the filter's table to smoothed states: the memory seen from both sides, then one chain there and back."""

from __future__ import annotations

import math

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.shaft.bank import (
    LEARNT,
    LOG_MEMORY,
    MEAN,
    PROBABILITY,
    SCALE,
    STANDING,
    Bank,
    expect_angle,
    predict,
    take_angle,
)
from textile_twin_core.shaft.bank import MEMORY as OF_MODEL
from textile_twin_core.shaft.chain import NOW, Chain, step_back, step_on, tell, turn_round
from textile_twin_core.shaft.filter import put_angle
from textile_twin_core.shaft.status import (
    COVARIANCE,
    CUT,
    MEMORY,
    NOISE,
    PHASE,
    READING,
    STEP,
    THETA,
    UNIT,
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
"""Innovations that the scale of the noise counts as learnt from when a bank goes back."""
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
def look_back(bank: Bank, number: int, chain: Chain, table: FloatArray, interval: float, memory: FloatArray) -> None:
    """Log memory (n,) at each row as a bank finds it that runs back, from where the chain arrived at the last row.

    Coming from behind it is forewarned of what the filter noticed late.
    """
    n, models = bank.states.shape[1], bank.models
    count = table.shape[0]
    last = table[count - 1]
    scale = last[NOISE] / last[UNIT] if last[NOISE] > 0.0 else 1.0
    total = 0.0
    for m in range(models.shape[1]):
        bank.states[MEAN, :, m] = chain.vectors[NOW, :, 0]
        bank.factor[:, :, m] = chain.factor[:, :, 0] / math.sqrt(scale)
        bank.states[MEAN, n - 2, m] *= -1.0
        bank.factor[:, n - 2, m] *= -1.0
        models[SCALE, m], models[LEARNT, m], models[STANDING, m] = scale, FULLY_LEARNT, 1.0
        away = math.log(models[OF_MODEL, m]) - last[MEMORY + number]
        models[PROBABILITY, m] = 1.0 / (1.0 + away**4)
        total += models[PROBABILITY, m]
    for m in range(models.shape[1]):
        models[PROBABILITY, m] /= total
    bank.second[:] = chain.second
    memory[count - 1] = last[MEMORY + number]
    for back in range(1, count):
        i = count - 1 - back
        predict(bank, table[i + 1, STEP], table[i, UNIT], interval)
        if table[i, NOISE] > 0.0:
            expect_angle(bank, table[i, READING], table[i, THETA], table[i, UNIT])
            take_angle(bank, table[i, UNIT], 0.0, False)
            memory[i] = bank.head[LOG_MEMORY]
        else:
            memory[i] = memory[i + 1]


@compiled
def take_shorter(table: FloatArray, number: int, unsure: int, memory: FloatArray) -> None:
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
            shortest = min(shortest, table[j, MEMORY + number])
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
def there(chain: Chain, table: FloatArray, intensity: FloatArray, first: int, end: int) -> None:
    """Walk rows first .. end - 1; step s is row first + s."""
    for i in range(first, end):
        step_on(chain, i - first, table[i, STEP], intensity[i], table[i, READING], table[i, THETA], table[i, NOISE])


@compiled
def back(chain: Chain, table: FloatArray, first: int, end: int, told: int, jerk: FloatArray) -> None:
    """Walk back over rows end - 1 .. first, as `there` came; the states of those before `told` are written there."""
    for again in range(end - first):
        i = end - 1 - again
        if i < told:
            row = table[i]
            tell(chain, i - first, row[THETA], row[PHASE : PHASE + 3], row[COVARIANCE : COVARIANCE + 9])
            put_angle(row, row[PHASE])
        step_back(chain, i - first, jerk[i])


@compiled
def smooth_there_and_back(
    chain: Chain, table: FloatArray, intensity: FloatArray, jerk: FloatArray, marks: FloatArray, write: bool
) -> None:
    """Over all rows but the first, where the chain stands; the states are written into the table if wanted.

    `marks` (k, n + n n) is room for the chain at every MARK-th row.
    """
    count, n = table.shape[0], chain.back.shape[0]
    pieces = (count - 1 + MARK - 1) // MARK
    for k in range(pieces):
        marks[k, :n] = chain.vectors[NOW, :, 0]
        marks[k, n:] = chain.factor[:, :, 0].copy().reshape(n * n)
        there(chain, table, intensity, 1 + k * MARK, min(1 + (k + 1) * MARK, count))
    turn_round(chain)
    for again in range(pieces):
        k = pieces - 1 - again
        first, end = 1 + k * MARK, min(1 + (k + 1) * MARK, count)
        if k < pieces - 1:
            chain.vectors[NOW, :, 0] = marks[k, :n]
            chain.factor[:, :, 0] = marks[k, n:].copy().reshape((n, n))
            there(chain, table, intensity, first, end)
        back(chain, table, first, end, end if write else 0, jerk)
