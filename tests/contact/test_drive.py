"""Taylor series of prescribed motions against 50-digit arithmetic."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest

from textile_twin_core.contact.drive import DrivePiece, quintic
from textile_twin_core.mechanism.motion_law import Section


def test_series_of_a_law_along_an_accelerating_shaft() -> None:
    section = Section((0.01, -0.3, 0.2, 0.05), 0.02, 7.5, 0.4)
    argument = (0.1, 3.0, -2.0, 0.7, 0.0, 1.5)
    piece = DrivePiece(2.0, 3.0, section, argument)
    time, span, order = 2.3, 0.07, 14
    with mp.workdps(50):

        def position(u: mp.mpf) -> mp.mpf:
            t = mp.mpf(time) + u * mp.mpf(span) - 2
            s = sum(mp.mpf(c) * t**k for k, c in enumerate(argument))
            wave = mp.mpf(section.amplitude) * mp.sin(mp.mpf(section.frequency) * s + mp.mpf(section.phase))
            return sum(mp.mpf(c) * s**k for k, c in enumerate(section.polynomial)) + wave

        exact = [float(c) for c in mp.taylor(position, 0, order)]
    computed = piece.taylor(time, span, order)
    assert np.abs(computed - exact).max() < 3e-17
    x, v, a = piece.state(time)
    assert (x, v, a) == pytest.approx((exact[0], exact[1] / span, 2 * exact[2] / span**2), rel=1e-13)


def test_quintic_meets_both_ends() -> None:
    start, end = (0.01, -0.5, 30.0), (0.02, 0.8, -90.0)
    piece = DrivePiece(0.4, 0.45, Section((0.0, 1.0)), quintic(0.45 - 0.4, start, end))
    assert piece.state(0.4) == pytest.approx(start, rel=1e-12)
    assert piece.state(0.45) == pytest.approx(end, rel=1e-11)


def test_a_harmonic_over_a_long_step_keeps_its_digits() -> None:
    piece = DrivePiece(0.0, 1.0, Section((0.0,), 1.0, 2.0 * math.pi, 0.3), (0.0, 1.0))
    series = piece.taylor(0.2, 2.5 / (2.0 * math.pi), 24)
    u = np.linspace(0.0, 1.0, 11)
    exact = np.sin(2.0 * np.pi * (0.2 + u * 2.5 / (2.0 * np.pi)) + 0.3)
    assert np.abs(np.polynomial.polynomial.polyval(u, series) - exact).max() < 1e-14
