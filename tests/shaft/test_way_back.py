"""The smoother's way back against the same recursion in extended precision, where it is hardest: after a long rest."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled, records
from textile_twin_core.shaft.chain import STAND, STEP
from textile_twin_core.shaft.status import Record, Records
from textile_twin_core.shaft.way_back import BACK, step_back


def test_what_the_later_readings_tell_stays_a_covariance() -> None:
    """Rests tell the angle 1e15 times as well as a running shaft's readings do; what that left behind never faded."""
    steps = records(STEP, 4000)
    rest = steps[:2500]
    steps["gain"], steps["keep"], steps["trust"] = (1750.0, 28.0), 0.776, 3e9
    rest["gain"], rest["keep"], rest["trust"] = (1e-7, 1e-4), 0.97, 1e17
    told = np.zeros((4000, 3, 3))
    _walk(records(BACK), records(STAND), steps, told)
    exact = np.zeros((3, 3), np.longdouble)
    motion = np.array([[1.0, 0.0, 0.0], [1e-3, 1.0, 0.0], [5e-7, 1e-3, 1.0]], np.longdouble)
    for i, at in enumerate(steps):
        loop = np.eye(3, dtype=np.longdouble)
        loop[:, 2] = -at["gain"][0], -at["gain"][1], at["keep"]
        exact = loop.T @ exact @ loop
        exact[2, 2] += at["trust"]
        exact = motion.T @ exact @ motion
        if i > 3500:
            size = np.sqrt(np.diagonal(exact))
            off = (told[i] - exact) / np.outer(size, size)
            assert np.abs(off).max() < 1e-9


@compiled
def _walk(back: Records, stands: Records, steps: Records, told: FloatArray) -> None:
    jerk = np.zeros(2)
    for i in range(steps.size):
        _step(back[0], stands[0], steps[i], told[i], jerk)


@compiled
def _step(back: Record, stand: Record, at: Record, told: FloatArray, jerk: FloatArray) -> None:
    step_back(back, at, stand, 1e-3, 1.0, jerk, 0, False)
    told[:] = back.certainty
