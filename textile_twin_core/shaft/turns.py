"""Angles as whole turns and phase, which keep their precision at a billion radians."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.compiling import compiled_in_place

TURN = 2.0 * math.pi
TURN_TAIL = 2.4492935982947064e-16  # 2 pi minus its float64 value


@compiled_in_place
def split_turn(angle: float) -> tuple[float, float]:
    """Split an angle [rad] into whole turns and phase in about [-pi, pi], exact to the input's own rounding."""
    phase = float(np.fmod(angle, TURN))  # exact, in the float64 period
    phase -= np.rint(phase / TURN) * TURN
    turns = np.rint((angle - phase) / TURN)
    return turns, phase - turns * TURN_TAIL


def join_turns(turns: IntArray, phase: FloatArray) -> FloatArray:
    """Return the angle [rad] of whole turns and phase, rounded once at the end."""
    return turns * TURN + (turns * TURN_TAIL + phase)
