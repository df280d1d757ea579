"""Coarse readings as intervals: against the likelihood itself, and records where rounding repeats itself."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from tests.shaft.judge import judge
from tests.shaft.shaft_signal import make_signal
from textile_twin_core.shaft.intervals import IntervalReadings

WIDTH = 0.1


def readings(sigma: float, count: int) -> np.ndarray:
    """Noisy readings of the angle 0.3412, to steps of WIDTH."""
    noisy = 0.3412 + np.random.default_rng(5).normal(0.0, sigma, count)
    return np.rint(noisy / WIDTH) * WIDTH


def minus_log_likelihood(angle: float, sigma: float, reading: np.ndarray) -> float:
    total = mp.mpf(0)
    for middle in reading.tolist():
        ends = (mp.mpf(middle) + side * mp.mpf(WIDTH) / 2 for side in (-1, 1))
        low, high = (mp.ncdf((end - angle) / sigma) for end in ends)
        total -= mp.log(high - low)
    return float(total)


@pytest.mark.parametrize("sigma", [0.015, 0.04, 0.2])
def test_weighted_means_of_linear_readings_go_to_the_likeliest_angle(sigma: float) -> None:
    reading = readings(sigma, 60)
    intervals = IntervalReadings(reading, WIDTH, np.full(60, sigma**2))
    angle = float(reading.mean())
    for _ in range(30):
        linear, variance = intervals.linear(np.full(60, angle))
        angle = float(np.sum(linear / variance) / np.sum(1.0 / variance))
    likeliest = minimize_scalar(
        lambda a: minus_log_likelihood(a, sigma, reading), bounds=(0.2, 0.5), method="bounded", options={"xatol": 1e-9}
    )
    assert angle == pytest.approx(likeliest.x, abs=1e-6)
    bend = [minus_log_likelihood(angle + d, sigma, reading) for d in (-1e-4, 0.0, 1e-4)]
    assert np.sum(1.0 / variance) == pytest.approx((bend[0] - 2 * bend[1] + bend[2]) / 1e-8, rel=1e-3)


@pytest.mark.parametrize("sigma", [0.02, 0.05])
def test_noise_is_learnt_from_what_crosses_the_edges(sigma: float) -> None:
    rng = np.random.default_rng(6)
    truth = rng.uniform(0.0, 1.0, 4000)
    reading = np.rint((truth + rng.normal(0.0, sigma, 4000)) / WIDTH) * WIDTH
    intervals = IntervalReadings(reading, WIDTH, np.full(4000, (2.5 * sigma) ** 2))
    for _ in range(25):
        intervals.learn(truth)
    assert np.sqrt(intervals.variance[0]) == pytest.approx(sigma, rel=0.05)


def test_readings_far_outside_keep_their_pull() -> None:
    intervals = IntervalReadings(np.array([0.0]), WIDTH, np.array([1e-6]))
    for fitted in (0.3, -0.3, 50.0):
        angle, variance = intervals.linear(np.array([fitted]))
        assert abs(angle[0]) == pytest.approx(WIDTH / 2, abs=2e-3)
        assert variance[0] == 1e-6
    assert intervals.outside(np.array([0.3])) == 1.0


@pytest.mark.parametrize(("bits", "allowed"), [(8, 6e-4), (10, 3e-4), (11, 2e-4), (12, 1.6e-4)])
def test_nearly_whole_steps_a_sample_are_no_harder(bits: int, allowed: float) -> None:
    """With 11 bits, 160 rpm and 500 Hz the shaft turns by 10.92 steps a sample: the rounding is hardly noise."""
    for seed in (961, 962, 963):
        found = judge("smooth", make_signal(seed, bits=bits))
        assert found.torque_rms < allowed
        assert found.report.stamp_jitter_s == pytest.approx(20e-6, rel=0.6)
        assert np.all(np.mean(np.abs(found.errors) < 5 * found.sigmas, axis=0) > 0.97)
