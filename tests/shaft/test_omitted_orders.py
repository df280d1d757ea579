"""Orders of the turn that `smooth` omits: its sigmas contain what the readings cannot exclude, and no more."""

from __future__ import annotations

import numpy as np
import pytest

from tests.shaft.kinds import TURN
from textile_twin_core.shaft import create_estimator

SPEED, RATE, COUNT = 100.0, 2000.0, 24_000


def _turning(orders: np.ndarray, size: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, angles with counts of 12 bits, and accelerations: ripple of these amplitudes [rad] over the time."""
    rng = np.random.default_rng(seed)
    time = np.arange(COUNT) / RATE
    phase = np.outer(SPEED * time, orders) + rng.uniform(0.0, TURN, orders.size)
    theta = SPEED * time + np.sin(phase) @ size
    jitter = rng.normal(0.0, 2e-6, COUNT) * SPEED
    step = TURN / 4096
    return time, np.round((theta + jitter) / step) * step, -np.sin(phase) @ (size * (orders * SPEED) ** 2)


def _inside(time: np.ndarray, angle: np.ndarray, alpha: np.ndarray) -> tuple[float, float]:
    """Share of accelerations within one sigma, and the ratio of sigmas to errors (RMS)."""
    estimator = create_estimator("smooth")
    estimator.step(time, angle)
    states = estimator.finish()
    late = states.index > COUNT // 8
    off, sigma = (states.alpha_rad_s2 - alpha[states.index])[late], states.sigma[late, 2]
    return float(np.mean(np.abs(off) < sigma)), float(np.sqrt(np.mean(sigma**2) / np.mean(off**2)))


@pytest.mark.parametrize("seed", range(3))
def test_the_orders_of_a_torque_with_steps(seed: int) -> None:
    """Accelerations of 100 rad/s^2 over the order, of which each from the seventh on is under 1/50 of a count."""
    orders = np.arange(1.0, 41.0)
    inside, ratio = _inside(*_turning(orders, 100.0 / orders / (orders * SPEED) ** 2, seed))
    assert 0.55 < inside < 0.95
    assert 0.5 < ratio < 2.0


@pytest.mark.parametrize("seed", range(3))
def test_a_ripple_that_ends(seed: int) -> None:
    """Orders that no reading and no order before suggests widen no sigma."""
    inside, ratio = _inside(*_turning(np.array([1.0, 2.0]), np.array([5e-3, 2e-3]), seed))
    assert inside < 0.97
    assert ratio < 2.0


@pytest.mark.parametrize("counts", [(3000, 400, 3000), (3000, 800)])
def test_each_part_of_a_record_has_its_own_noise(counts: tuple[int, ...]) -> None:
    """Half orders in the second part, which `smooth` follows better with less noise, leave the stated jitter as it is.

    Scaled by the factor of the last such part, the jitter was 0.04 and 0.43 of the true one.
    """
    rng, noise, step = np.random.default_rng(0), 1e-4, TURN / 28.5
    half, parts = np.arange(0.5, 6.1, 0.5), []
    for number, count in enumerate(counts):
        angle = np.arange(count) * step
        waves = np.cos(np.outer(angle, half) + rng.uniform(0.0, TURN, half.size))
        size = 0.02 if number == 1 else 0.0
        parts.append(angle + waves @ (size / np.maximum(half, 1.0)) + rng.normal(0.0, noise, count))
    pauses = np.repeat(np.arange(len(counts)), counts)  # of a second
    estimator = create_estimator("smooth", wrapping="unwrapped")
    estimator.step(np.arange(sum(counts)) * step / 300.0 + pauses, np.concatenate(parts))
    estimator.finish()
    assert estimator.report.stamp_jitter_s * 300.0 == pytest.approx(noise, rel=0.4)
