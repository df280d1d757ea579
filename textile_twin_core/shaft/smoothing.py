"""From the filter's rows to smoothed states: one chain, whose ripple is known, there and back."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import by_reference, compiled, records
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.chain import STEP as ONE_STEP
from textile_twin_core.shaft.chain import stand_as, step_there, wave_at, write_down
from textile_twin_core.shaft.filter import put_angle
from textile_twin_core.shaft.intensity import set_intensities, sharpen
from textile_twin_core.shaft.settings import ShaftSettings
from textile_twin_core.shaft.status import Record, Records, new_status
from textile_twin_core.shaft.way_back import BACK, step_back, tell, turn_round

ROUNDS = 2
"""Times that the jerk's intensity is made what the smoothed jerk says."""
MARK = 512
"""Steps between two marks from which the way there is walked again: room for MARK steps is enough."""


@by_reference
class Smoother(NamedTuple):
    """What smoothing works with.

    Attributes:
        filters: (1,) a status, a lane of which is the chain.
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
    intensity = _found_intensities(smoother, rows, status.interval)
    for i in range(1, rows.size):
        step_there(filters, at, rows[i], intensity[i], False)
        if at.trust > 0.0:
            total += 0.5 * (math.log(at.trust) - at.surprise * at.surprise / at.trust)
    return total


@compiled
def smooth_rows(smoother: Smoother, status: Record, rows: Records, first: int, told: int) -> None:
    """Smooth (n,) rows, on the first of which the chain stands; write the states of `first` .. `told` there."""
    intensity = _found_intensities(smoother, rows, status.interval)
    _there_and_back(smoother, rows, intensity, np.zeros((rows.size, 2)), first, told)


@compiled
def _found_intensities(smoother: Smoother, rows: Records, interval: float) -> FloatArray:
    """Intensities (n,) of the white jerk; the chain stands where it stood."""
    intensity, jerk, filters = np.empty(rows.size), np.zeros((rows.size, 2)), smoother.filters[0]
    _readmit(rows)
    for i in range(rows.size):
        rows[i].clock = rows[i].reading + wave_at(filters, rows[i].theta)[0]
    set_intensities(rows, filters.lead, interval, intensity)
    write_down(filters, smoother.steps[MARK])
    for _ in range(ROUNDS):
        _there_and_back(smoother, rows, intensity, jerk, 0, 0)
        sharpen(rows, jerk, interval, intensity)
        stand_as(filters, smoother.steps[MARK])
    return intensity


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
def _there_and_back(
    smoother: Smoother, rows: Records, intensity: FloatArray, jerk: FloatArray, begin: int, told: int
) -> None:
    """Over all rows but the first, where the chain stands; the states of rows `begin` .. `told` are written there."""
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
            if begin <= i <= told:
                tell(filters, back, at, row)
                put_angle(row, row.phase)
            step_back(back, at, row.step, intensity[i], jerk[i], width, owing)
