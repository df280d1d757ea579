"""The ripple as the filter knew it in the course of a record: where it changed, what was before keeps that of then."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.measurement_noise import measurement_variance
from textile_twin_core.shaft.status import Records

LOOK_EVERY = 1024  # samples between two looks
CHANGED, UNSURE = 0.25, 3.0  # ripples that differ by so many sigmas of a reading, and of their own, are not the same
MOST_KNOWN = 64  # of a ripple that never stays the same every second is forgotten beyond


class RippleHistory:
    """Statuses of the filter, each as it knew a ripple best; `received` says until when it was the same."""

    def __init__(self) -> None:
        self.known: list[Records] = []
        self._taken = 0

    @property
    def until_look(self) -> int:
        """Samples until the next look."""
        return LOOK_EVERY - self._taken % LOOK_EVERY

    def follow(self, status: Records, samples: int) -> None:
        """Take note that so many samples, `until_look` at most, led to a status."""
        self._taken += samples
        if self._taken % LOOK_EVERY == 0:
            self._look(status)

    def end(self, status: Records) -> None:
        """The record ends."""
        self._look(status)
        if not self.known or self.known[-1]["received"][0] != status["received"][0]:
            self.known.append(status.copy())

    def _look(self, status: Records) -> None:
        ripple, sigma, reading = _ripple(status)
        if not 0.0 < sigma < CHANGED * reading:
            return
        if self.known:
            before, sigma_before, _ = _ripple(self.known[-1])
            if _rms(ripple - before) < max(CHANGED * reading, UNSURE * float(np.hypot(sigma, sigma_before))):
                if sigma > UNSURE * sigma_before:
                    self.known[-1]["received"] = status["received"]
                    return
                self.known.pop()
        self.known.append(status.copy())
        if len(self.known) > MOST_KNOWN:
            del self.known[1::2]


def _ripple(status: Records) -> tuple[FloatArray, float, float]:
    """Coefficients (WIDEST,) of the leading ripple, their sigma (RMS over a turn) and a reading's [rad]."""
    now = status[0]
    lane, width = int(now["best"][now["leading"]]), 2 * lanes.WAVES[int(now["leading"])]
    ripple, scale = np.where(np.arange(lanes.WIDEST) < width, now["ripple"][lane], 0.0), float(now["scale"][lane])
    sigma = _rms(now["factor"][lane, :width, :width]) * np.sqrt(scale)
    return ripple, sigma, float(np.sqrt(scale * measurement_variance(now, float(now["speed"]))))


def _rms(coefficients: FloatArray) -> float:
    """Over a turn, of the ripple with these coefficients."""
    return float(np.sqrt(0.5 * np.sum(coefficients**2)))
