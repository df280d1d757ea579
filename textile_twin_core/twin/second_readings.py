"""Readings of a second encoder, handed out with the samples of the first one."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray
from textile_twin_core.shaft.turns import TURN
from textile_twin_core.twin.restart import RestartWatch

Part: TypeAlias = tuple[npt.NDArray[Any], FloatArray]


class SecondReadings:
    """Queue of the second encoder's readings.

    A sample of the first encoder gets the latest reading since the sample before; earlier ones are dropped. The result
    depends on stamps alone, not on the blocks in which the readings come.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all readings."""
        self._parts: list[Part] = []
        self._next: list[Part] = []
        """Readings of the next record, where their stamps were set back before those of the samples."""
        self._watch = RestartWatch()
        self._is_next = self._awaits_set_back = False

    def take(self, stamps: npt.NDArray[Any], angles: FloatArray) -> None:
        """Add readings: (n,) stamps [ns or s] and angles [rad]. Readings that are not finite are discarded."""
        good = np.isfinite(angles)
        stamps, angles = stamps[good], angles[good]
        begin = 0
        for place in self._watch.restarts(stamps):
            self._add(stamps[begin:place], angles[begin:place])
            begin = place
            if self._awaits_set_back:
                self._parts, self._awaits_set_back = [], False
            else:
                self._is_next = True
        self._add(stamps[begin:], angles[begin:])

    def _add(self, stamps: npt.NDArray[Any], angles: FloatArray) -> None:
        if stamps.size:
            (self._next if self._is_next else self._parts).append((stamps, angles))

    def restart(self) -> None:
        """Begin another record of the samples, whose stamps were set back."""
        self._awaits_set_back = not self._is_next
        self._parts, self._next, self._is_next = self._next, [], False

    def at(self, stamps: npt.NDArray[Any], origin_turns: FloatArray) -> tuple[FloatArray | None, FloatArray | None]:
        """Hand out the readings that belong to samples of the first encoder.

        Args:
            stamps: (n,) increasing stamps of the samples.
            origin_turns: (n,) whole turns from which the angles of the samples count.

        Returns:
            (n,) angles [rad] from the same turns, NaN where a sample has no reading, and times [s] from the reading to
            the sample; None without any reading.
        """
        if not (self._parts and len(stamps)):
            return None, None
        known, angles = (np.concatenate(parts) for parts in zip(*self._parts, strict=True))
        highest = np.maximum.accumulate(known)
        later = np.append(True, highest[1:] > highest[:-1])
        known, angles = known[later], angles[later]
        latest = np.searchsorted(known, stamps, side="right") - 1
        fresh = np.diff(latest, prepend=-1) > 0
        used = np.maximum(latest, 0)
        late = stamps - known[used]
        late = late * 1e-9 if np.issubdtype(late.dtype, np.integer) else late
        rest = slice(latest[-1] + 1, None)
        self._parts = [(known[rest], angles[rest])] if known[rest].size else []
        return np.where(fresh, angles[used] - TURN * origin_turns, np.nan), np.asarray(late, np.float64)
