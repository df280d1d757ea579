"""Ripples of a record in the order of time: after a change, earlier samples are smoothed with the earlier ripple."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.shaft import lanes
from textile_twin_core.shaft.measurement_noise import measurement_variance
from textile_twin_core.shaft.status import Records

LOOK_EVERY = 1024  # samples between two checks
FIRST_LOOK = 128  # after which the first is; then each time after as many again as there were, up to LOOK_EVERY
CHANGED, UNSURE = 0.25, 3.0  # a change exceeds so many sigmas of a measurement and of the ripples' difference
LESS_SURE = 2.0  # times the sigma of the same ripple known before, from which the earlier one stays
MOST_KNOWN = 64  # ripples kept; beyond, every second one is dropped


class RippleHistory:
    """Copies of the filter's status where each ripple was known best; `received` is the last sample it holds for."""

    def __init__(self) -> None:
        self.known: list[Records] = []
        self._taken, self._due = 0, FIRST_LOOK

    @property
    def until_look(self) -> int:
        """Samples until the next check."""
        return self._due - self._taken

    def follow(self, status: Records, samples: int) -> None:
        """Count the samples that led to a status (at most `until_look`) and check it when due."""
        self._taken += samples
        if self._taken == self._due:
            self._due += min(self._taken, LOOK_EVERY)
            self._check(status)

    def end(self, status: Records) -> None:
        """Check the record's last status, and keep it in any case."""
        self._check(status)
        if not self.known or self.known[-1]["received"][0] != status["received"][0]:
            self.known.append(status.copy())

    def _check(self, status: Records) -> None:
        """Keep a status whose ripple is certain: in place of the last one unless the ripple changed."""
        ripple, sigma, reading = _ripple(status)
        if not 0.0 < sigma < CHANGED * reading:
            return
        if self.known:
            before, sigma_before, _ = _ripple(self.known[-1])
            if _rms(ripple - before) < max(CHANGED * reading, UNSURE * float(np.hypot(sigma, sigma_before))):
                if sigma > LESS_SURE * sigma_before:
                    self.known[-1]["received"] = status["received"]
                    return
                self.known.pop()
        self.known.append(status.copy())
        if len(self.known) > MOST_KNOWN:
            del self.known[1::2]


def _ripple(status: Records) -> tuple[FloatArray, float, float]:
    """Coefficients (WIDEST,) of the leading ripple, their sigma (RMS over a turn) and a measurement's [rad]."""
    now = status[0]
    lane, width = int(now["best"][now["leading"]]), 2 * int(now["waves"][now["leading"]])
    ripple, scale = np.where(np.arange(lanes.WIDEST) < width, now["ripple"][:, lane], 0.0), float(now["scale"][lane])
    sigma = _rms(now["factor"][:width, :width, lane]) * np.sqrt(scale)
    return ripple, sigma, float(np.sqrt(scale * measurement_variance(now)))


def _rms(coefficients: FloatArray) -> float:
    """Of the ripple with these coefficients, over a turn."""
    return float(np.sqrt(0.5 * np.sum(coefficients**2)))
