"""Angles as turns and phase, against 50 digits."""

from __future__ import annotations

import mpmath
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from textile_twin_core.shaft.turns import join_turns, split_turn, split_turns


@given(st.floats(-1e9, 1e9))
def test_no_precision_is_lost(angle: float) -> None:
    turns, phase = split_turns(np.array([angle]))
    with mpmath.workdps(50):
        exact = mpmath.mpf(angle) - 2 * mpmath.pi * int(turns[0])
        assert abs(float(exact - mpmath.mpf(float(phase[0])))) < 1e-15
    assert abs(phase[0]) < 3.1416
    assert abs(float(join_turns(turns, phase)[0]) - angle) <= 2 * np.spacing(abs(angle))
    assert split_turn(angle) == (int(turns[0]), float(phase[0]))
