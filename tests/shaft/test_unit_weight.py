"""Smoothed residuals tell how large noise and sigmas are where predictions, whose misfits look like noise, do not."""

from __future__ import annotations

import numpy as np
import pytest

from tests.shaft.kinds import TURN
from textile_twin_core.shaft import ShaftStates, create_estimator

SPEED, NOISE, SAMPLES = 314.0, 2e-4, 28.5  # [rad/s], [rad], readings a turn
JITTER = 1.5e-4  # [s]


def _turning(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Time and angle of a shaft whose ripple has 40 half orders that fall off with their third power."""
    time = np.arange(count) * TURN / (SPEED * SAMPLES)
    order = 0.5 * np.arange(1.0, 41.0)
    size, phase = 0.01 * rng.normal(size=40) * (2.0 * order) ** -3.0, rng.uniform(0.0, TURN, 40)
    return time, SPEED * time + np.sin(np.outer(SPEED * time, order) + phase) @ size


@pytest.mark.parametrize("view", ["lag", "smooth"])
def test_white_noise_is_estimated_where_the_motion_is_no_white_jerk(view: str) -> None:
    """Half orders without `cycle_turns` make predictions worse than white jerk would: 1.2 times the noise by these."""
    told, inside = [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        time, theta = _turning(rng, 1500)
        estimator = create_estimator(view)
        states = ShaftStates.join([estimator.step(time, theta + rng.normal(0.0, NOISE, time.size)), estimator.finish()])
        told.append(estimator.report.stamp_jitter_s * SPEED / NOISE)
        late = states.index > 300
        off = np.angle(np.exp(1j * (states.theta_rad[late] - theta[states.index[late]])))
        inside.append(np.mean(np.abs(off) < states.sigma[late, 0]))
    assert np.median(told) == pytest.approx(1.0, abs=0.06)
    assert 0.6 < np.median(inside) < 0.75


@pytest.mark.parametrize("view", ["lag", "smooth"])
def test_a_configured_jitter_is_reported_unchanged(view: str) -> None:
    """A setting is no estimate."""
    rng = np.random.default_rng(0)
    time, theta = _turning(rng, 1500)
    estimator = create_estimator(view, stamp_jitter_s=1e-6)
    estimator.step(time, theta + rng.normal(0.0, NOISE, time.size))
    estimator.finish()
    assert estimator.report.stamp_jitter_s == 1e-6


@pytest.mark.parametrize("view", ["lag", "smooth"])
def test_a_long_standstill_is_no_proof_of_small_noise(view: str) -> None:
    """An encoder at standstill repeats its value for hours."""
    rng = np.random.default_rng(1)
    time = np.arange(10_000) * 0.002
    speed = (20.0 + 2.0 * np.sin(3.0 * time)) * np.clip(9.0 - 2.0 * time, 0.0, 1.0)
    theta = np.concatenate([[0.0], np.cumsum(0.002 * speed)[:-1]])
    estimator = create_estimator(view)
    estimator.step(time, theta + rng.normal(0.0, JITTER, time.size) * speed)
    estimator.finish()
    assert estimator.report.stamp_jitter_s == pytest.approx(JITTER, rel=0.15)
