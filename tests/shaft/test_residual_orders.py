"""Ripple of orders that no family leads with is no noise: sigmas know of it, and of nothing that is not there."""

from __future__ import annotations

import numpy as np
import pytest

from tests.shaft.kinds import TURN
from tests.shaft.shaft_motion import Law, ShaftMotion
from textile_twin_core.shaft import create_estimator


def _inside(view: str, motion: ShaftMotion, time: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Shares of speeds and accelerations within one sigma, the first fifth left out."""
    estimator = create_estimator(view)
    states = [estimator.step(time, angles), estimator.finish()][view == "smooth"]
    late = states.index > 0.2 * time.size
    _, omega, alpha = motion.at(time[states.index[late]])
    off = np.stack([states.omega_rad_s[late] - omega, states.alpha_rad_s2[late] - alpha], axis=1)
    return np.asarray(np.mean(np.abs(off) < states.sigma[late, 1:], axis=0))


def _turning(seed: int, ripple: tuple[float, ...], speed: float, duration_s: float) -> ShaftMotion:
    rng, dt = np.random.default_rng(seed), 1e-3
    n = int(duration_s / dt) + 1
    waves = np.array([(k + 1.0, size, rng.uniform(0.0, TURN)) for k, size in enumerate(ripple)])
    push = 0.02 * speed * np.sin(0.7 * np.arange(n) * dt)
    return ShaftMotion.solve(Law(dt, push, np.full(n, speed), 3.0, waves, np.ones(n)), rng.uniform(0.0, TURN))


@pytest.mark.parametrize("view", ["causal", "smooth"])
@pytest.mark.parametrize("samples", [7.3, 9.1, 11.7, 13.9])
def test_sigmas_know_the_orders_for_which_there_are_too_few_samples(view: str, samples: float) -> None:
    """A controller at 100 Hz, 14 bits, ripple of four orders; errors of such orders are a wave's, .5 to .9 inside."""
    motion = _turning(3, (0.02, 0.03, 0.01, 0.004), 100.0 * TURN / samples, 30.0)
    time = np.arange(1, 2990) / 100.0
    angles = np.round(motion.at(time)[0] / (TURN / 2**14)) * (TURN / 2**14)
    inside = _inside(view, motion, time, angles)
    assert np.all((inside > 0.5) & (inside < 0.93))


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_no_ripple(seed: int) -> None:
    """Sigmas of an even shaft are those of its filters."""
    motion = _turning(seed, (0.0,), 15.0, 30.0)
    time = np.arange(1, 14_500) / 500.0
    noise = np.random.default_rng(seed).normal(0.0, 5e-4, time.size)
    states = create_estimator("causal").step(time, motion.at(time)[0] + noise)
    assert np.mean(states.rows["systematic"][2000:, 2] > 0.0) < 0.1


@pytest.mark.parametrize("seed", range(3))
def test_pitch_errors_are_no_ripple(seed: int) -> None:
    """Errors of an encoder's disc come again every turn, too, but in all orders alike."""
    motion = _turning(seed, (0.02,), 30.0, 30.0)
    time = np.arange(1, 14_500) / 500.0
    theta, _, alpha = motion.at(time)
    errors = np.random.default_rng(seed).normal(0.0, 1e-3, 60)
    states = create_estimator("causal").step(time, theta + errors[np.floor(theta * 60.0 / TURN).astype(int) % 60])
    off = np.sqrt(np.mean((states.alpha_rad_s2[3000:] - alpha[states.index[3000:]]) ** 2))
    assert off < 0.006 * 30.0**2  # of the same errors taken for ripple: 0.03
    assert off < np.median(states.sigma[3000:, 2]) < 2.5 * off
