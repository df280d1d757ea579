"""The kinds of recordings that estimators are judged on: truth by another integrator, faults as specified."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.shaft.disturbances import pulses, steps, wander
from tests.shaft.kinds import KINDS, TURN, make
from tests.shaft.shaft_motion import Law, ShaftMotion


def test_motion_against_another_integrator() -> None:
    rng, dt, n = np.random.default_rng(0), 1e-3, 501
    push = wander(rng, n, dt, 0.02, 30.0) + steps(rng, n, dt, 20.0, 5.0) + pulses(rng, n, dt, 10.0, 0.2)
    target, depth = np.linspace(10.0, 25.0, n), 1.0 + 0.3 * np.sin(np.arange(n) * 0.05)
    waves = np.array([[0.5, 0.05, 0.3], [2.0, 0.03, 1.0]])
    motion = ShaftMotion.solve(Law(dt, push, target, 4.0, waves, depth), 0.7)
    grid = np.arange(n) * dt

    def slope(t: float, y: np.ndarray) -> list[float]:
        ripple = -sum(k * size * np.sin(k * y[0] + phase) for k, size, phase in waves)
        pull = 4.0 * (np.interp(t, grid, target) - y[1]) + (target[1] - target[0]) / dt
        return [y[1], pull + np.interp(t, grid, push) + np.interp(t, grid, depth) * y[1] * abs(y[1]) * ripple]

    times = np.sort(rng.uniform(0.0, grid[-1], 40))
    other = solve_ivp(slope, (0.0, grid[-1]), [0.7, 10.0], "DOP853", times, max_step=dt / 2, rtol=1e-10, atol=1e-10)
    theta, omega, alpha = motion.at(times)
    assert np.allclose(theta, other.y[0], atol=1e-7)
    assert np.allclose(omega, other.y[1], atol=1e-6)
    assert np.allclose(alpha, [slope(t, y)[1] for t, y in zip(times, other.y.T, strict=True)], atol=1e-4)
    angles = np.linspace(1.0, motion.theta[-1] - 0.5, 30)
    assert np.allclose(motion.at(motion.passes(angles))[0], angles, atol=1e-10)


@pytest.mark.parametrize("kind", KINDS)
def test_speed_and_acceleration_belong_to_the_angle(kind: str) -> None:
    """The truth's own trapezoids; each is off by what the motion does between two samples, not by a share of it."""
    record = make(kind, 3)
    h = np.diff(record.time_s)
    for whole, rate in ((record.theta, record.omega), (record.omega, record.alpha)):
        gain, sums = np.diff(whole), 0.5 * h * (rate[1:] + rate[:-1])
        assert abs(gain.sum() - sums.sum()) < 0.02 * np.abs(sums).sum()
        assert np.corrcoef(gain, sums)[0, 1] > 0.9


@pytest.mark.parametrize(
    ("kind", "error"), [("slow", 0.4e-3 * 18.0), ("scales", 1e-3), ("coarse", 0.02), ("teeth", 1.2e-3), ("pitch", 3e-3)]
)
def test_reading_errors_are_as_specified(kind: str, error: float) -> None:
    record = make(kind, 2)
    wrong = record.angle_rad - record.theta
    assert 0.1 * error < wrong.std() < error
    assert abs(wrong.mean()) < 0.2 * wrong.std() + 1e-5


@pytest.mark.parametrize("share", ["1%", "3%"])
def test_outliers_are_half_a_radian_and_as_many_as_specified(share: str) -> None:
    clean, dirty = make("scales", 5), make(f"scales+{share}", 5)
    leap = np.abs(dirty.angle_rad - clean.angle_rad)
    assert set(np.round(leap, 12)) == {0.0, 0.5}
    assert np.mean(leap > 0.0) == pytest.approx(float(share[0]) / 100.0, rel=0.35)
    assert np.array_equal(clean.theta, dirty.theta)


def test_teeth_leave_a_gap_and_seeds_differ() -> None:
    record, other = make("teeth", 0), make("teeth", 1)
    step = np.round(np.diff(record.angle_rad) / TURN * 60.0)
    assert set(step) == {1.0, 4.0}
    assert record.time_s.size != other.time_s.size
    assert np.array_equal(make("teeth", 0).time_s, record.time_s)
