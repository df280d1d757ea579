"""The yardstick itself: the second tufting torque against the published machine, the signal against its definition."""

from __future__ import annotations

import numpy as np
import pytest

from tests.shaft.judge import TORQUE
from tests.shaft.shaft_signal import make_signal

SPEED = 160 * 2 * np.pi / 60


def test_torque_is_that_of_the_published_machine() -> None:
    theta = np.linspace(0, 2 * np.pi, 7200)
    inertia, half_slope, gravity = TORQUE.terms(theta)
    assert inertia.min() == pytest.approx(5.0444e-3, abs=1e-7)
    assert inertia.max() == pytest.approx(6.5168e-3, abs=1e-7)
    assert TORQUE.stroke == pytest.approx(0.0327884, abs=2e-6)
    assert (half_slope * SPEED**2).min() == pytest.approx(-0.234, abs=5e-4)
    assert (half_slope * SPEED**2).max() == pytest.approx(0.211, abs=5e-4)
    assert gravity.min() == pytest.approx(-0.559, abs=5e-4)
    assert gravity.max() == pytest.approx(0.553, abs=5e-4)


def test_acceleration_of_the_signal_matters_as_much_as_it_should() -> None:
    signal = make_signal(1)
    without = TORQUE(signal.theta, signal.omega, 0 * signal.alpha) - TORQUE(signal.theta, signal.omega, signal.alpha)
    assert np.sqrt(np.mean(without**2)) == pytest.approx(0.0325, abs=2e-4)


@pytest.mark.parametrize("knocks", [False, True])
def test_signal_is_consistent(knocks: bool) -> None:
    signal = make_signal(4, knocks=knocks, dropped=0.0, rate_hz=20000.0, duration_s=1.0)
    step = np.diff(signal.time)
    speed = np.diff(signal.theta) / step
    assert np.abs(speed - (signal.omega[1:] + signal.omega[:-1]) / 2).max() < 5e-4
    change = np.diff(signal.omega) / step - (signal.alpha[1:] + signal.alpha[:-1]) / 2
    assert np.quantile(np.abs(change), 0.99) < 2e-3  # the knock itself is a step of the acceleration
