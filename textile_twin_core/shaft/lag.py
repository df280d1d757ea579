"""Fixed lag: each state considers all samples up to a time after its own."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.compiling import compiled, records
from textile_twin_core.shaft.base import Recursion, Stamps, states_of
from textile_twin_core.shaft.chain import CHAIN, know_ripple, stand, turn_round
from textile_twin_core.shaft.chain import STEP as ONE_STEP
from textile_twin_core.shaft.filter import take
from textile_twin_core.shaft.gate import admit
from textile_twin_core.shaft.report import SampleReport
from textile_twin_core.shaft.settings import ShaftSettings, require_positive
from textile_twin_core.shaft.smoothing import (
    ROUNDS,
    back,
    look_back,
    readmit,
    set_clock,
    set_intensities,
    sharpen,
    stand_as,
    take_shorter,
    there,
)
from textile_twin_core.shaft.states import ShaftStates
from textile_twin_core.shaft.status import (
    ACCELERATION,
    COVARIANCE,
    CUT,
    MEMORY,
    NOISE,
    READING,
    SETTLED,
    SPEED,
    THETA,
    TIME,
    WAVES,
    WIDTH,
    Record,
    StatusArray,
    new_status,
)

MOST_ROWS = 1024
"""Samples that may be held; a longer lag at a high rate is cut to what fits."""
CHANGED = 0.2
"""Change of the memory's logarithm within the lag from which it is worth to look at it from behind too."""
BATCH = 3
"""Samples within a lag that become ready at once, one part in so many: the way back is shared by them."""

HELD = np.dtype([("lag", np.float64), ("rows", np.int64), ("family", np.int64), ("ready", np.int64)])
"""Lag [s]; rows held, of which the first is where the chain stands; family of its ripple; rows that became ready."""


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
        self._held = records(HELD)
        self._held["lag"] = self._lag
        self._window, self._window_stamps = np.zeros((MOST_ROWS, WIDTH)), np.zeros(MOST_ROWS, np.int64)
        self._chain, self._steps = records(CHAIN), records(ONE_STEP, MOST_ROWS + 1)
        self._chain["lowest"] = 1.0 / self._settings.cycle_turns
        self._filters = new_status(self._settings, 0.0)

    @property
    def report(self) -> SampleReport:
        """Counts of what came in and what became of it."""
        return self._recursion.report()

    def step(
        self, stamps: npt.ArrayLike, angles: npt.ArrayLike, velocities: npt.ArrayLike | None = None
    ) -> ShaftStates:
        """Take a block of samples; the states that are ready. See `ShaftEstimator.step`."""
        return states_of(self._recursion.walk(self._walk, stamps, angles, velocities))

    def _walk(
        self, stamps: Stamps, angles: FloatArray, velocities: FloatArray, heard: FloatArray
    ) -> tuple[Stamps, FloatArray]:
        own = self._recursion
        if self._window_stamps.dtype != stamps.dtype:
            self._window_stamps = np.zeros(MOST_ROWS, stamps.dtype)
        room = int(self._held["rows"][0]) + stamps.size
        ready, table = np.empty(room, stamps.dtype), np.empty((room, WIDTH))
        count = _follow(
            own.status, own.last, stamps, angles, velocities, heard, self._held, self._window, self._window_stamps,
            self._chain, self._steps, self._filters, ready, table,
        )  # fmt: skip
        return ready[:count], table[:count]

    def finish(self) -> ShaftStates:
        """The states still held; then the estimator begins anew, but for the report and the newest stamp."""
        count = int(self._held["rows"][0])
        ready, table = np.empty(count, self._window_stamps.dtype), np.empty((count, WIDTH))
        self._held["ready"] = 0
        _flush(
            self._recursion.status, self._held, self._window, self._window_stamps, self._chain, self._steps,
            self._filters, ready, table,
        )  # fmt: skip
        count = int(self._held["ready"][0])
        self._recursion.begin_anew()
        self._begin()
        return states_of([(ready[:count], table[:count])])


