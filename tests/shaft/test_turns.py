"""Angles as turns and phase, against 50 digits."""

from __future__ import annotations

import mpmath
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from textile_twin_core.shaft.turns import join_turns, split_turn


@given(st.floats(-1e9, 1e9))
def test_no_precision_is_lost(angle: float) -> None:
    turns, phase = split_turn(angle)
    with mpmath.workdps(50):
        exact = mpmath.mpf(angle) - 2 * mpmath.pi * int(turns)
        assert abs(float(exact - mpmath.mpf(phase))) < 1e-15
    assert abs(phase) < 3.1416
    joined = join_turns(np.array([turns], dtype=np.int64), np.array([phase]))
    assert abs(float(joined[0]) - angle) <= 2 * np.spacing(abs(angle))
