"""Counters that pass their end: widths, ranges, units and clocks from a generator."""

from __future__ import annotations

import numpy as np
import pytest

from textile_twin_core.recordings.counter import BITS, CounterUnwrapper, find_counter, unwrap_counter


def wrapped(true: np.ndarray, bits: int, signed: bool) -> np.ndarray:
    """Whole counts in the range of a counter."""
    low = -(2 ** (bits - 1)) if signed else 0
    return np.asarray((true - low) % 2**bits + low)


def shaft_counts(bits: int, start: float, seed: int) -> np.ndarray:
    """Counts of an encoder that runs up, reverses and passes the end of its counter several times."""
    random = np.random.default_rng(seed)
    k = np.arange(4000)
    speed = 2.0**bits / 900.0 * np.interp(k, [0, 800, 2500, 2900, 4000], [0.0, 1.0, 1.0, -0.7, -0.7])
    ripple = 0.2 * speed * np.sin(0.05 * k + random.uniform(0.0, 6.0))
    return np.rint(start * 2.0**bits + np.cumsum(speed + ripple)).astype(np.int64)


@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize("seed", range(5))
def test_wraps_of_an_angle_counter_are_found_and_undone(bits: int, signed: bool, seed: int) -> None:
    true = shaft_counts(bits, np.random.default_rng(seed).uniform(0.0, 1.0), seed)
    logged = wrapped(true, bits, signed)
    found = find_counter(logged.astype(np.float64))
    assert found is not None and (found.bits, found.signed) == (bits, signed)
    undone = unwrap_counter(logged, found.width)
    assert np.array_equal(undone - undone[0], true - true[0])
    live = CounterUnwrapper([2**each for each in BITS])
    assert np.array_equal([live.step(int(value)) for value in logged], undone)
    known = CounterUnwrapper([2**bits], known=True)
    assert np.array_equal([known.step(int(value)) for value in logged], undone)
    assert live.width == 2**bits and live.wraps == known.wraps == found.wraps


@pytest.mark.parametrize(
    ("bits", "count_s", "unit_s", "step_s"),
    [
        (32, 1e-6, 1e-6, 2e-3),  # micros() of a controller
        (32, 1e-6, 1.0, 2e-3),  # the same, logged in seconds
        (32, 1e-9, 1e-9, 1e-3),
        (32, 1e-3, 1e-3, 2e-3),
        (16, 25e-6, 25e-6, 2e-3),  # every 1.6 s
        (16, 1e-3, 1e-3, 1e-3),
        (16, 1e-6, 1e-3, 5e-4),  # every 65 ms
    ],
)
@pytest.mark.parametrize("signed", [False, True])
def test_wraps_of_a_time_counter_are_found_and_undone(
    bits: int, count_s: float, unit_s: float, step_s: float, signed: bool
) -> None:
    random = np.random.default_rng(bits)
    true = np.rint(np.cumsum(step_s * (1.0 + 0.02 * random.standard_normal(5000))) / count_s).astype(np.int64)
    low = -(2 ** (bits - 1)) if signed else 0
    true += (low + 2**bits) - true[1700]  # passes the end there at the latest
    logged = wrapped(true, bits, signed) * (count_s / unit_s)
    found = find_counter(np.array([float(f"{value:.12g}") for value in logged]))
    assert found is not None and found.bits == bits
    assert np.allclose(np.diff(unwrap_counter(logged, found.width)), np.diff(true) * (count_s / unit_s), atol=1e-9)


def test_stamps_in_nanoseconds_stay_exact() -> None:
    true = 2**32 * 1000 - 1_000_000_000 + 2_000_000 * np.arange(1000, dtype=np.int64)
    logged = true % (2**32 * 1000)
    found = find_counter(logged, [1000.0])
    assert found is not None and found.wraps == 1 and found.width == 2**32 * 1000
    assert np.array_equal(unwrap_counter(logged, found.width), true)


@pytest.mark.parametrize(
    "values",
    [
        np.mod(37.0 * np.arange(3000), 4096.0),  # a turn
        np.concatenate([np.arange(40000.0, 65000.0, 10.0), np.arange(0.0, 20000.0, 10.0)]),  # a reset before the end
        np.concatenate([np.arange(0.0, 64800.0, 36.0), np.arange(30000.0)]),  # a log begun again
        np.mod(0.031 * np.arange(3000), 2.0 * np.pi),
        np.random.default_rng(3).integers(0, 65536, 3000).astype(np.float64),  # no counter at all
        np.linspace(0.0, 1e9, 4000),
        np.full(100, np.nan),
    ],
)
def test_other_records_have_no_counter(values: np.ndarray) -> None:
    assert find_counter(values) is None


def test_missing_readings_and_an_outlier_are_passed_over() -> None:
    true = 100_000 + 36 * np.arange(5000)
    logged = wrapped(true, 16, False).astype(np.float64)
    logged[[100, 2000]] = np.nan
    logged[3000] = 0.0
    found = find_counter(logged)
    assert found is not None and found.bits == 16
    undone = unwrap_counter(logged, found.width)
    good = np.isfinite(logged) & (np.arange(5000) != 3000)
    assert np.array_equal((undone - undone[0])[good], (true - true[0])[good])
    live = CounterUnwrapper([65536.0])
    assert np.array_equal(np.array([live.step(float(value)) for value in logged])[good], undone[good])
