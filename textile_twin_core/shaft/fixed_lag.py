"""Fixed-lag smoothing: each state uses all samples up to a time after its own (the view `lag`)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from textile_twin_core.compiling import by_reference, compiled_in_place, records
from textile_twin_core.shaft.clock import copy_numbers
from textile_twin_core.shaft.estimator import Part, ShaftEstimator, states_of
from textile_twin_core.shaft.filter import Block, process_sample
from textile_twin_core.shaft.rts_smoother import Smoother, begin_at_row, is_far, new_smoother, set_ripple, smooth
from textile_twin_core.shaft.settings import require_positive
from textile_twin_core.shaft.states import ShaftStates
from textile_twin_core.shaft.status import ROW, STRETCH, Records, Stamps
from textile_twin_core.shaft.unit_weight import FIRST_WEIGHT, adopt_weight, scale_covariances

MOST_ROWS = 512  # rows in the window at most: a longer lag at a high rate is cut
BATCH = 3  # rows are released when they are 1 / BATCH of those beyond them: one backward pass serves all of them
CERTAIN = 0.5  # mode probability from which a family's ripple is smoothed with

# Lag [s]; rows in the window; rows released by this call; 1 where the smoother must begin again; see `unit_weight`.
HELD = np.dtype(
    [("lag", np.float64), ("rows", np.int64), ("ready", np.int64), ("restart", np.int64), ("weight", np.float64, (2,))]
)


@by_reference
class Window(NamedTuple):
    """Rows that wait to be smoothed; the first is the smoother's initial state and already released."""

    held: Records  # (1,) HELD
    rows: Records  # (MOST_ROWS,)
    filtered: Records  # (1,) the first row as it was filtered
    stamps: Stamps  # (MOST_ROWS,)


class LagEstimator(ShaftEstimator):
    """Filters, and smooths over a window of the lag; states become ready up to a third of the lag later than that.

    Args:
        shaft_lag_s: the lag [s].
        settings: fields of `ShaftSettings`.

    Raises:
        SceneError: a lag that is not positive, or a setting of the wrong kind or value.
        TypeError: a setting that does not exist.
    """

    at_once = False

    def __init__(self, *, shaft_lag_s: float = 0.04, **settings: Any) -> None:
        require_positive("shaft_lag_s", shaft_lag_s)
        self._lag = float(shaft_lag_s)
        super().__init__(**settings)

    def _begin(self) -> None:
        self._window = Window(records(HELD), records(ROW, MOST_ROWS), records(ROW), np.zeros(MOST_ROWS, np.int64))
        self._window.held["lag"] = self._lag
        self._window.held["weight"] = FIRST_WEIGHT
        self._smoother = new_smoother(self._settings, MOST_ROWS)

    def _room(self, more: int) -> Part:
        if self._window.stamps.dtype != self._last.dtype:
            self._window = self._window._replace(stamps=np.zeros(MOST_ROWS, self._last.dtype))
        return super()._room(int(self._window.held["rows"][0]) + more)

    def _take(self, block: Block, ready: Stamps, rows: Records) -> int:
        return _follow(self._status, block, self._window, self._smoother, ready, rows)

    def finish(self) -> ShaftStates:
        """The states still held; then the estimator begins again, but for the report and the newest stamp."""
        self._window.held["ready"] = 0
        ready, rows = self._room(0)
        _release(self._status, int(self._window.held["rows"][0]) - 1, self._window, self._smoother, ready, rows)
        count = int(self._window.held["ready"][0])
        adopt_weight(self._status, self._window.held["weight"][0])
        super().finish()
        return states_of([(ready[:count], rows[:count])])


@compiled_in_place
def _follow(record: Records, block: Block, window: Window, smoother: Smoother, ready: Stamps, table: Records) -> int:
    """Filter a block; released rows go to `table` and their stamps to `ready`. Returns their number."""
    held, rows = window.held[0], window.rows
    held.ready = 0
    for i in range(block.stamps.size):
        last = held.rows
        row = rows[last]
        if not process_sample(record, block, i, row) or record[0].samples == 1.0:
            continue
        window.stamps[last] = block.stamps[i]
        if row.cut >= STRETCH:
            _release(record, last - 1, window, smoother, ready, table)
            rows[0], window.stamps[0] = rows[last], window.stamps[last]
            window.filtered[0], held.rows, held.restart = rows[0], 1, 1
            if rows[0].settled >= 0.0:
                _emit(window, 0, ready, table)
            continue
        held.rows += 1
        full, due = last == MOST_ROWS - 1, 0
        while due < last and row.time - rows[due + 1].time >= held.lag:
            due += 1
        if full:
            due = max(due, last // (BATCH + 1))
        if due > 0 and (due >= (last - due) // BATCH or full):
            _release(record, due, window, smoother, ready, table)
    return held.ready


@compiled_in_place
def _release(record: Records, due: int, window: Window, smoother: Smoother, ready: Stamps, table: Records) -> None:
    """Smooth the window and release the `due` rows after the first, if any; the last of these becomes the first."""
    if due <= 0:
        return
    held, status, filters = window.held[0], record[0], smoother.filters[0]
    known = status.since > 0.0  # else it has restarted
    if known and status.mode_probability[status.leading] > CERTAIN:
        # With another ripple the clock is another, of which the state so far knows little.
        f = status.leading
        held.restart += f != filters.leading or status.waves[f] != filters.waves[f]
        set_ripple(filters, status, f)
    if held.restart != 0 or is_far(smoother, window.filtered[0]):
        begin_at_row(smoother, window.filtered[0])
    held.restart = 0
    window.filtered[0] = window.rows[due]
    smooth(smoother, window.rows[: held.rows], 1, due)
    copy_numbers(smoother.filtered[due], smoother.filtered[0])
    scale_covariances(held.weight, window.rows[1 : due + 1])
    for k in range(1, due + 1):
        _emit(window, k, ready, table)
    for k in range(due, held.rows):
        window.rows[k - due], window.stamps[k - due] = window.rows[k], window.stamps[k]
    held.rows -= due


@compiled_in_place
def _emit(window: Window, k: int, ready: Stamps, table: Records) -> None:
    held = window.held[0]
    table[held.ready], ready[held.ready] = window.rows[k], window.stamps[k]
    held.ready += 1
