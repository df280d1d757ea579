"""What an angle reading is worth: encoder steps, jittered stamps, and how both are learnt from the samples."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.shaft.turns import TURN, split_turns

LOOK_AT = (12, 48, 192, 768)
NO_STEP_AFTER = 192
"""Readings without a common divisor that prove that there is none; of fewer the counts may merely lie far apart."""
UNKNOWN_STEP_RAD = 0.012
"""Taken for the encoder's step until it is found: that of 9 bits."""
FINEST_STEP_RAD = 1e-6
ENOUGH_GAPS = 6
COARSE = 5.0
"""Steps larger than this many predicted sigmas are taken as the interval that they are, not as noise."""


class EncoderNoise:
    """Variance of an angle reading: (step)^2/12, (speed x stamp jitter)^2 and a small rest.

    The jitter and the rest are adapted by the normalised innovations (a stochastic-gradient rise of the likelihood in
    their logarithms), each by its share of the variance; the step is found as the common divisor of the readings.

    Args:
        resolution_rad: encoder step; None: find it.
        jitter_s: standard deviation of the stamps; None: learn it, from 20 us.
        period_rad: after which the encoder's counts come again.
    """

    def __init__(self, resolution_rad: float | None, jitter_s: float | None, period_rad: float = TURN) -> None:
        self._period = period_rad
        self._find = resolution_rad is None
        self._learn = jitter_s is None
        self.known = resolution_rad is not None
        self.step = UNKNOWN_STEP_RAD if resolution_rad is None else resolution_rad
        self.jitter = 20e-6 if jitter_s is None else jitter_s
        self._rest = (0.02 * self.step) ** 2 + 1e-12 if self.known else 1e-12
        self._looked: list[float] = []
        self._trust = 0

    def look(self, raw: float) -> None:
        """Take note of one reading, to find the encoder's step."""
        if not self._find:
            return
        self._looked.append(raw)
        if len(self._looked) in LOOK_AT:
            readings = np.array(self._looked)
            step = encoder_step(readings, self._period)
            if step or (step is not None and len(readings) >= NO_STEP_AFTER):
                self.known = True
                self.step = step
                self._rest = (0.02 * step) ** 2 + 1e-12
            if len(self._looked) == LOOK_AT[-1]:
                self._find = not self.known
                self._looked = np.unique(readings)[: LOOK_AT[0]].tolist() if self._find else []

    def reading(self, innovation: float, predicted: float, speed: float) -> tuple[float, float, float]:
        """Innovation, its variance, and the share of the jitter in it, for a reading as a linear Gaussian one.

        A reading of a coarse encoder says "within this step": the truncated normal's mean and variance are turned into
        the linear measurement that would give the same (Curry 1970, quantised measurements by moment matching).
        """
        jitter = (speed * self.jitter) ** 2
        smooth = predicted + jitter + self._rest
        step = self.step
        if not self.known or step * step < COARSE * COARSE * smooth:
            total = smooth + step * step / 12.0
            return innovation, total, jitter / total
        scale = math.sqrt(smooth)
        low, high = (innovation - step / 2.0) / scale, (innovation + step / 2.0) / scale
        if low > 5.0 or high < -5.0:  # far outside: as good as a reading at the near edge
            edge = low + 1.0 / low if low > 0 else high + 1.0 / high
            return edge * scale, smooth, jitter / smooth
        mass = 0.5 * (math.erf(high * math.sqrt(0.5)) - math.erf(low * math.sqrt(0.5)))
        at_low, at_high = _density(low), _density(high)
        shift = (at_low - at_high) / mass
        shrink = (high * at_high - low * at_low) / mass + shift * shift
        if shrink < 1e-9:
            return 0.0, math.inf, 0.0
        return shift * scale / shrink, smooth / shrink, jitter / smooth * shrink

    def learn(self, normalised: float, share: float) -> None:
        """Adapt the jitter by a squared normalised innovation and the jitter's share in its variance."""
        if self._learn and self.known and share > 1e-3:
            self._trust += 1
            gain = max(1.0 / (self._trust + 50), 1e-3)
            self.jitter *= math.exp(gain * share * (min(normalised, 9.0) - 1.0))
            self.jitter = min(max(self.jitter, 1e-9), 1e-2)


def _density(x: float) -> float:
    return math.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi)


def encoder_step(angles: FloatArray, period_rad: float = TURN) -> float | None:
    """The step that all angles are multiples of, but for an offset; 0 when there is none, None when too few differ.

    Args:
        angles: (n,) readings [rad] in time order, wrapped or not.
        period_rad: after which the encoder's counts come again.
    """
    step = _common_step(angles, angles)
    if step:
        return step
    within = split_turns(angles)[1] if period_rad == TURN else np.mod(angles, period_rad)
    return _common_step(angles, within) or step


def _common_step(angles: FloatArray, values: FloatArray) -> float | None:
    grain = 16.0 * np.finfo(np.float64).eps * max(float(np.abs(angles).max()), 1.0)
    gaps = np.diff(np.unique(values))
    gaps = gaps[gaps > max(10.0 * grain, FINEST_STEP_RAD)]
    if gaps.size < ENOUGH_GAPS:
        return None
    step = float(gaps.min())
    while True:  # Euclid's algorithm on all gaps at once
        rest = np.abs(gaps - np.rint(gaps / step) * step)
        rest = rest[rest > 1e-3 * step + 8.0 * grain]
        if rest.size <= 0.02 * gaps.size:
            break
        step = float(rest.min())
        if step < FINEST_STEP_RAD:
            return 0.0
    multiples = np.rint(gaps / step)
    step = float(np.sum(gaps) / np.sum(multiples))
    moves = np.diff(angles)
    moves -= TURN * np.rint(moves / TURN)
    rounding = float(np.std(np.diff(moves)))
    if float(np.median(np.abs(moves))) >= step and rounding < 0.3 * step:
        return 0.0  # readings in step with the sampling: the common divisor is not the encoder's
    return step
