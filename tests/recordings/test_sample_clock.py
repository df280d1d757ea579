"""Stamps in bursts: detected, named with their numbers, and replaced by the times at which samples were taken."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.generators.bridged_samples import FROM_S, Sampled, bridged, sampled
from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.recordings.sample_clock import EvenTimes, even_times, find_bursts, sampling_period

PATTERNS = tuple(itertools.product((200.0, 500.0, 1000.0), (0.004, 0.016, 0.020, 0.050), (2e-6, 2e-4, 5e-4)))


def error_ms(stamps: IntArray, times_s: FloatArray) -> FloatArray:
    """Distance of stamps [ns] from the true times [s], in ms."""
    return np.asarray((stamps * 1e-9 - FROM_S - times_s) * 1e3)


@pytest.mark.parametrize(("rate", "period_s", "inside_s"), PATTERNS)
def test_angles_stamped_in_bursts_have_their_true_times_within_the_interval(
    rate: float, period_s: float, inside_s: float
) -> None:
    samples = bridged(sampled(rate, 6.0), period_s, inside_s, "angle")
    found = even_times(samples.angle_stamps, samples.angle, angles=True)
    assert isinstance(found, EvenTimes)
    assert found.period_s == pytest.approx(1.0 / rate, rel=1e-4)
    error = error_ms(found.times_ns, samples.angle_s)
    assert np.abs(error).max() < found.half_width_s * 1e3 + 0.2
    assert np.std(error) < 0.15


@pytest.mark.parametrize(("rate", "period_s", "inside_s"), PATTERNS[::4])
def test_torque_in_bursts_is_placed_by_the_period_of_right_angles(
    rate: float, period_s: float, inside_s: float
) -> None:
    samples = bridged(sampled(rate, 6.0), period_s, inside_s, "torque")
    near = sampling_period(samples.angle_stamps)
    found = even_times(samples.torque_stamps, samples.torque_Nm, angles=False, period_s=near)
    assert isinstance(found, EvenTimes)
    error = error_ms(found.times_ns, samples.torque_s)
    assert abs(error.mean()) < found.half_width_s * 1e3 + 0.2
    assert np.std(error) < 0.5 * 1e3 / rate  # a lost sample shows in no torque: its burst is known to a sample or so


VARIANTS = {
    "late by up to a millisecond": (sampled(500.0, 8.0), {"late_s": 5e-4}, 0.3),
    "many lost samples": (sampled(500.0, 8.0, lost=0.05), {}, 0.3),
    "unwrapped angle": (sampled(500.0, 8.0, wrapped=False), {}, 0.2),
    "run-up": (sampled(500.0, 8.0, run_up_s=5.0), {}, 0.2),
    "jittered sampling": (sampled(500.0, 8.0, jitter_s=1e-4), {}, 0.5),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_variants_of_the_bridge(name: str) -> None:
    samples, options, beyond_ms = VARIANTS[name]
    samples = bridged(samples, 0.0163, 2e-4, "angle", **options)
    found = even_times(samples.angle_stamps, samples.angle, angles=True)
    assert isinstance(found, EvenTimes)
    error = np.abs(error_ms(found.times_ns, samples.angle_s))
    assert np.percentile(error, 97.0) < found.half_width_s * 1e3 + beyond_ms


def test_a_clock_of_100_hz_repeats_its_stamps_and_widens_the_interval() -> None:
    right = sampled(500.0, 6.0)
    ticks = np.floor((right.angle_s + FROM_S) * 100.0) / 100.0
    stamps = np.round(ticks * 1e9).astype(np.int64)
    found = even_times(stamps, right.angle, angles=True)
    assert isinstance(found, EvenTimes)
    assert found.bursts.repeated
    assert found.half_width_s >= 0.005
    assert np.abs(error_ms(found.times_ns, right.angle_s)).max() < 1e3 * found.half_width_s
    assert np.std(error_ms(found.times_ns, right.angle_s)) < 0.15


def test_the_pattern_is_described_with_its_numbers() -> None:
    stamps = np.concatenate([np.arange(8) * 71_429 + k * 16_000_000 for k in range(100)])
    bursts = find_bursts(stamps)
    assert bursts is not None
    assert bursts.text == "8 samples within 0.5 ms, then 15.5 ms: stamped on arrival"
    assert bursts.period_s == pytest.approx(0.016)


def _right(samples: Sampled) -> tuple[IntArray, FloatArray]:
    return samples.angle_stamps, samples.angle


@pytest.mark.parametrize(
    "options",
    [{}, {"lost": 0.15}, {"lost": 0.3}, {"jitter_s": 4e-4}, {"run_up_s": 5.0}, {"wrapped": False, "lost": 0.06}],
)
def test_right_stamps_stay(options: dict[str, float]) -> None:
    assert even_times(*_right(sampled(500.0, 6.0, **options)), angles=True) is None  # type: ignore[arg-type]


def test_samples_that_are_taken_in_bursts_keep_their_stamps() -> None:
    number = np.arange(2400)
    time = 0.016 * (number // 8) + 2e-4 * (number % 8)
    stamps = np.round((FROM_S + time) * 1e9).astype(np.int64)
    assert find_bursts(stamps) is not None
    assert even_times(stamps, 16.0 * time, angles=True) is None


def test_few_samples_and_equal_stamps_say_nothing() -> None:
    assert find_bursts(np.zeros(0, np.int64)) is None
    assert find_bursts(np.zeros(500, np.int64)) is None
    assert find_bursts(np.arange(20) * 2_000_000) is None


def test_rows_that_a_logger_wrote_twice_are_no_bursts() -> None:
    """Every tenth row stands twice."""
    stamps = np.repeat(np.arange(20_000) * 2_000_000, np.where(np.arange(20_000) % 10, 1, 2))
    assert find_bursts(stamps, uneven=True) is None
