"""The noise of the readings in `smooth`: motion that the filter does not follow is no noise."""

from __future__ import annotations

import numpy as np
import pytest

from tests.shaft.kinds import TURN
from tests.shaft.textbook import textbook
from textile_twin_core.shaft import create_estimator


def _edges(seed: int, noise_rad: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times and angles of every second edge of 60 teeth less 3, half orders up to the sixth; speed at these times."""
    rng, speed, time = np.random.default_rng(seed), 300.0, np.arange(0.0, 1.0, 2e-5)
    orders = np.arange(0.5, 6.1, 0.5)
    sizes = 0.03 * rng.uniform(0.3, 1.0, orders.size) / np.maximum(orders, 1.0)
    phase = np.outer(speed * time, orders) + rng.uniform(0.0, TURN, orders.size)
    theta = speed * time + np.cos(phase) @ sizes
    omega = speed * (1.0 - np.sin(phase) @ (sizes * orders))
    place = np.arange(2, int(theta[-1] / TURN * 60.0) - 2)
    edges = place[place % 60 < 57][::2] * TURN / 60.0
    passed = np.interp(edges, theta, time)
    return passed, edges + rng.normal(0.0, noise_rad, edges.size), np.interp(passed, time, omega)


@pytest.mark.parametrize("seed", [0, 2, 5, 7])
@pytest.mark.parametrize("noise_rad", [1e-5, 1e-4])
def test_half_orders_are_no_noise(seed: int, noise_rad: float) -> None:
    """Without a cycle of two turns no model holds them; taken for noise, the speed was off by 0.4 to 0.6 rad/s."""
    time, readings, omega = _edges(seed, noise_rad)
    estimator = create_estimator("smooth")
    estimator.step(time, readings)
    states = estimator.finish()
    late = states.index > 200
    off = (states.omega_rad_s - omega[states.index])[late]
    assert np.sqrt(np.mean(off**2)) < 0.3
    assert np.mean(np.abs(off) < states.sigma[late, 1]) > 0.6


@pytest.mark.parametrize("seed", range(3))
def test_noise_stays_noise(seed: int) -> None:
    """White noise on an even shaft: the stated noise is its, and the textbook's smoother is no better."""
    rng, time, noise = np.random.default_rng(seed), np.arange(3000) * 2e-3, 2e-3
    theta = 30.0 * time + 0.2 * np.sin(2.0 * time)
    readings = theta + rng.normal(0.0, noise, time.size)
    estimator = create_estimator("smooth")
    estimator.step(time, readings)
    states = estimator.finish()
    assert 0.7 * noise < estimator.report.stamp_jitter_s * 30.0 < 1.4 * noise
    late = states.index > 200
    book = textbook(time, readings).smooth[states.index[late], 1]
    truth = 30.0 + 0.4 * np.cos(2.0 * time[states.index[late]])
    off = states.omega_rad_s[late] - truth
    assert np.sqrt(np.mean(off**2)) < 1.25 * np.sqrt(np.mean((book - truth) ** 2))
