"""One sample at a time, by the same loop as for blocks, in a block that is made once.

A live node wakes for each sample with cold caches, where making, checking and looking up arrays around the loop takes
five times as long as the loop.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import numpy as np

from textile_twin_core.compiling import entry, records
from textile_twin_core.shaft.filter import run_filter
from textile_twin_core.shaft.samples import Block, Stamps
from textile_twin_core.shaft.status import ROW, STATE, Records

_STATE = struct.Struct(f"={STATE.names.index('settled') + 1}d" if STATE.names else "")


class OneState(NamedTuple):
    """The shaft at one sample: phase [rad] beyond its whole turns, speed [rad/s], acceleration [rad/s^2], turns."""

    phase_rad: float
    omega_rad_s: float
    alpha_rad_s2: float
    turns: float


class OneSample:
    """A block of one sample and the row of its state."""

    def __init__(self) -> None:
        self._row: Any = records(ROW)
        self._block = Block(np.zeros(0, np.int64), np.zeros(1, np.int64), np.zeros(1), np.zeros(1), np.zeros(1))
        self._run = run_filter

    def take(self, status: Records, last: Stamps, stamp: int, angle: float, velocity: float) -> OneState | None:
        """Take a sample: stamp [ns], angle [rad], speed [rad/s] or NaN; its state, None where it has none."""
        if last is not self._block.last:
            self._block = self._block._replace(last=last)
            self._run = entry(run_filter, status, self._block, self._row)
        block = self._block
        block.stamps[0], block.angles[0], block.velocities[0] = stamp, angle, velocity
        if not self._run(status, block, self._row):
            return None
        phase, omega, alpha, turns, settled = _STATE.unpack_from(self._row)
        return None if settled < 0.0 else OneState(phase, omega, alpha, turns)
