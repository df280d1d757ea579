"""Samples of a live view: blocks that wait to be drawn, and statistics over the last minutes."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeAlias, TypeVar

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison import AngleBins, RunningAngleBins

Block: TypeAlias = tuple[FloatArray, ...]


class Buffer:
    """Thread-safe queue of blocks of columns; drops the oldest samples above `most` and counts them in `dropped`."""

    def __init__(self, most: int) -> None:
        self._most, self._held = most, 0
        self._blocks: deque[Block] = deque()
        self._lock = threading.Lock()
        self.dropped = 0

    def put(self, block: Block) -> None:
        """Append columns of equal length; drop the oldest blocks above the limit."""
        with self._lock:
            self._blocks.append(block)
            self._held += block[0].size
            while self._held > self._most and len(self._blocks) > 1:
                gone = self._blocks.popleft()[0].size
                self._held -= gone
                self.dropped += gone

    def take(self) -> Block:
        """Remove all blocks and return them joined by column; an empty tuple when there are none."""
        with self._lock:
            blocks = list(self._blocks)
            self._blocks.clear()
            self._held = 0
        if not blocks:
            return ()
        return tuple(np.concatenate(columns) for columns in zip(*blocks, strict=True))


T = TypeVar("T")


class Latest(Generic[T]):
    """Pair of accumulators that covers the last `span_s` to 2 `span_s` seconds in constant memory.

    Every `span_s` the shown accumulator is discarded; the other one takes its place and a new one starts.

    Args:
        create: Function that returns an empty accumulator.
        span_s: Time span [s]; inf covers everything.
    """

    def __init__(self, create: Callable[[], T], span_s: float) -> None:
        self._create, self._span_s = create, span_s
        self.shown, self._next = create(), create()
        self._turned_s = np.nan

    def turn(self, time_s: float) -> None:
        """Discard the older accumulator if it is due at this time [s], or if time moved backwards."""
        if not self._turned_s - self._span_s <= time_s < self._turned_s + self._span_s:
            if np.isfinite(self._turned_s):
                self.shown, self._next = self._next, self._create()
            self._turned_s = time_s

    @property
    def both(self) -> tuple[T, T]:
        """Return the two accumulators; add each sample to both."""
        return self.shown, self._next


class Residuals:
    """Residuals in `bins` bins of the shaft angle, and their statistics."""

    def __init__(self, bins: int) -> None:
        self._bins = RunningAngleBins(bins)
        self._squares = 0.0
        self.count, self.worst_Nm = 0, 0.0

    def add(self, theta_rad: FloatArray, residual_Nm: FloatArray) -> None:
        """Add residuals (n,) [N m] at angles (n,) [rad], all finite."""
        self._bins.add(theta_rad, residual_Nm)
        self._squares += float(residual_Nm @ residual_Nm)
        self.count += residual_Nm.size
        self.worst_Nm = max(self.worst_Nm, float(np.max(np.abs(residual_Nm), initial=0.0)))

    @property
    def rms_Nm(self) -> float:
        """Root mean square; `count` must be positive."""
        return float(np.sqrt(self._squares / self.count))

    def bins(self) -> AngleBins:
        """Return the statistics by bin."""
        return self._bins.bins()


class Extremes:
    """Smallest and largest of numbers and zero."""

    def __init__(self) -> None:
        self.low, self.high = 0.0, 0.0

    def add(self, values: FloatArray) -> None:
        """Add numbers (n,); ignore those that are not finite."""
        finite = values[np.isfinite(values)]
        self.low = min(self.low, float(np.min(finite, initial=0.0)))
        self.high = max(self.high, float(np.max(finite, initial=0.0)))
