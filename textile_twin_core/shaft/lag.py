"""Fixed lag: each state considers all samples up to a time after its own."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.compiling import compiled
from textile_twin_core.shaft.bank import BEST, MEAN, SCALE, open_bank
from textile_twin_core.shaft.base import Recursion, Stamps, states_of
from textile_twin_core.shaft.chain import NOW, Chain, chain_room, open_chain, stand_at, turn_round
from textile_twin_core.shaft.clock import set_second
from textile_twin_core.shaft.filter import Banks, Rooms, bank_rooms, open_banks, take
from textile_twin_core.shaft.gate import admit
from textile_twin_core.shaft.report import SampleReport
from textile_twin_core.shaft.settings import ShaftSettings, require_positive
from textile_twin_core.shaft.smoothing import (
    ROUNDS,
    back,
    look_back,
    readmit,
    set_intensities,
    sharpen,
    take_shorter,
    there,
)
from textile_twin_core.shaft.states import ShaftStates
from textile_twin_core.shaft.status import CUT, LEAD, MEMORY, NOISE, ORDERS, READING, SETTLED, TIME, WIDTH, StatusArray

MOST_ROWS = 1024
"""Samples that may be held; a longer lag at a high rate is cut to what fits."""
BATCH = 3
"""Samples within a lag that become ready at once, one part in so many: the way back is shared by them."""

HELD = np.dtype([(name, np.float64) for name in ("lag", "rows", "number", "heir", "heir_row")])
"""Lag [s]; rows held, of which the first is where the chain stands; number of the chain's bank; that of the next
chain, or -1; its row.
"""


class LagEstimator:
    """Filters, and smooths over a window of the lag (see `smoothing`); states become ready up to a third of it later.

    Args:
        shaft_lag_s: the lag [s].
        settings: fields of `ShaftSettings`.

    Raises:
        SceneError: a lag that is not positive, or a setting of the wrong kind or value.
        TypeError: a setting that does not exist.
    """

    def __init__(self, *, shaft_lag_s: float = 0.04, **settings: Any) -> None:
        require_positive("shaft_lag_s", shaft_lag_s)
        self._lag = float(shaft_lag_s)
        self._settings = ShaftSettings(**settings)
        self.reset()

    def reset(self) -> None:
        """Forget everything, the report included."""
        self._recursion = Recursion(self._settings)
        self._begin()

    def _begin(self) -> None:
        cycle = self._settings.cycle_turns
        self._held = np.zeros(1, HELD)
        self._held["lag"], self._held["heir"] = self._lag, -1.0
        self._window = np.zeros((MOST_ROWS, WIDTH))
        plain, few, some, many = (chain_room(waves, cycle, MOST_ROWS) for waves in ORDERS)
        self._chains: Rooms = (plain, few, some, many)
        plain, few, some, many = (chain_room(waves, cycle, 1) for waves in ORDERS)
        self._heirs: Rooms = (plain, few, some, many)
        self._spare = bank_rooms(cycle)
        self._window_stamps: Stamps = np.zeros(MOST_ROWS, np.int64)

    @property
    def report(self) -> SampleReport:
        """Counts of what came in and what became of it."""
        return self._recursion.report()

    def step(
        self, stamps: npt.ArrayLike, angles: npt.ArrayLike, velocities: npt.ArrayLike | None = None
    ) -> ShaftStates:
        """Take a block of samples; the states that are ready. See `ShaftEstimator.step`."""
        return states_of(*self._recursion.walk(self._walk, stamps, angles, velocities))

    def _walk(
        self, stamps: Stamps, angles: FloatArray, velocities: FloatArray, heard: FloatArray
    ) -> tuple[Stamps, FloatArray]:
        own = self._recursion
        if self._window_stamps.dtype != stamps.dtype:
            self._window_stamps = np.zeros(MOST_ROWS, stamps.dtype)
        room = int(self._held["rows"][0]) + stamps.size
        ready, table = np.empty(room, stamps.dtype), np.empty((room, WIDTH))
        count = _follow(
            own.status, own.rooms, own.last, stamps, angles, velocities, heard, self._held, self._window,
            self._window_stamps,
            self._chains, self._heirs, self._spare, ready, table,
        )  # fmt: skip
        return ready[:count], table[:count]

    def finish(self) -> ShaftStates:
        """The states still held; then the estimator begins anew, but for the report and the newest stamp."""
        count = int(self._held["rows"][0])
        ready, table = np.empty(count, self._window_stamps.dtype), np.empty((count, WIDTH))
        count = _flush(
            self._held, self._window, self._window_stamps, self._chains, self._heirs, self._spare,
            float(self._recursion.status["interval"][0]), ready, table, 0,
        )  # fmt: skip
        self._recursion.begin_anew()
        self._begin()
        return states_of(ready[:count], table[:count])


@compiled
def _follow(
    record: StatusArray, rooms: Rooms, last: FloatArray | IntArray, stamps: FloatArray | IntArray, angles: FloatArray,
    velocities: FloatArray, heard: FloatArray, held: StatusArray, window: FloatArray, window_stamps: FloatArray |
    IntArray, chains: Rooms,
    heirs: Rooms, spare: Rooms, ready: FloatArray | IntArray, table: FloatArray,
) -> int:  # fmt: skip
    """As `filter.follow`; the rows of the states that are ready go to `table`, their stamps to `ready`."""
    banks, state = open_banks(rooms), held[0]
    count = 0
    heard[:] = math.nan
    for i in range(stamps.size):
        if not admit(record, last, stamps[i], angles[i]):
            continue
        velocity = velocities[i] if velocities.size > 0 else math.nan
        at = int(state.rows)
        row = window[at]
        take(record, banks, (stamps[i] - last[0]) * record[0].unit, angles[i], velocity, row)
        last[0] = stamps[i]
        if row[NOISE] > 0.0:
            heard[i] = row[READING]
        if record[0].samples == 1.0:
            continue
        window_stamps[at] = stamps[i]
        if row[CUT] == 1.0:
            count = _flush(
                held, window, window_stamps, chains, heirs, spare, record[0].interval, ready, table, count
            )  # fmt: skip
            window[0], window_stamps[0], state.rows = row.copy(), stamps[i], 1.0
            state.number, state.heir = row[LEAD], -1.0
            _stand(record, banks, open_chain(chains[int(state.number)]))
            if row[SETTLED] >= 0.0:
                table[count], ready[count] = row, stamps[i]
                count += 1
            continue
        state.rows += 1.0
        if row[LEAD] == state.number:
            state.heir = -1.0
        elif row[LEAD] != state.heir:
            state.heir, state.heir_row = row[LEAD], float(at)
            _stand(record, banks, open_chain(heirs[int(state.heir)]))
        due = 0
        while due < at and row[TIME] - window[due + 1, TIME] >= state.lag:
            due += 1
        if due > 0 and (due >= (at - due) // BATCH or at == MOST_ROWS - 1):
            count = _release(
                held, due, window, window_stamps, chains, heirs, spare, record[0].interval, ready, table, count
            )  # fmt: skip
    return count


@compiled
def _stand(record: StatusArray, banks: Banks, chain: Chain) -> None:
    """Put a chain where the leading model stands."""
    status = record[0]
    bank = banks[int(status.lead_bank)]
    m = int(bank.head[BEST])
    chain.vectors[NOW, :, 0] = bank.states[MEAN, :, m]
    chain.factor[:, :, 0] = bank.factor[:, :, m] * math.sqrt(bank.models[SCALE, m])
    chain.second[:] = bank.second


@compiled
def _flush(
    held: StatusArray, window: FloatArray, window_stamps: FloatArray | IntArray, chains: Rooms, heirs: Rooms,
    spare: Rooms, interval: float, ready: FloatArray | IntArray, table: FloatArray, count: int,
) -> int:  # fmt: skip
    """Let go of all rows held: nothing more will be learnt of them."""
    while held[0].rows > 1.0:
        due = int(held[0].rows) - 1
        count = _release(
            held, due, window, window_stamps, chains, heirs, spare, interval, ready, table, count
        )  # fmt: skip
    return count


@compiled
def _release(
    held: StatusArray, due: int, window: FloatArray, window_stamps: FloatArray | IntArray, chains: Rooms, heirs: Rooms,
    spare: Rooms, interval: float, ready: FloatArray | IntArray, table: FloatArray, count: int,
) -> int:  # fmt: skip
    """Smooth the window and let go of the `due` rows after the first; those up to where an heir stands, if sooner."""
    state = held[0]
    number, rows = int(state.number), int(state.rows)
    succeeds = state.heir >= 0.0 and state.heir_row <= due
    if succeeds:
        due = int(state.heir_row)
    bank, chain, seen = open_bank(spare[number]), open_chain(chains[number]), window[:rows]
    memory, intensity, jerk, sums = np.empty(rows), np.empty(rows), np.zeros((rows, 2)), np.empty((rows + 1, 2))
    mean, factor = chain.vectors[NOW].copy(), chain.factor.copy()
    readmit(seen)
    memory[:] = seen[:, MEMORY + number]
    set_intensities(seen, memory, interval, intensity)
    there(chain, seen, intensity, 1, rows)
    look_back(bank, number, chain, seen, interval, memory)
    take_shorter(seen, number, 0, memory)
    set_intensities(seen, memory, interval, intensity)
    for again in range(ROUNDS + 1):
        if again > 0:
            sharpen(seen, jerk, interval, intensity, sums)
        chain.vectors[NOW], chain.factor[:, :, :] = mean, factor
        there(chain, seen, intensity, 1, rows)
        turn_round(chain)
        back(chain, seen, 1, rows, due + 1 if again == ROUNDS else 0, jerk)
    stand_at(chain, due - 1)
    if number > 0:
        set_second(chain.vectors[NOW], 0, chain.head[3], chain.second)
    for k in range(1, due + 1):
        table[count], ready[count] = window[k], window_stamps[k]
        count += 1
    for k in range(due, rows):
        window[k - due], window_stamps[k - due] = window[k], window_stamps[k]
    state.rows -= due
    if succeeds:
        heir, successor = open_chain(heirs[int(state.heir)]), open_chain(chains[int(state.heir)])
        successor.vectors[NOW], successor.factor[:, :, :] = heir.vectors[NOW], heir.factor
        successor.second[:] = heir.second
        state.number, state.heir = state.heir, -1.0
    elif state.heir >= 0.0:
        state.heir_row -= due
    return count
