"""Periodic error of an encoder, against Kepler's equation, mpmath and derivatives by finite differences."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import jv

from textile_twin_core.errors import MachineError
from textile_twin_core.machine import Encoder

PAIRS = ((0.004, -0.0076), (0.0031, 0.0042))


def test_once_per_turn_is_the_equation_of_kepler() -> None:
    """M = E - k sin E: the series of Bessel functions gives E from M."""
    k, reading = 0.3, np.linspace(-9.0, 9.0, 200)
    encoder = Encoder(eccentricity_rad=((0.0, -k),))
    series = reading + sum(2.0 / n * jv(n, n * k) * np.sin(n * reading) for n in range(1, 200))
    assert_allclose(encoder.shaft_angle(reading), series, rtol=0.0, atol=4e-15)


def test_the_inverse_is_exact_to_rounding_for_large_angles_and_single_readings() -> None:
    encoder = Encoder(zero_rad=0.3, direction=-1, ratio=2.0, eccentricity_rad=PAIRS)
    reading = np.array([-3.0, 0.0, 1.0, 6.28, 4000.0, 1e6])
    found = encoder.shaft_angle(reading)
    (c1, s1), (c2, s2) = PAIRS
    for given, angle in zip(reading, found, strict=True):
        with mpmath.workdps(40):
            true = mpmath.findroot(
                lambda q, at=float(given): (
                    q + c1 * mpmath.cos(q) + s1 * mpmath.sin(q) + c2 * mpmath.cos(2 * q) + s2 * mpmath.sin(2 * q) - at
                ),
                given,
            )
            true = (true - mpmath.mpf(0.3)) * -2
        assert abs(angle - float(true)) <= 2.0 * np.spacing(abs(angle)) + 1e-15
        assert encoder.shaft_angle([given])[0] == pytest.approx(angle, abs=np.spacing(abs(angle)) + 1e-15)
        assert encoder.shaft_angle(given) == pytest.approx(angle, abs=np.spacing(abs(angle)) + 1e-15)
    assert_allclose(encoder.measured_angle(found), reading, rtol=1e-15, atol=1e-15)


def test_wrapped_readings_are_corrected_as_unwrapped_ones() -> None:
    encoder = Encoder(eccentricity_rad=PAIRS)
    reading = np.linspace(0.0, 60.0, 997)
    gap = encoder.shaft_angle(reading) - encoder.shaft_angle(np.mod(reading, 2.0 * math.pi))
    assert_allclose(gap / (2.0 * math.pi), np.rint(gap / (2.0 * math.pi)), atol=1e-14)


def test_the_error_follows_the_declared_series() -> None:
    """An encoder that turns three times per turn of the shaft has orders 3 and 6 on the shaft."""
    encoder = Encoder(ratio=1.0 / 3.0, eccentricity_rad=PAIRS)
    shaft = np.arange(64) * 2.0 * math.pi / 64.0
    error = np.fft.rfft(encoder.measured_angle(shaft) - 3.0 * shaft) / 32.0
    expected = np.zeros(33, complex)
    expected[3], expected[6] = PAIRS[0][0] - 1j * PAIRS[0][1], PAIRS[1][0] - 1j * PAIRS[1][1]
    assert_allclose(error, expected, atol=1e-13)


def test_speeds_are_the_slopes_of_the_angles() -> None:
    encoder = Encoder(direction=-1, ratio=2.0, eccentricity_rad=PAIRS)
    time, h = np.linspace(0.0, 1.0, 50), 1e-6
    angle = lambda t: 30.0 * t + 0.5 * np.sin(20.0 * t)  # noqa: E731
    speed = 30.0 + 10.0 * np.cos(20.0 * time)
    slope = (encoder.measured_angle(angle(time + h)) - encoder.measured_angle(angle(time - h))) / (2.0 * h)
    measured = encoder.measured_speed(angle(time), speed)
    assert_allclose(measured, slope, rtol=1e-8)
    assert_allclose(encoder.shaft_speed(encoder.measured_angle(angle(time)), measured), speed, rtol=1e-14)


def test_readings_that_are_not_finite_stay_so() -> None:
    encoder = Encoder(eccentricity_rad=PAIRS)
    assert np.isnan(encoder.shaft_angle([math.nan, math.inf, 1.0])).tolist() == [True, True, False]
    assert np.isnan(encoder.shaft_angle([math.inf])).all()


@pytest.mark.parametrize(
    ("pairs", "said"),
    [
        (((0.0, 0.01),) * 3, "has 3 pairs; give one or two"),
        (((0.0, 0.5),), "small in radians"),
        (((0.0, 0.0), (0.2, 0.2)), "small in radians"),
        (((math.nan, 0.0),), "must be finite"),
    ],
)
def test_refused(pairs: tuple[tuple[float, float], ...], said: str) -> None:
    with pytest.raises(MachineError, match=said):
        Encoder(eccentricity_rad=pairs)
