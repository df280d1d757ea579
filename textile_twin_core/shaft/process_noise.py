"""How strong the white jerk of the chain is, row by row: by the memory around it, then by the jerk found."""

from __future__ import annotations

import math

from textile_twin_core.compiling import compiled
from textile_twin_core.shaft.measurement_noise import MOST_CORRELATED
from textile_twin_core.shaft.status import Record, Records

LATE, STEADY = 20.5, 80.0
"""Samples that a filter takes at most to notice a change that matters, but the longer, the longer its memory is than
so many; those that are alike count as one. No whole number: rounding shall not choose where sums of ones end."""
FOUND, WIDEST = 8.0, 512
"""Degrees of freedom that the readings tell of the jerk around a row where it is found, and the most rows that it is
looked for in on either side."""
PRIOR_WEIGHT = 0.5
"""Degrees of freedom that the expectation weighs in this comparison."""
LONGEST, SHORTEST = 0.5 * 2.0**15, 0.25
"""Memories that a chain may have, in samples."""


@compiled
def set_initial_intensities(rows: Records, family: int, interval: float) -> None:
    """Intensity of the white jerk at each row from the family's memory there, as in `bank.predict`.

    The filter notices a change some samples late: the memory is the shortest that it has around the row.
    """
    noise, shortest, oldest, newest, behind, ahead = 0.0, 0, 0, 0, 0.0, 0.0
    for i in range(rows.size):
        if rows[i].noise > 0.0:
            noise = rows[i].noise
        if i > 0:
            behind, ahead = behind + _counts(rows[i], family), ahead - _counts(rows[i], family)
        while newest + 1 < rows.size and ahead < LATE:
            newest += 1
            ahead += _counts(rows[newest], family)
            if rows[newest].memory[family] <= rows[shortest].memory[family]:
                shortest = newest
        while behind > LATE:
            oldest += 1
            behind -= _counts(rows[oldest], family)
        if shortest < oldest:
            shortest = oldest
            for j in range(oldest, newest + 1):
                if rows[j].memory[family] <= rows[shortest].memory[family]:
                    shortest = j
        rows[i].intensity = noise / (math.exp(6.0 * rows[shortest].memory[family]) * interval**5)


@compiled
def _counts(row: Record, family: int) -> float:
    """Part of a sample for which a row counts."""
    return float(1.0 / max(row.correlated, min(math.exp(row.memory[family]) / STEADY, MOST_CORRELATED), 1.0))


@compiled
def adapt_intensities(rows: Records, interval: float) -> None:
    """Make each row's intensity what the smoothed jerk around it says.

    The ratio of the jerk's mean squared to the variance that the readings took away (MacKay 1992) is 1 where the
    intensity is right. Each row's `jerk` becomes the sums of both up to it.
    """
    count, noise, half = rows.size, 0.0, 2
    for i in range(1, count):
        rows[i].jerk[0] += rows[i - 1].jerk[0]
        rows[i].jerk[1] += rows[i - 1].jerk[1]
    for i in range(count):
        if rows[i].noise > 0.0:
            noise = rows[i].noise
        unit = noise / interval**5
        if unit == 0.0 or rows[i].intensity == 0.0:
            continue
        half = max(half - half // 3, 2)
        before, last = max(i - half - 1, 0), min(i + half, count - 1)
        while rows[last].jerk[1] - rows[before].jerk[1] < FOUND and half < min(WIDEST, count):
            half += half // 2
            before, last = max(i - half - 1, 0), min(i + half, count - 1)
        found = rows[last].jerk[0] - rows[before].jerk[0] + PRIOR_WEIGHT
        expected = rows[last].jerk[1] - rows[before].jerk[1] + PRIOR_WEIGHT
        change = min(max(found / expected, 1e-3), 1e3)
        rows[i].intensity = min(max(rows[i].intensity * change, unit / LONGEST**6), unit / SHORTEST**6)
