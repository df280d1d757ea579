"""Fixed-interval smoothing: the whole record, each state seeing the samples before and after it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.clock import set_second
from textile_twin_core.shaft.estimator import PIECE, Part, ShaftEstimator, joined, states_of
from textile_twin_core.shaft.families import SEEN_CYCLES
from textile_twin_core.shaft.gating import set_start
from textile_twin_core.shaft.ripple_history import RippleHistory
from textile_twin_core.shaft.rts_smoother import (
    Smoother,
    begin_at_state,
    log_likelihood,
    new_smoother,
    set_ripple,
    smooth,
)
from textile_twin_core.shaft.samples import Block
from textile_twin_core.shaft.states import ShaftStates
from textile_twin_core.shaft.status import STATE, Records
from textile_twin_core.shaft.teeth import ToothWheel
from textile_twin_core.shaft.turns import TURN

LESSONS = 4  # times that the teeth's pitch errors are made what the smoothed motion says
LEAST_LED = 0.05  # part of a stretch that a family must have led to be a candidate
ASKED_PARTS, ASKED_ROWS = 32, 256  # of a longer stretch so many parts of so many rows choose the model, as well as all
OVERLAP = 512  # rows on either side of a part that are smoothed along with it
FINDING = 128  # first rows of a stretch, in which the filter finds its memory: they take the shortest of the next
FEWEST = 4  # rows below which a stretch keeps the filter's states


class SmoothEstimator(ShaftEstimator):
    """Filters while samples come in and smooths at `finish` (see `smoother`)."""

    at_once = False

    def reset(self) -> None:
        """Forget everything, the report included."""
        super().reset()
        self._history = RippleHistory()
        self._blocks: list[Part] = []
        self._new: list[Part] = []

    def step(
        self, stamps: npt.ArrayLike, angles: npt.ArrayLike, velocities: npt.ArrayLike | None = None
    ) -> ShaftStates:
        """Take a block of samples; no state is ready before `finish`."""
        self._new.extend(self._walk(stamps, angles, velocities))
        if len(self._new) >= PIECE:  # small arrays of rows take much more memory than one large one
            self._blocks.append(joined(self._new))
        return ShaftStates.empty(self._last)

    def _piece(self) -> int:
        return self._history.until_look

    def _take(self, block: Block) -> Part:
        part = super()._take(block)
        self._history.follow(self._status, block.stamps.size)
        return part

    def finish(self) -> ShaftStates:
        """The states of all samples from the third on."""
        blocks, self._blocks, self._new = self._blocks + self._new, [], []
        if not blocks:
            return ShaftStates.empty(self._last)
        stamps, rows = joined(blocks)
        self._history.end(self._status)
        self._smooth(rows)
        super().finish()
        self._history = RippleHistory()
        return states_of([(stamps, rows[list(STATE.names or ())].astype(STATE))])

    def _smooth(self, rows: Records) -> None:
        """Smooth stretch by stretch; with a toothed wheel again, its pitch errors as the smoothed motion tells them."""
        wheel = self._wheel
        cuts = np.flatnonzero(rows["cut"] == 1.0).tolist()
        stretches = [rows[first:end] for first, end in pairwise([*cuts, len(rows)])]
        for stretch in stretches:
            found = min(FINDING, len(stretch) // 2)
            stretch["memory"][:found] = np.min(stretch["memory"][found : 2 * found + 1], axis=0)
        lessons = LESSONS if wheel is not None and wheel.learning else 0
        for lesson in range(lessons + 1):
            for stretch in stretches:
                if len(stretch) >= FEWEST:
                    self._smooth_stretch(stretch)
            if wheel is not None and lesson < lessons:
                off = rows["reading"] - rows["phase"] - (rows["turns"] - rows["origin"]) * TURN
                rows["reading"] += wheel.learn(rows["reading"], off)
                if lesson == lessons // 2:
                    rows["reading"] += self._part_ripple(wheel, rows["reading"])

    def _part_ripple(self, wheel: ToothWheel, readings: FloatArray) -> FloatArray:
        """Leave to the wheel what of the ripples is its own; by how much each reading (n,) is to be corrected."""
        every = self._settings.cycle_turns
        last = self._history.known[-1][0]
        lead = int(last["leading"])
        whole = last["ripple"][last["best"][lead], : 2 * lanes.WAVES[lead]].reshape(-1, 2)[every - 1 :: every]
        kept, correction = wheel.take_from_ripple(whole, readings)
        for status in self._history.known:
            for f in range(1, lanes.FAMILIES):
                ripple = status[0]["ripple"][status[0]["best"][f], : 2 * lanes.WAVES[f]]
                part = ripple.reshape(-1, 2)[every - 1 :: every][: kept.size]
                part *= kept[: len(part), None]
                set_second(ripple, lanes.WAVES[f], 1.0 / every, status[0]["second"][f], np.zeros(lanes.WIDEST))
        return correction

    def _smooth_stretch(self, rows: Records) -> None:
        """Part by part, where the ripple was another."""
        known = self._history.known
        count = [status["received"][0] for status in known[:-1]]
        edges = [0, *np.searchsorted(rows["index"], count).tolist(), len(rows)]
        led = np.bincount(rows["leading"].astype(np.int64), minlength=lanes.FAMILIES) > LEAST_LED * len(rows)
        parts: list[tuple[int, Records, int]] = []
        for i, (first, end) in enumerate(pairwise(edges)):
            if end > first:
                around = known[max(i - 1, 0) : i + 2]
                status, family = self._likeliest(rows[max(first - OVERLAP, 0) : end + OVERLAP], led, around)
                if not parts or parts[-1][1] is not status or parts[-1][2] != family:
                    parts.append((first, status, family))
        for (first, status, family), end in zip(parts, [first for first, _, _ in parts[1:]] + [len(rows)], strict=True):
            begin = max(first - OVERLAP, 0)
            begin += int(np.argmax(rows["noise"][begin:] > 0.0))
            part = rows[begin : end + OVERLAP]
            if len(part) >= FEWEST:
                smoother = new_smoother(self._settings, len(part))
                _smooth_rows(smoother, status, family, part, max(first - begin, 1), end - begin - 1)

    def _likeliest(self, rows: Records, led: BoolArray, known: list[Records]) -> tuple[Records, int]:
        """The ripple and the family under which the readings are likeliest (Schwarz 1978)."""
        tried = self._candidates(led, known)
        if len(tried) < 2:
            return tried[0]
        asked = _asked(rows)
        smoother, size = new_smoother(self._settings, max(map(len, asked))), np.log(sum(map(len, asked)))
        told = [sum(_evidence(smoother, status, each, f) for each in asked) for status, f in tried]
        return tried[int(np.argmax(np.asarray(told) - size * np.take(lanes.WAVES, [f for _, f in tried])))]

    def _candidates(self, led: BoolArray, known: list[Records]) -> list[tuple[Records, int]]:
        """Ripples as the filter came to know them, and families that led.

        The plain one is among them but where there is only one ripple: all that are known may be wrong for a part.
        """
        plain = [(self._history.known[-1], int(lanes.PLAIN))]
        cycle = self._settings.cycle_turns * TURN
        ripples = [
            (status, f)
            for status in known
            for f in range(1, lanes.FAMILIES)
            if led[f] and status["travelled"][0][f] >= SEEN_CYCLES * cycle
        ]
        return ripples if len(ripples) == 1 and not led[0] else plain + ripples


def _asked(rows: Records) -> list[Records]:
    """Of a long stretch parts all over it, each from a reading on that was not set aside."""
    parts = [rows]
    if len(rows) > ASKED_PARTS * ASKED_ROWS:
        starts = np.linspace(0, len(rows) - ASKED_ROWS, ASKED_PARTS).astype(np.int64)
        parts = [rows[start : start + ASKED_ROWS] for start in starts]
    return [part[int(np.argmax(part["noise"] > 0.0)) :] for part in parts]


@compiled
def _begin(smoother: Smoother, record: Records, rows: Records, family: int) -> None:
    """Begin at the first row with its reading and the filter's speed."""
    filters, first = smoother.filters[0], rows[0]
    set_ripple(filters, record[0], family)
    set_start(filters.start, first.reading, first.speed, first.noise, rows[1].step)
    begin_at_state(filters, first.reading, first.speed, 0.0)


@compiled
def _evidence(smoother: Smoother, record: Records, rows: Records, family: int) -> float:
    """Logarithm of the readings' likelihood under a family."""
    _begin(smoother, record, rows, family)
    return log_likelihood(smoother, record[0], rows)


@compiled
def _smooth_rows(smoother: Smoother, record: Records, family: int, rows: Records, first: int, told: int) -> None:
    _begin(smoother, record, rows, family)
    smooth(smoother, record[0], rows, first, told)
