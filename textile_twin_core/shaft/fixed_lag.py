"""Fixed-lag smoothing: each state uses all samples up to a lag after its own (view `lag`)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from textile_twin_core.compiling import by_reference, compiled_in_place, records
from textile_twin_core.shaft.constants import BATCH, CERTAIN, FIRST_WEIGHT, MOST_ROWS
from textile_twin_core.shaft.estimator import Part, ShaftEstimator, states_of
from textile_twin_core.shaft.filter import Block, process_sample
from textile_twin_core.shaft.ripple import copy_numbers
from textile_twin_core.shaft.rts_smoother import (
    Smoother,
    adopt_weight,
    begin_at_row,
    is_far,
    new_smoother,
    scale_covariances,
    set_ripple,
    smooth,
)
from textile_twin_core.shaft.settings import require_positive
from textile_twin_core.shaft.states import ShaftStates
from textile_twin_core.shaft.status import ROW, STRETCH, Bank, FilterStatus, Records, Stamps

# Lag [s]; rows in the window; rows released by this call; 1 where the smoother must restart; see `rts_smoother`.
PROGRESS = np.dtype(
    [("lag", np.float64), ("rows", np.int64), ("ready", np.int64), ("restart", np.int64), ("weight", np.float64, (2,))]
)


@by_reference
class Window(NamedTuple):
    """Rows to be smoothed; the first one is the smoother's initial state and already released."""

    progress: Records  # (1,) PROGRESS
    rows: Records  # (MOST_ROWS,)
    filtered: Records  # (1,) the first row before smoothing
    stamps: Stamps  # (MOST_ROWS,)


class LagEstimator(ShaftEstimator):
    """Filter and smooth over a window of the lag; a state is ready one lag, up to 4/3 of it, after its sample.

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
        self._window = Window(records(PROGRESS), records(ROW, MOST_ROWS), records(ROW), np.zeros(MOST_ROWS, np.int64))
        self._window.progress["lag"] = self._lag
        self._window.progress["weight"] = FIRST_WEIGHT
        self._smoother = new_smoother(self._settings, MOST_ROWS)

    def _room(self, more: int) -> Part:
        if self._window.stamps.dtype != self._last.dtype:
            self._window = self._window._replace(stamps=np.zeros(MOST_ROWS, self._last.dtype))
        return super()._room(int(self._window.progress["rows"][0]) + more)

    def _take(self, block: Block, ready: Stamps, rows: Records) -> int:
        return _follow(self._status, block, self._window, self._smoother, ready, rows)

    def finish(self) -> ShaftStates:
        """End the record and return the remaining states; report and newest stamp persist."""
        self._window.progress["ready"] = 0
        ready, rows = self._room(0)
        _release(self._status, int(self._window.progress["rows"][0]) - 1, self._window, self._smoother, ready, rows)
        count = int(self._window.progress["ready"][0])
        adopt_weight(self._status, self._window.progress["weight"][0])
        super().finish()
        return states_of([(ready[:count], rows[:count])])


@compiled_in_place
def _follow(record: Records, block: Block, window: Window, smoother: Smoother, ready: Stamps, table: Records) -> int:
    """Filter a block; write released rows to `table` and their stamps to `ready`; return their number."""
    progress, rows = window.progress[0], window.rows
    progress.ready = 0
    for i in range(block.stamps.size):
        last = progress.rows
        row = rows[last]
        if not process_sample(record, block, i, row) or record[0].sampling.samples == 1.0:
            continue
        window.stamps[last] = block.stamps[i]
        if row.cut >= STRETCH:
            _release(record, last - 1, window, smoother, ready, table)
            rows[0], window.stamps[0] = rows[last], window.stamps[last]
            window.filtered[0], progress.rows, progress.restart = rows[0], 1, 1
            if rows[0].settled >= 0.0:
                _emit(window, 0, ready, table)
            continue
        progress.rows += 1
        full, due = last == MOST_ROWS - 1, 0
        while due < last and row.time - rows[due + 1].time >= progress.lag:
            due += 1
        if full:
            due = max(due, last // (BATCH + 1))
        if due > 0 and (due >= (last - due) // BATCH or full):
            _release(record, due, window, smoother, ready, table)
    return progress.ready


@compiled_in_place
def _release(record: Records, due: int, window: Window, smoother: Smoother, ready: Stamps, table: Records) -> None:
    """Smooth the window and release the `due` rows after the first, if any; the last of these becomes the first."""
    if due <= 0:
        return
    status: FilterStatus = record[0]
    bank: Bank = smoother.bank[0]
    progress = window.progress[0]
    known = status.sampling.since > 0.0  # otherwise it has restarted
    models = status.bank.models
    if known and models.mode_probability[models.leading] > CERTAIN:
        # Another ripple means another clock, for which the state so far is inaccurate.
        f = models.leading
        progress.restart += f != bank.models.leading or models.waves[f] != bank.models.waves[f]
        set_ripple(bank, status.bank, f)
    if progress.restart != 0 or is_far(smoother, window.filtered[0]):
        begin_at_row(smoother, window.filtered[0])
    progress.restart = 0
    window.filtered[0] = window.rows[due]
    smooth(smoother, window.rows[: progress.rows], 1, due)
    copy_numbers(smoother.filtered[due], smoother.filtered[0])
    scale_covariances(progress.weight, window.rows[1 : due + 1])
    for k in range(1, due + 1):
        _emit(window, k, ready, table)
    for k in range(due, progress.rows):
        window.rows[k - due], window.stamps[k - due] = window.rows[k], window.stamps[k]
    progress.rows -= due


@compiled_in_place
def _emit(window: Window, k: int, ready: Stamps, table: Records) -> None:
    progress = window.progress[0]
    table[progress.ready], ready[progress.ready] = window.rows[k], window.stamps[k]
    progress.ready += 1
