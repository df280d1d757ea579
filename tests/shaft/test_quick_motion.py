"""Motion that changes within a few samples: as good as the textbook's filter, and its sigma is that of the errors."""

from __future__ import annotations

import numpy as np
import pytest

from tests.shaft.kinds import TURN
from tests.shaft.textbook import textbook
from textile_twin_core.shaft import create_estimator
from textile_twin_core.shaft.measurement_noise import adapt_jitter, least_scale
from textile_twin_core.shaft.settings import ShaftSettings
from textile_twin_core.shaft.status import new_status

RATE, FINE, NOISE = 1400.0, 20, 2e-4


def pushed(seed: int, count: int, push: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, states (count, 3) and readings of a shaft at 300 rad/s under pushes of about five samples.

    `push` is their acceleration [rad per sample squared]; the speed goes back to its mean within fifty samples.
    """
    rng, h = np.random.default_rng(seed), 1.0 / RATE / FINE
    kicks = push * RATE**2 * np.sqrt(2.0 / FINE / 5.0) * rng.normal(size=count * FINE)
    states = np.zeros((count * FINE, 3))
    theta, omega, pull = 0.0, 300.0, 0.0
    for i, kick in enumerate(kicks):
        alpha = pull - (omega - 300.0) * RATE / 50.0
        states[i] = theta, omega, alpha
        theta, omega = theta + h * omega + 0.5 * h * h * alpha, omega + h * alpha
        pull += kick - pull / 5.0 / FINE
    states = states[::FINE]
    return np.arange(count) / RATE, states, states[:, 0] + NOISE * rng.normal(size=count)


@pytest.mark.parametrize("view", ["causal", "smooth"])
@pytest.mark.parametrize("push", [2.5e-3, 1e-3, 4e-4])
def test_filters_of_short_memory_estimate_their_own_noise(push: float, view: str) -> None:
    """The first guess of the noise is some hundred times too large; the tuned filter looks back 0.5, 0.7, 1 samples."""
    ratios = []
    for seed in range(6):
        time, states, readings = pushed(seed, 800, push)
        estimator = create_estimator(view)
        found = [estimator.step(time, readings), estimator.finish()][view == "smooth"]
        late = found.index > 120
        rows, book = found.index[late], getattr(textbook(time, readings), view)
        off = np.stack([found.theta_rad, found.omega_rad_s, found.alpha_rad_s2], axis=1)[late] - states[rows]
        ratios.append(np.sqrt(np.mean(off**2, axis=0) / np.mean((book[rows] - states[rows]) ** 2, axis=0)))
    assert np.all(np.median(ratios, axis=0) < 1.15)


@pytest.mark.parametrize(("push", "error"), [(2.5e-3, 1e-3), (2.5e-3, 3e-3), (1e-3, 1e-3)])
def test_what_a_filter_follows_is_not_unmodelled(push: float, error: float) -> None:
    """An encoder's errors, 28 to the turn, show in the innovations; a filter that looks back a sample takes them in."""
    inside = []
    for seed in range(6):
        time, states, readings = pushed(seed, 1500, push)
        errors = np.random.default_rng([seed, 1]).normal(0.0, error, 28)
        readings += errors[np.rint(readings * 28.0 / TURN).astype(int) % 28]
        found = create_estimator("causal").step(time, readings)
        late = found.index > 300
        off = found.omega_rad_s[late] - states[found.index[late], 1]
        inside.append(np.mean(np.abs(off) < found.sigma[late, 1]))
    assert 0.55 < np.median(inside) < 0.8


@pytest.mark.parametrize("seed", range(3))
def test_an_arm_that_stops_does_not_run_on(seed: int) -> None:
    """Read at 50 Hz in steps of 0.1 mrad, by stamps 0.25 ms late, 1 rad/s and 10 rad/s^2, oscillating with standstills.

    The noise of late stamps goes with the speed; as the process noise went with it, speeds ran on to 0.6 to 1.4 rad/s.
    """
    rng, fine = np.random.default_rng(seed), np.arange(0.0, 60.0, 1e-4)
    speed = np.clip(14.5 - 10.0 * np.abs(fine % 4.5 - 2.25), 0.0, 1.0) * np.where(fine % 9.0 < 4.5, 1.0, -1.0)
    speed[np.abs(speed) < 0.3] = 0.0
    time = np.arange(0.0, 59.9, 0.02)
    seen = np.interp(time + rng.normal(0.0, 2.5e-4, time.size), fine, np.cumsum(speed) * 1e-4)
    states = create_estimator("causal").step(time, np.round(seen / 1e-4) * 1e-4)
    at_rest = np.convolve(np.interp(time, fine, speed) == 0.0, np.ones(6))[: time.size][states.index] == 6.0
    assert np.abs(states.omega_rad_s[at_rest & (states.index > 300)]).max() < 0.1


def test_stamps_are_no_later_than_by_an_interval() -> None:
    """The residual of a decaying swing would be late stamps: 25 ms late, at intervals of 4 ms."""
    status = new_status(ShaftSettings())[0]
    status["track"]["speed"], status["bank"]["filters"]["scale"] = 1e-4, 1.0
    adapt_jitter(status["bank"], status["noise"], status["track"], 4e-3, 1e-8)
    assert 0.0 < status["noise"]["jitter"] <= 4e-3**2


def test_late_stamps_make_no_standstill() -> None:
    """Late by half an interval, a turning shaft's readings kept that variance to the end of the record."""
    noise = new_status(ShaftSettings(resolution_rad=1e-4))["noise"][0]
    noise["jitter"], noise["correlated"] = 2e-3**2, 1.0
    assert least_scale(noise, 10.0, 4e-3, 0.02**2) < 0.01
