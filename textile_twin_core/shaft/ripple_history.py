"""The ripple as the filter knew it in the course of a record: where it changed, what was before keeps that of then."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.readings import noise_of
from textile_twin_core.shaft.status import Records

LOOK_EVERY = 1024
"""Samples between two looks."""
CHANGED, UNSURE = 0.25, 3.0
"""By how much ripples that are not the same differ at least (RMS over a turn): by so many standard deviations of a
reading, and so many of their own."""


class RippleHistory:
    """Statuses of the filter.

    Attributes:
        known: each the last before the ripple changed, or the end.
    """

    def __init__(self) -> None:
        self.known: list[Records] = []

    def until_look(self, status: Records) -> int:
        """Samples until the next look."""
        return LOOK_EVERY - int(status["received"][0]) % LOOK_EVERY

    def look(self, status: Records) -> None:
        """Remember the status where its ripple is known."""
        _, off, reading = _ripple(status)
        if 0.0 < off < CHANGED * reading:
            self.remember(status)

    def remember(self, status: Records) -> None:
        """Remember a status, in place of the one before if the ripple is the same."""
        ripple, off, reading = _ripple(status)
        if self.known:
            before, off_before, _ = _ripple(self.known[-1])
            if _rms(ripple - before) < max(CHANGED * reading, UNSURE * float(np.hypot(off, off_before))):
                self.known.pop()
        self.known.append(status.copy())


def _ripple(status: Records) -> tuple[FloatArray, float, float]:
    """Coefficients (WIDEST,) of the leading ripple, its own uncertainty (RMS over a turn) and a reading's [rad]."""
    now = status[0]
    lead = int(now["lead"])
    lane, width = int(now["best"][lead]), 2 * lanes.WAVES[lead]
    ripple, scale = np.zeros(lanes.WIDEST), float(now["scale"][lane])
    ripple[:width] = now["ripple"][lane, :width]
    factor = now["factor"][lane, :width, :width]
    return ripple, _rms(factor) * np.sqrt(scale), float(np.sqrt(scale * noise_of(now, float(now["speed"]))))


def _rms(coefficients: FloatArray) -> float:
    """Over a turn, of the ripple with these coefficients."""
    return float(np.sqrt(0.5 * np.sum(coefficients**2)))
