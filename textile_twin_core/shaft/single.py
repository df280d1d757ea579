"""One sample at a time, as a live machine gives them: the same loop as for blocks, in a block that is made once.

A live node wakes for each sample with cold caches, where what surrounds the loop (arrays made, checked, looked up by
field) takes five times as long as the loop itself.
"""

from __future__ import annotations

import math
import struct
from typing import Any, NamedTuple

import numpy as np

from textile_twin_core.compiling import entry, records
from textile_twin_core.shaft.estimator import ShaftEstimator
from textile_twin_core.shaft.filter import follow
from textile_twin_core.shaft.gate import Block
from textile_twin_core.shaft.status import ROW, STATE

_STATE = struct.Struct(f"={STATE.names.index('settled') + 1}d" if STATE.names else "")


class OneState(NamedTuple):
    """The shaft at one sample: phase [rad] beyond its whole turns, speed [rad/s], acceleration [rad/s^2], turns."""

    phase_rad: float
    omega_rad_s: float
    alpha_rad_s2: float
    turns: float


class SingleSamples:
    """Single samples into an estimator whose states are ready at once; blocks may go into it in between.

    Args:
        estimator: that of the view `causal` is served once it knows its encoder's step, any other one never.
    """

    def __init__(self, estimator: ShaftEstimator) -> None:
        self._estimator = estimator
        self._at_once = type(estimator) is ShaftEstimator
        self._stamps, self._angles, self._velocities = np.zeros(1, np.int64), np.zeros(1), np.zeros(1)
        self._heard = np.zeros(1)
        self._rows: Any = records(ROW)
        self._block = Block(np.zeros(0, np.int64), self._stamps, self._angles, self._velocities, self._heard)
        self._follow = follow

    def serves(self, stamp: int | float) -> bool:
        """Whether `step` may be called for this sample: stamps are integers [ns], and nothing is learnt from blocks."""
        estimator = self._estimator
        return (
            self._at_once
            and type(stamp) is int
            and estimator._kind == "l"
            and estimator._wheel is None
            and not estimator._finder.wanted
        )

    def step(self, stamp: int, angle: float, velocity: float = math.nan) -> OneState | None:
        """Take a sample: stamp [ns], angle [rad], speed [rad/s] or NaN; its state, None where it has none."""
        estimator = self._estimator
        if estimator._last is not self._block.last:
            self._block = self._block._replace(last=estimator._last)
            self._follow = entry(follow, estimator._status, self._block, self._rows)
        self._stamps[0], self._angles[0], self._velocities[0] = stamp, angle, velocity
        if not self._follow(estimator._status, self._block, self._rows):
            return None
        phase, omega, alpha, turns, settled = _STATE.unpack_from(self._rows)
        return None if settled < 0.0 else OneState(phase, omega, alpha, turns)
