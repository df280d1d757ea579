"""From the filter's rows to smoothed states: one chain, whose ripple is known, there and back."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import by_reference, compiled, records
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.chain import STAND, STEP, stand_as, step_there, wave_at, write_down
from textile_twin_core.shaft.filter import put_angle
from textile_twin_core.shaft.intensity import set_intensities, sharpen
from textile_twin_core.shaft.settings import ShaftSettings
from textile_twin_core.shaft.status import Record, Records, new_status
from textile_twin_core.shaft.way_back import BACK, step_back, tell, turn_round

ROUNDS = 2
"""Times that the jerk's intensity is made what the smoothed jerk says."""
MARK = 512
"""Steps between two marks from which the way there is walked again: room for where it stood after MARK is enough."""


@by_reference
class Smoother(NamedTuple):
    """What smoothing works with.

    Attributes:
        filters: (1,) a status, a lane of which is the chain.
        back: (1,) the way back of the chain.
        steps: (n,) what its steps left behind.
        stands: (MARK + 1,) where it stood after the last MARK of them, and at the start.
        marks: (n / MARK,) where it stood at every MARK-th row.
    """

    filters: Records
    back: Records
    steps: Records
    stands: Records
    marks: Records


def new_smoother(settings: ShaftSettings, rows: int) -> Smoother:
    """What smoothing so many rows at a time needs."""
    filters = new_status(settings, 0.0)
    filters["weakness"][0, lanes.CHAIN] = 1.0
    marks = records(STAND, rows // MARK + 1)
    return Smoother(filters, records(BACK), records(STEP, rows), records(STAND, MARK + 1), marks)


@compiled
def evidence(smoother: Smoother, status: Record, rows: Records) -> float:
    """Logarithm of the readings' likelihood under the chain, which stands on the first row."""
    filters, at, stand, total = smoother.filters[0], smoother.steps[0], smoother.stands[0], 0.0
    intensity = _found_intensities(smoother, rows, status.interval)
    for i in range(1, rows.size):
        step_there(filters, at, stand, rows[i], intensity[i], False)
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
    write_down(filters, smoother.stands[MARK])
    for _ in range(ROUNDS):
        _there_and_back(smoother, rows, intensity, jerk, 0, 0)
        sharpen(rows, jerk, interval, intensity)
        stand_as(filters, smoother.stands[MARK])
    return intensity


@compiled
def _readmit(rows: Records) -> None:
    """The last two readings set aside before motion was seen are readings again, of a motion that changes fast."""
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
    filters, back, marks = smoother.filters[0], smoother.back[0], smoother.marks
    steps, stands = smoother.steps, smoother.stands
    owing, width, first = told > 0, 2 * lanes.WAVES[filters.lead], 1
    for i in range(1, rows.size):
        if owing and (i - 1) % MARK == 0:
            first = i
            write_down(filters, marks[i // MARK])
        step_there(filters, steps[i], stands[(i - 1) % MARK], rows[i], intensity[i], owing)
    turn_round(back)
    for i in range(rows.size - 1, 0, -1):
        if i < first:
            first -= MARK
            stand_as(filters, marks[first // MARK])
            for k in range(first, first + MARK):
                step_there(filters, steps[k], stands[k - first], rows[k], intensity[k], owing)
        at, stand, row = steps[i], stands[(i - 1) % MARK], rows[i]
        if begin <= i <= told:
            tell(filters, back, stand, row)
            put_angle(row, row.phase)
        step_back(back, at, stand, row.step, intensity[i], jerk[i], width, owing)
