"""Orders of ripple beyond the leading model: the sigmas include them, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from tests.shaft.kinds import TURN
from tests.shaft.shaft_motion import Law, ShaftMotion
from textile_twin_core.shaft import create_estimator


def _inside(view: str, motion: ShaftMotion, time: np.ndarray, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shares of speeds and accelerations within one sigma, and sigmas over errors (RMS), the first fifth left out."""
    estimator = create_estimator(view)
    states = [estimator.step(time, angles), estimator.finish()][view == "smooth"]
    late = states.index > 0.2 * time.size
    _, omega, alpha = motion.at(time[states.index[late]])
    off = np.stack([states.omega_rad_s[late] - omega, states.alpha_rad_s2[late] - alpha], axis=1)
    sigma = states.sigma[late, 1:]
    return np.mean(np.abs(off) < sigma, axis=0), np.sqrt(np.mean(sigma**2, axis=0) / np.mean(off**2, axis=0))


def _turning(seed: int, ripple: tuple[float, ...], speed: float, duration_s: float) -> ShaftMotion:
    rng, dt = np.random.default_rng(seed), 1e-3
    n = int(duration_s / dt) + 1
    waves = np.array([(k + 1.0, size, rng.uniform(0.0, TURN)) for k, size in enumerate(ripple)])
    push = 0.02 * speed * np.sin(0.7 * np.arange(n) * dt)
    return ShaftMotion.solve(Law(dt, push, np.full(n, speed), 3.0, waves, np.ones(n)), rng.uniform(0.0, TURN))


@pytest.mark.parametrize("view", ["causal", "smooth"])
@pytest.mark.parametrize("samples", [5.3, 6.2, 7.3, 9.1])
def test_sigmas_include_the_orders_that_the_samples_do_not_resolve(view: str, samples: float) -> None:
    """A controller at 100 Hz, 14 bits, ripple of four orders; errors of such orders are a wave's."""
    motion = _turning(3, (0.02, 0.03, 0.01, 0.004), 100.0 * TURN / samples, 30.0)
    time = np.arange(1, 2990) / 100.0
    angles = np.round(motion.at(time)[0] / (TURN / 2**14)) * (TURN / 2**14)
    inside, ratio = _inside(view, motion, time, angles)
    assert np.all((inside > 0.4) & (ratio < 2.0))


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_no_ripple(seed: int) -> None:
    """Sigmas of an even shaft are those of its filters."""
    motion = _turning(seed, (0.0,), 15.0, 30.0)
    time = np.arange(1, 14_500) / 500.0
    noise = np.random.default_rng(seed).normal(0.0, 5e-4, time.size)
    states = create_estimator("causal").step(time, motion.at(time)[0] + noise)
    late = states.rows[2000:]
    assert np.mean(late["systematic"][:, 2] > 0.1 * late["covariance"][:, 8]) < 0.1


@pytest.mark.parametrize("seed", range(3))
def test_pitch_errors_are_no_ripple(seed: int) -> None:
    """Errors of an encoder's disc repeat every turn as well, but equally in all orders."""
    motion = _turning(seed, (0.02,), 30.0, 30.0)
    time = np.arange(1, 14_500) / 500.0
    theta, _, alpha = motion.at(time)
    errors = np.random.default_rng(seed).normal(0.0, 1e-3, 60)
    states = create_estimator("causal").step(time, theta + errors[np.floor(theta * 60.0 / TURN).astype(int) % 60])
    off = np.sqrt(np.mean((states.alpha_rad_s2[3000:] - alpha[states.index[3000:]]) ** 2))
    assert off < 0.006 * 30.0**2  # of the same errors taken for ripple: 0.03
    assert off < np.median(states.sigma[3000:, 2]) < 2.7 * off


SHAPES = {
    "impacts": ([(k, 5e-3 / k**2) for k in range(1, 25)], 60.3),
    "gear": ([(k, 1e-3 / k) for k in range(1, 7)] + [(13, 2e-4), (14, 6e-4), (15, 2e-4)], 80.7),
    "blade": ([(k, 1e-3) for k in (1, 2, 3, 4)] + [(18, 2e-3)], 100.7),
}
"""Orders and amplitudes of the angle [rad], samples a turn."""


