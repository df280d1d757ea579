"""Process noise of the smoother: intensity of the white jerk by row, from filter memory, then from smoothed jerk."""

from __future__ import annotations

import math

from textile_twin_core.compiling import compiled_in_place
from textile_twin_core.shaft.constants import (
    DELAY,
    FINEST_MOTION,
    LONGEST,
    MOST_CORRELATED,
    PRIOR_WEIGHT,
    SHORTEST,
    STEADY,
    WIDEST_WINDOW,
    WINDOW_FREEDOM,
)
from textile_twin_core.shaft.status import FilterRow, Records


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
