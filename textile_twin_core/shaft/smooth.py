"""Fixed-interval smoothing: the whole record, each state seeing the samples before and after it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled, records
from textile_twin_core.shaft.base import PIECE, Parts, Recursion, joined, states_of
from textile_twin_core.shaft.chain import CHAIN, know_ripple, stand
from textile_twin_core.shaft.chain import STEP as ONE_STEP
from textile_twin_core.shaft.families import SEEN_CYCLES
from textile_twin_core.shaft.filter import set_uncertainty
from textile_twin_core.shaft.report import SampleReport
from textile_twin_core.shaft.settings import ShaftSettings
from textile_twin_core.shaft.smoothing import (
    MARK,
    ROUNDS,
    look_back,
    readmit,
    set_clock,
    set_intensities,
    sharpen,
    take_shorter,
    there,
    there_and_back,
)
from textile_twin_core.shaft.states import STATE_WIDTH, ShaftStates
from textile_twin_core.shaft.status import (
    CUT,
    FAMILIES,
    LEAD,
    MEMORY,
    NOISE,
    ORIGIN,
    PHASE,
    READING,
    SPEED,
    STEP,
    THETA,
    TURNS,
    WAVES,
    Record,
    StatusArray,
    new_status,
)
from textile_twin_core.shaft.turns import TURN

LESSONS = 4
"""Times that the teeth's pitch errors are made what the smoothed motion says."""
UNSURE_ROWS, UNSURE_CYCLES = 16, 2.5
"""Beginning of a stretch in which the filter is still finding memory and ripple."""
FEWEST = 4
"""Rows below which a stretch keeps the filter's states."""


class SmoothEstimator:
    """Filters while samples come in and smooths at `finish` (see `smoothing`).

    Args:
        settings: fields of `ShaftSettings`.

    Raises:
        SceneError: a setting of the wrong kind or value.
        TypeError: a setting that does not exist.
    """

    def __init__(self, **settings: Any) -> None:
        self._settings = ShaftSettings(**settings)
        self.reset()

    def reset(self) -> None:
        """Forget everything, the report included."""
        self._recursion = Recursion(self._settings)
        self._blocks: Parts = []
        self._new: Parts = []

    @property
    def report(self) -> SampleReport:
        """Counts of what came in and what became of it."""
        return self._recursion.report()

    def step(
        self, stamps: npt.ArrayLike, angles: npt.ArrayLike, velocities: npt.ArrayLike | None = None
    ) -> ShaftStates:
        """Take a block of samples; no state is ready before `finish`. See `ShaftEstimator.step`."""
        self._new.extend(self._recursion.walk(self._recursion.follow, stamps, angles, velocities))
        if sum(len(rows) for _, rows in self._new) >= PIECE:
            self._blocks.append(joined(self._new))
        return ShaftStates.empty(self._recursion.last)

    def finish(self) -> ShaftStates:
        """The states of all samples from the third on."""
        blocks, self._blocks, self._new = self._blocks + self._new, [], []
        if not blocks:
            return ShaftStates.empty(self._recursion.last)
        stamps, table = joined(blocks)
        self._smooth(table)
        self._recursion.begin_anew()
        return states_of([(stamps, _compact(table))])

    def _smooth(self, table: FloatArray) -> None:
        """Smooth stretch by stretch; with a toothed wheel again, its pitch errors as the smoothed motion tells them."""
        wheel = self._recursion.wheel
        cuts = np.flatnonzero(table[:, CUT] == 1.0).tolist()
        lessons = LESSONS if wheel is not None and wheel.learning else 0
        for lesson in range(lessons + 1):
            for first, end in zip(cuts, [*cuts, len(table)][1:], strict=True):
                if end - first >= FEWEST:
                    _smooth(table[first:end], self._settings, self._recursion.status)
            if wheel is not None and lesson < lessons:
                told = table[:, PHASE] + (table[:, TURNS] - table[:, ORIGIN]) * TURN
                used = table[:, NOISE] > 0.0
                table[:, READING] += wheel.learn(table[:, READING], table[:, READING] - told, used)


def _compact(table: FloatArray) -> FloatArray:
    """The columns that states are made of, in the memory of the whole table: hours of both would be too much."""
    if not table.flags.owndata:
        return table[:, :STATE_WIDTH].copy()
    for first in range(0, len(table), PIECE):
        part = table[first : first + PIECE, :STATE_WIDTH].copy()
        table.reshape(-1)[first * STATE_WIDTH : first * STATE_WIDTH + part.size] = part.reshape(-1)
    table.resize((len(table), STATE_WIDTH), refcheck=False)
    return table


def _smooth(table: FloatArray, settings: ShaftSettings, record: StatusArray) -> None:
    """Smooth one stretch in place, with the ripple that led it for most of the time, as the filter came to know it."""
    count, cycle = len(table), settings.cycle_turns
    lead = table[count // 3 :, LEAD].astype(np.int64)
    family = int(np.bincount(lead, minlength=FAMILIES).argmax())
    if record["travelled"][0, family] < SEEN_CYCLES * cycle * TURN:
        family = 0
    unsure = UNSURE_ROWS
    if family > 0:
        unsure += int(np.argmax(np.abs(table[:, THETA] - table[0, THETA]) > UNSURE_CYCLES * cycle * TURN))
    chain = records(CHAIN)
    chain["lowest"] = 1.0 / cycle
    _smooth_stretch(
        table, record, new_status(settings, 0.0), chain, records(ONE_STEP, MARK), records(ONE_STEP, count // MARK + 1),
        family, unsure, np.empty(count), np.empty(count), np.zeros((count, 2)), np.empty((count + 1, 2)),
    )  # fmt: skip


@compiled
def _smooth_stretch(
    table: FloatArray, record: StatusArray, filters: StatusArray, chains: StatusArray, steps: StatusArray,
    marks: StatusArray, family: int, unsure: int, memory: FloatArray, intensity: FloatArray, jerk: FloatArray,
    sums: FloatArray,
) -> None:  # fmt: skip
    chain, waves, known, plain = chains[0], WAVES[family], MEMORY + family, WAVES[0 * family]
    interval = record[0].interval
    readmit(table)
    for i in range(table.shape[0]):
        memory[i] = table[i, known]
    set_intensities(table, memory, interval, intensity)
    know_ripple(chain, record[0], family)
    set_clock(chain, waves, table)
    _begin(chain, waves, table)
    for i in range(1, table.shape[0]):
        there(chain, steps, plain, table, intensity, i, i + 1)
    look_back(filters[0], chain, table, known, interval, memory)
    take_shorter(table, known, unsure, memory)
    set_intensities(table, memory, interval, intensity)
    for again in range(ROUNDS + 1):
        if again > 0:
            sharpen(table, jerk, interval, intensity, sums)
        _begin(chain, waves, table)
        there_and_back(chain, steps, marks, waves, table, intensity, jerk, again == ROUNDS)


@compiled
def _begin(chain: Record, waves: int, table: FloatArray) -> None:
    """The chain begins at the first row with its reading and the filter's speed."""
    row = table[0]
    set_uncertainty(chain.kinematic, row[SPEED], row[NOISE], table[1, STEP])
    stand(chain, waves, row[READING], row[SPEED], 0.0, chain.kinematic)