@compiled
def _follow(
    record: StatusArray, last: FloatArray | IntArray, stamps: FloatArray | IntArray, angles: FloatArray,
    velocities: FloatArray, heard: FloatArray, held: StatusArray, window: FloatArray,
    window_stamps: FloatArray | IntArray, chains: StatusArray, steps: StatusArray, filters: StatusArray,
    ready: FloatArray | IntArray, table: FloatArray,
) -> int:  # fmt: skip
    """As `filter.follow`; the rows of the states that are ready go to `table`, their stamps to `ready`."""
    state = held[0]
    state.ready = 0
    for i in range(stamps.size):
        heard[i] = math.nan
        if not admit(record, last, stamps[i], angles[i]):
            continue
        velocity = velocities[i] if velocities.size > 0 else math.nan
        at = state.rows
        take(record, (stamps[i] - last[0]) * record[0].unit, angles[i], velocity, window[at])
        last[0] = stamps[i]
        row = window[at]
        if row[NOISE] > 0.0:
            heard[i] = row[READING]
        if record[0].samples == 1.0:
            continue
        window_stamps[at] = stamps[i]
        if row[CUT] == 1.0:
            _flush(record, held, window, window_stamps, chains, steps, filters, ready, table)
            _move(window, window_stamps, at, 0)
            state.rows = 1
            _stand(record[0], state, chains[0], window[0])
            if window[0, SETTLED] >= 0.0:
                _let_go(state, window, window_stamps, 0, ready, table)
            continue
        state.rows += 1
        due = 0
        while due < at and row[TIME] - window[due + 1, TIME] >= state.lag:
            due += 1
        if due > 0 and (due >= (at - due) // BATCH or at == MOST_ROWS - 1):
            _release(record, held, due, window, window_stamps, chains, steps, filters, ready, table)
    return state.ready  # type: ignore[no-any-return]


@compiled
def _stand(status: Record, state: Record, chain: Record, row: FloatArray) -> None:
    """Put the chain where the filter told that the shaft was at a row, with the ripple that leads now."""
    state.family = status.lead
    know_ripple(chain, status, state.family)
    kinematic, by = chain.kinematic, row[COVARIANCE : COVARIANCE + 9]
    kinematic[0] = math.sqrt(by[8])
    kinematic[1], kinematic[2] = by[5] / kinematic[0], by[2] / kinematic[0]
    kinematic[3] = math.sqrt(max(by[4] - kinematic[1] ** 2, 1e-9 * by[4]))
    kinematic[4] = (by[1] - kinematic[1] * kinematic[2]) / kinematic[3]
    kinematic[5] = math.sqrt(max(by[0] - kinematic[2] ** 2 - kinematic[4] ** 2, 1e-9 * by[0]))
    stand(chain, WAVES[state.family], row[THETA], row[SPEED], row[ACCELERATION], kinematic)


@compiled
def _flush(
    record: StatusArray, held: StatusArray, window: FloatArray, window_stamps: FloatArray | IntArray,
    chains: StatusArray, steps: StatusArray, filters: StatusArray, ready: FloatArray | IntArray, table: FloatArray,
) -> None:  # fmt: skip
    """Let go of all rows held: nothing more will be learnt of them."""
    if held[0].rows > 1:
        due = held[0].rows - 1
        _release(record, held, due, window, window_stamps, chains, steps, filters, ready, table)


@compiled
def _release(
    record: StatusArray, held: StatusArray, due: int, window: FloatArray, window_stamps: FloatArray | IntArray,
    chains: StatusArray, steps: StatusArray, filters: StatusArray, ready: FloatArray | IntArray, table: FloatArray,
) -> None:  # fmt: skip
    """Smooth the window and let go of the `due` rows after the first."""
    state, chain, status, start = held[0], chains[0], record[0], steps[MOST_ROWS]
    rows = state.rows
    seen = window[:rows]
    if status.active[state.family] == 0.0 or status.lead != state.family:
        _stand(status, state, chain, seen[0])
    else:
        know_ripple(chain, status, state.family)
    waves, known, interval = WAVES[state.family], MEMORY + state.family, status.interval
    memory, intensity, jerk, sums = np.empty(rows), np.empty(rows), np.zeros((rows, 2)), np.empty((rows + 1, 2))
    stand_as(chain, start)
    readmit(seen)
    set_clock(chain, waves, seen)
    shortest = longest = seen[0, known]
    for k in range(rows):
        memory[k] = seen[k, known]
        shortest, longest = min(shortest, memory[k]), max(longest, memory[k])
    set_intensities(seen, memory, interval, intensity)
    there(chain, steps, 0 * waves, seen, intensity, 1, rows)
    if shortest < longest - CHANGED:
        look_back(filters[0], chain, seen, known, interval, memory)
        take_shorter(seen, known, 0 * rows, memory)
        set_intensities(seen, memory, interval, intensity)
    for again in range(ROUNDS + 1):
        if again > 0:
            sharpen(seen, jerk, interval, intensity, sums)
        stand_as(start, chain)
        last = again == ROUNDS
        there(chain, steps, waves if last else 0, seen, intensity, 1, rows)
        turn_round(chain)
        back(chain, steps, waves, seen, 1, rows, due + 1 if last else 0, jerk)
    stand_as(steps[due - 1], chain)
    for k in range(1, due + 1):
        _let_go(state, window, window_stamps, k, ready, table)
    for k in range(due, rows):
        _move(window, window_stamps, k, k - due)
    state.rows -= due


@compiled
def _let_go(
    state: Record, window: FloatArray, window_stamps: FloatArray | IntArray, k: int, ready: FloatArray | IntArray,
    table: FloatArray,
) -> None:  # fmt: skip
    """A row of the window is ready."""
    for i in range(window.shape[1]):
        table[state.ready, i] = window[k, i]
    ready[state.ready] = window_stamps[k]
    state.ready += 1


@compiled
def _move(window: FloatArray, window_stamps: FloatArray | IntArray, source: int, target: int) -> None:
    for i in range(window.shape[1]):
        window[target, i] = window[source, i]
    window_stamps[target] = window_stamps[source]
