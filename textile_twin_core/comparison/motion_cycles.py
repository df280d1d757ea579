"""Pieces in which the motion of a shaft is watched: turns, or cycles of a shaft that reverses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.shaft_track import TURN

_BACK_RAD = 0.25 * TURN
"""Way back from an extreme angle above which it is a reversal; less is the tremble of a shaft at standstill."""
_LONG_RAD = 4.0 * TURN
"""A stroke in one direction beyond this is divided into turns."""

_OF_A_SPAN = 1 << 40
"""Number of labels of a span."""


@dataclass
class ShaftStroke:
    """Motion in one direction: from its begin to its end [s], infinite while it lasts.

    reversed: it begins with a reversal, and not with the record. long: divided into turns.
    fresh: none of its turns has been taken.
    """

    begin_s: float
    sense: int = 0
    end_s: float = math.inf
    reversed: bool = False
    long: bool = False
    fresh: bool = True


@dataclass
class Reversals:
    """Strokes of a shaft, from its states as they come; blocks of any size give the same.

    A reversal is the state at an extreme angle, seen once the shaft has gone back a quarter of a turn. Whether a stroke
    is long is seen after four turns, so the turns of a shaft that begins, or has reversed, wait until then.
    """

    strokes: list[ShaftStroke] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._lowest = self._highest = (0.0, 0.0)  # angle and time

    def take(self, time_s: FloatArray, theta_rad: FloatArray) -> None:
        """Take states (n,) in order of time."""
        for time, theta in zip(time_s.tolist(), theta_rad.tolist(), strict=True):
            if not self.strokes:
                self.strokes.append(ShaftStroke(time))
                self._lowest = self._highest = theta, time
            stroke = self.strokes[-1]
            self._lowest, self._highest = min(self._lowest, (theta, time)), max(self._highest, (theta, -time))
            low, high = theta - self._lowest[0], self._highest[0] - theta
            if not stroke.sense:
                stroke.sense = int(low > _BACK_RAD) - int(high > _BACK_RAD)
            elif (high if stroke.sense > 0 else low) > _BACK_RAD:
                extreme = self._highest[0], -self._highest[1]
                at = extreme if stroke.sense > 0 else self._lowest
                stroke.end_s = at[1]
                self.strokes.append(ShaftStroke(at[1], -stroke.sense, reversed=True))
                self._lowest = min(at, (theta, time))
                self._highest = max((at[0], -at[1]), (theta, -time))
            elif self._highest[0] - self._lowest[0] > _LONG_RAD:
                stroke.long = True


@dataclass(frozen=True)
class WatchedSpan:
    """Time span [s] whose samples can be watched: a cycle by its number, or the turns of a stroke.

    Attributes:
        begin_s, end_s: of the span. cycle: number of the cycle; None for turns.
        sense: of the turns. incomplete: number of the turn that is not complete yet; None where the stroke is over.
        partial: numbers of turns of which much is missing.
    """

    begin_s: float
    end_s: float
    cycle: int | None = None
    sense: int = 0
    incomplete: int | None = None
    partial: frozenset[int] = frozenset()


def labelled(spans: Sequence[WatchedSpan], time_s: FloatArray, turn: IntArray) -> tuple[IntArray, BoolArray]:
    """Label samples (n,) at times, in turns by number, by the piece they belong to; the mask is false for all others.

    Labels grow with the time of the pieces. `numbers` gives the number of the turn or cycle of a label.
    """
    label, known = np.zeros(time_s.size, np.int64), np.zeros(time_s.size, np.bool_)
    for place, span in enumerate(spans):
        inside = (time_s >= span.begin_s) & (time_s < span.end_s)
        if span.cycle is None:
            inside &= ~np.isin(turn, list(span.partial))
            if span.incomplete is not None:
                inside &= span.sense * turn < span.sense * span.incomplete
        along = turn[inside] * span.sense if span.cycle is None else span.cycle
        label[inside] = place * _OF_A_SPAN + _OF_A_SPAN // 2 + along
        known |= inside
    return label, known


def numbers(spans: Sequence[WatchedSpan], label: IntArray) -> IntArray:
    """Return the number of the turn or cycle of each label."""
    place, along = np.divmod(label, _OF_A_SPAN)
    sense = np.array([span.sense if span.cycle is None else 1 for span in spans], np.int64)
    return np.asarray((along - _OF_A_SPAN // 2) * sense[place])
