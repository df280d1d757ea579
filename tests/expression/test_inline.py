"""Sine, cosine and angles of directions as the loops have them, against fifty digits."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest

from textile_twin_core.expression import inline

_LAST_PLACE = 2.0**-52


@pytest.mark.parametrize("size", [1e-300, 1e-8, 1.0, 10.0, 1e4, 1e6, 1e9])
def test_sine_and_cosine_to_the_last_place(size: float) -> None:
    """Compiled and as they stand, near multiples of a quarter turn too."""
    rng = np.random.default_rng(2)
    quarters = np.round(rng.uniform(-size, size, 100) / (math.pi / 2)) * (math.pi / 2)
    angles = np.concatenate([rng.uniform(-size, size, 300), quarters, [0.0, size, -size]])
    with mp.workdps(50):
        for x in angles.tolist():
            exact = mp.cos(mp.mpf(x)), mp.sin(mp.mpf(x))
            for sincos in (inline.sincos, inline.sincos.py_func):
                s, c = sincos(x)
                assert abs(c - exact[0]) < 0.6 * _LAST_PLACE
                assert abs(s - exact[1]) < 0.6 * _LAST_PLACE


def test_what_is_no_number_gives_none() -> None:
    assert all(math.isnan(v) for x in (math.nan, math.inf) for v in inline.sincos(x))
    assert all(math.isnan(inline.atan2(y, x)) for y, x in ((math.nan, 1.0), (1.0, math.nan), (math.nan, math.nan)))


@pytest.mark.parametrize("size", [1e-200, 1.0, 1e200])
def test_angles_of_directions(size: float) -> None:
    """All around, and near the axes and the diagonals, where the forms meet."""
    around = np.random.default_rng(3).uniform(-math.pi, math.pi, 400)
    eighths = np.arange(-8, 9) * math.pi / 8
    angles = np.concatenate([around, eighths, eighths + 1e-9, eighths - 1e-9])
    with mp.workdps(50):
        for y, x in zip((size * np.sin(angles)).tolist(), (size * np.cos(angles)).tolist(), strict=True):
            error = abs(inline.atan2(y, x) - mp.atan2(mp.mpf(y), mp.mpf(x)))
            assert min(error, abs(error - 2 * mp.pi)) < 1.2 * 2.0 * _LAST_PLACE  # that of pi
    assert inline.atan2(0.0, -size) == math.pi
    assert inline.atan2(0.0, size) == 0.0 == inline.atan2(0.0, 0.0)
    assert inline.atan2(size, 0.0) == math.pi / 2
