"""Measurement noise: the number of readings that count as one, and the error of the stamps."""

from __future__ import annotations

import numpy as np
import pytest

from tests.generators.mill_recordings import healthy, record
from textile_twin_core.shaft import ShaftStates, create_estimator
from textile_twin_core.shaft.encoder import encoder_step
from textile_twin_core.shaft.measurement_noise import MOST_CORRELATED, set_correlated
from textile_twin_core.shaft.settings import ShaftSettings
from textile_twin_core.shaft.status import new_status


@pytest.mark.parametrize(
    ("steps", "bend", "jitter", "count"),
    [
        (0.0, 0.0, 0.0, MOST_CORRELATED),
        (0.1, 0.0, 0.0, 5.0),
        (3.1, 0.0, 0.0, 5.0),
        (2.9, 0.0, 0.0, 5.0),
        (0.4, 0.0, 0.0, 1.25),
        (0.5, 0.0, 0.0, 1.0),
        (0.0, 0.02, 0.0, 5.0),
        (3.1, 0.0, 0.1, 1.0 + 4.0 * np.exp(-4.0 * np.pi**2 * 0.01)),
        (3.0, 0.0, 1.0, 1.0),
    ],
)
def test_half_the_readings_until_the_shaft_moved_by_a_step_count_as_one(
    steps: float, bend: float, jitter: float, count: float
) -> None:
    """Parameters in steps of the encoder: the move per reading, its change per reading, and the jitter."""
    status = new_status(ShaftSettings(resolution_rad=1e-3))[0]
    noise, track = status["noise"], status["track"]
    track["speed"], track["acceleration"] = steps * 0.1, bend * 10.0
    noise["jitter"] = (jitter * 1e-3 / (steps * 0.1)) ** 2 if jitter else 0.0
    set_correlated(noise, track, 0.01)
    assert float(noise["correlated"]) == pytest.approx(count, rel=1e-9)


@pytest.mark.parametrize("seed", [2003, 2007])
def test_the_stamps_error_of_a_mills_recording_is_estimated(seed: int) -> None:
    """14 bits, stamps off by 20 us: a step of rounding that readings share is no jitter."""
    made = record(healthy("tufting", seed, duration_s=30.0))
    estimator = create_estimator("causal")
    estimator.step(made.angle_stamps_ns, made.angle)
    assert estimator.report.stamp_jitter_s == pytest.approx(20e-6, rel=0.25)


def test_the_step_of_a_shaft_that_hardly_moves_is_found() -> None:
    """Among 768 readings too few differ: the differing ones are stored for the next search."""
    time, step = np.arange(6000) * 1e-3, 2.0 * np.pi / 4096
    estimator = create_estimator("causal")
    estimator.step(time, np.round(0.004 * time * 1e3) * step)
    assert estimator.report.resolution_rad == pytest.approx(step, rel=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_outliers_at_standstill_do_not_hide_the_encoders_step(seed: int) -> None:
    """Outliers as frequent as repeated values: the readings must still count as rounded."""
    rng, step = np.random.default_rng(seed), 2.0 * np.pi / 4096.0
    angles = np.round(5.0 * np.sin(np.arange(768) * 0.02)) * step
    wrong = rng.random(angles.size) < 0.03
    angles[wrong] += rng.uniform(-0.5, 0.5, wrong.sum())
    assert encoder_step(np.arange(768.0), angles) == pytest.approx(step, rel=1e-9)


@pytest.mark.parametrize("move", [2.0, 4.37, 5.1])
def test_the_step_of_angles_that_do_not_wrap_need_not_divide_a_turn(move: float) -> None:
    angles = np.round(move * (np.arange(192) + 0.3 * np.sin(np.arange(192))) / 0.01) * 0.01
    assert encoder_step(np.arange(192.0), angles) == pytest.approx(0.01, rel=1e-9)


@pytest.mark.parametrize("steps", [2.01, 2.03, 3.03])
def test_a_shaft_in_step_with_its_encoder_shows_the_step_by_rare_moves(steps: float) -> None:
    """The shaft turns by whole steps between readings: one in 30 to 100 is a step off, an outlier among equal moves."""
    step, time = 2.0 * np.pi / 4096, np.arange(1, 8000) / 1000.0
    speed = steps * step * 1000.0
    estimator = create_estimator("causal")
    states = estimator.step(time, np.floor((speed * time + 1.0 + 0.3 * step * np.sin(2.0 * time)) / step) * step)
    assert estimator.report.resolution_rad == pytest.approx(step, rel=1e-9)
    late = states.index > 4000
    truth = speed + 0.6 * step * np.cos(2.0 * time[states.index[late]])
    assert np.sqrt(np.mean((states.omega_rad_s[late] - truth) ** 2)) < 3e-4 * speed


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("view", ["causal", "lag", "smooth"])
def test_a_noisy_past_is_soon_forgotten(view: str, seed: int) -> None:
    """Noise that falls to a hundredth: ripple that was insignificant beside it becomes visible."""
    rng, time = np.random.default_rng([90, seed]), np.arange(5000) * 1e-3
    phases = rng.uniform(0.0, 2.0 * np.pi, 3)
    orders, sizes = np.array([1.0, 2.0, 3.0]), np.array([0.05, 0.015, 0.0007])
    angle = 40.0 * time[:, None] * orders + phases
    theta, omega = 40.0 * time + np.sin(angle) @ sizes, 40.0 * (1.0 + np.cos(angle) @ (orders * sizes))
    readings = theta + np.where(time < 1.5, 1e-2, 1e-4) * rng.normal(size=time.size)
    fresh = _speed_error(view, time[1500:], readings[1500:], omega[1500:])
    assert _speed_error(view, time, readings, omega) < 3.0 * fresh


def _speed_error(view: str, time: np.ndarray, readings: np.ndarray, omega: np.ndarray) -> float:
    """RMS over the last two seconds."""
    estimator = create_estimator(view)
    states = ShaftStates.join([part for part in (estimator.step(time, readings), estimator.finish()) if len(part)])
    late = time[states.index] > time[-1] - 2.0
    return float(np.sqrt(np.mean((states.omega_rad_s - omega[states.index])[late] ** 2)))
