"""Fixed-interval smoothing: the whole record, each state seeing the samples before and after it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.shaft.bank import MEAN, Bank, begin, open_bank
from textile_twin_core.shaft.base import Recursion, Stamps, states_of
from textile_twin_core.shaft.chain import NOW, Chain, chain_room, open_chain
from textile_twin_core.shaft.clock import set_second
from textile_twin_core.shaft.filter import bank_rooms, first_uncertainty
from textile_twin_core.shaft.report import SampleReport
from textile_twin_core.shaft.settings import ShaftSettings
from textile_twin_core.shaft.smoothing import (
    MARK,
    ROUNDS,
    look_back,
    readmit,
    set_intensities,
    sharpen,
    smooth_there_and_back,
    take_shorter,
    there,
)
from textile_twin_core.shaft.states import ShaftStates
from textile_twin_core.shaft.status import (
    CUT,
    LEAD,
    MEMORY,
    NOISE,
    ORDERS,
    ORIGIN,
    PHASE,
    READING,
    SPEED,
    STEP,
    THETA,
    TURNS,
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
        self._blocks: list[tuple[Stamps, FloatArray]] = []

    @property
    def report(self) -> SampleReport:
        """Counts of what came in and what became of it."""
        return self._recursion.report()

    def step(
        self, stamps: npt.ArrayLike, angles: npt.ArrayLike, velocities: npt.ArrayLike | None = None
    ) -> ShaftStates:
        """Take a block of samples; no state is ready before `finish`. See `ShaftEstimator.step`."""
        self._blocks.append(self._recursion.walk(self._recursion.follow, stamps, angles, velocities))
        return ShaftStates.empty(self._recursion.last)

    def finish(self) -> ShaftStates:
        """The states of all samples from the third on."""
        blocks, self._blocks = self._blocks, []
        if not blocks:
            return ShaftStates.empty(self._recursion.last)
        stamps = np.concatenate([block[0] for block in blocks])
        table = np.concatenate([block[1] for block in blocks])
        del blocks
        self._smooth(table)
        self._recursion.begin_anew()
        return states_of(stamps, table)

    def _smooth(self, table: FloatArray) -> None:
        """Smooth stretch by stretch; with a toothed wheel again, its pitch errors as the smoothed motion tells them."""
        wheel, interval = self._recursion.wheel, float(self._recursion.status["interval"][0])
        cuts = np.flatnonzero(table[:, CUT] == 1.0).tolist()
        lessons = LESSONS if wheel is not None and wheel.learning else 0
        for lesson in range(lessons + 1):
            for first, end in zip(cuts, [*cuts, len(table)][1:], strict=True):
                if end - first >= FEWEST:
                    _smooth(table[first:end], self._settings.cycle_turns, interval)
            if wheel is not None and lesson < lessons:
                told = table[:, PHASE] + (table[:, TURNS] - table[:, ORIGIN]) * TURN
                used = table[:, NOISE] > 0.0
                table[:, READING] += wheel.learn(table[:, READING], table[:, READING] - told, used)


def _smooth(table: FloatArray, cycle_turns: int, interval: float) -> None:
    """Smooth one stretch in place, with the ripple that led it for most of the time."""
    count = len(table)
    lead = table[count // 3 :, LEAD].astype(np.int64)
    number = int(np.bincount(lead, minlength=len(ORDERS)).argmax())
    n = 2 * ORDERS[number] + 3
    unsure = UNSURE_ROWS
    if number > 0:
        unsure += int(np.argmax(np.abs(table[:, THETA] - table[0, THETA]) > UNSURE_CYCLES * cycle_turns * TURN))
    _smooth_stretch(
        table, bank_rooms(cycle_turns)[number], chain_room(ORDERS[number], cycle_turns, MARK), number, interval, unsure,
        np.empty(count), np.empty((count, 2)), np.empty((count // MARK + 1, n + n * n)), np.empty((count + 1, 2)),
    )  # fmt: skip


@compiled
def _smooth_stretch(
    table: FloatArray, bank_in: FloatArray, chain_in: FloatArray, number: int, interval: float, unsure: int,
    intensity: FloatArray, jerk: FloatArray, marks: FloatArray, sums: FloatArray,
) -> None:  # fmt: skip
    bank, chain = open_bank(bank_in), open_chain(chain_in)
    readmit(table)
    memory = sums[: table.shape[0], 0].copy()
    memory[:] = table[:, MEMORY + number]
    set_intensities(table, memory, interval, intensity)
    _begin(bank, chain, table)
    for i in range(1, table.shape[0]):
        there(chain, table, intensity, i, i + 1)
    if number > 0:
        set_second(chain.vectors[NOW], 0, chain.head[3], chain.second)
    look_back(bank, number, chain, table, interval, memory)
    take_shorter(table, number, unsure, memory)
    set_intensities(table, memory, interval, intensity)
    for again in range(ROUNDS + 1):
        if again > 0:
            sharpen(table, jerk, interval, intensity, sums)
        _begin(bank, chain, table)
        smooth_there_and_back(chain, table, intensity, jerk, marks, again == ROUNDS)


@compiled
def _begin(bank: Bank, chain: Chain, table: FloatArray) -> None:
    """The chain begins at the first row with its reading and the filter's speed."""
    row = table[0]
    kinematic = first_uncertainty(row[SPEED], row[NOISE], table[1, STEP])
    begin(bank, row[READING], row[SPEED], 0.0, kinematic, 1.0)
    chain.vectors[NOW, :, 0] = bank.states[MEAN, :, 0]
    chain.factor[:, :, 0] = bank.factor[:, :, 0]