def _waving(
    waves: list[tuple[int, float]], rate: float, samples: float, seconds: float, seed: int
) -> tuple[np.ndarray, ...]:
    """Time, angle, speed, acceleration of a shaft whose angle waves in these orders."""
    rng, speed = np.random.default_rng(seed), rate * TURN / samples
    time = np.arange(1, int(rate * seconds)) / rate
    even = speed * time - 0.02 * speed / 0.7 * np.cos(0.7 * time)
    rate_of, bend = speed * (1.0 + 0.02 * np.sin(0.7 * time)), 0.02 * speed * 0.7 * np.cos(0.7 * time)
    order, size = np.array(waves).T
    angle = np.outer(even, order) + rng.uniform(0.0, TURN, order.size)
    slope, curve = 1.0 + np.cos(angle) @ (size * order), -np.sin(angle) @ (size * order**2)
    return time, even + np.sin(angle) @ size, rate_of * slope, bend * slope + rate_of**2 * curve


@pytest.mark.parametrize("view", ["causal", "smooth"])
@pytest.mark.parametrize("shape", SHAPES)
def test_impacts_and_gears_are_no_errors_of_the_sensor(shape: str, view: str) -> None:
    """Significant orders above the twelfth, falling or alone, are modelled: acceleration, ripple, sigmas."""
    waves, samples = SHAPES[shape]
    time, theta, _, alpha = _waving(waves, 500.0, samples, 20.0, 0)
    estimator = create_estimator(view)
    noise = np.random.default_rng(1).normal(0.0, 2e-5, time.size)
    states = [estimator.step(time, theta + noise), estimator.finish()][view == "smooth"]
    told, truth = np.array(estimator.report.ripple[:4]), [order * size for order, size in waves[:4]]
    assert np.allclose(told, truth, rtol=0.1)
    late = states.index > 3000
    off = np.abs(states.alpha_rad_s2 - alpha[states.index])[late]
    assert np.sqrt(np.mean(off**2)) < 0.05 * np.std(alpha)
    assert 0.3 < np.mean(off < states.sigma[late, 2]) < 0.9


def _disc(theta: np.ndarray, cells: int, seed: int) -> np.ndarray:
    """Errors of 1 mrad of a disc."""
    return np.random.default_rng(seed).normal(0.0, 1e-3, cells)[np.floor(theta * cells / TURN).astype(int) % cells]


def test_the_sensors_errors_stay_known_where_a_turn_has_few_samples() -> None:
    """A record that ends at twice its speed; taken for ripple the errors are an acceleration of 110."""
    rate, time = 500.0, np.arange(1, 20_000) / 500.0
    slow, fast = rate * TURN / 60.7, rate * TURN / 29.0
    ramp = np.clip(time - 36.0, 0.0, 1.0)
    speed = slow + (fast - slow) * ramp**2 * (3.0 - 2.0 * ramp)
    past = np.maximum(time - 37.0, 0.0)
    even = slow * time + (fast - slow) * (ramp**3 - 0.5 * ramp**4 + past)
    theta = even + 0.02 * np.sin(even)
    bend = 6.0 * (fast - slow) * ramp * (1.0 - ramp)
    alpha = bend * (1.0 + 0.02 * np.cos(even)) - speed**2 * 0.02 * np.sin(even)
    estimator = create_estimator("smooth")
    estimator.step(time, theta + _disc(theta, 60, 1) + np.random.default_rng(2).normal(0.0, 1e-4, time.size))
    states = estimator.finish()
    kept = (states.index > 2500) & (states.index < 17_750)
    assert np.sqrt(np.mean((states.alpha_rad_s2 - alpha[states.index])[kept] ** 2)) < 20.0


@pytest.mark.parametrize("phase", range(4))
def test_readings_that_are_repeated_hide_no_errors_of_the_sensor(phase: int) -> None:
    """Each fourth reading is new, at any place; taken for ripple: 10."""
    time, theta, _, alpha = _waving([(1, 0.02), (2, 3e-3)], 1000.0, 418.9, 40.0, 1)
    readings = theta + _disc(theta, 60, 3) + np.random.default_rng(4).normal(0.0, 1e-4, time.size)
    place = np.arange(time.size)
    states = create_estimator("causal").step(time, readings[np.maximum(place - (place - phase) % 4, 0)])
    new = ((states.index - phase) % 4 == 0) & (states.index > 20_000)
    assert np.sqrt(np.mean((states.alpha_rad_s2 - alpha[states.index])[new] ** 2)) < 2.0
