"""Angle of an event from samples beside it: value and interval, if samples are denser than the grid of shifts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.campaign import more
from textile_twin_core.comparison.event_angle import BesideEvent, event_angle
from textile_twin_core.comparison.uncertainty import Estimate

_REACH_RAD = math.radians(10.0)
_GRID_RAD = _REACH_RAD / 200.0
_RECORDS = 20


def _found(true_rad: float, samples: int, noise_Nm: float, seed: int) -> Estimate:
    """Estimate a step of 16 N m at a shift, from samples 0.02 rad around."""
    rng = np.random.default_rng(seed)
    past = rng.uniform(-0.02, 0.02, samples)
    measured = np.where(past > true_rad, 16.0, 0.0) + rng.normal(0.0, noise_Nm, samples)
    beside = BesideEvent(past, measured, np.zeros(samples), np.full(samples, 16.0))
    return event_angle(beside, noise_Nm, 0.0, _REACH_RAD)


@pytest.mark.slow
@pytest.mark.parametrize("samples", [15, *more(400)])
def test_the_interval_holds_truth_and_value(samples: int) -> None:
    """400 samples are nine to a step of the grid, 15 are a third of one.

    Fewer than 16 of 20 intervals of 95 % contain the truth once in 400 times.
    """
    rng = np.random.default_rng(samples)
    inside = 0
    for seed, true in enumerate(rng.uniform(-0.005, 0.005, _RECORDS)):
        shift = _found(float(true), samples, 0.05, seed)
        low, high = shift.interval95
        assert low < shift.value < high
        # A sharp posterior is as wide as a step of the grid, which cannot resolve less.
        assert shift.sigma >= 0.999 * _GRID_RAD / math.sqrt(12.0)
        assert high - low >= 0.9 * _GRID_RAD
        if samples == 400:
            assert high - low < 3.0 * _GRID_RAD
        inside += low <= true <= high
    assert inside >= 0.8 * _RECORDS


@pytest.mark.slow
def test_a_posterior_wider_than_the_grid_is_its_own() -> None:
    """A force grows over 2 degrees: the grid adds no width to the posterior, and errors of the shift fit its sigma."""
    shifts = []
    for seed in range(_RECORDS):
        rng = np.random.default_rng(seed)
        past = rng.uniform(-0.2, 0.2, 60)
        grown = np.array([0.5 * (1.0 + math.erf(x / math.radians(2.0) / math.sqrt(2.0))) for x in past])
        measured = 16.0 * grown + rng.normal(0.0, 1.5, past.size)
        beside = BesideEvent(past, measured, np.zeros(past.size), np.full(past.size, 16.0))
        shifts.append(event_angle(beside, 1.5, 0.0, _REACH_RAD))
    errors = np.array([shift.value / shift.sigma for shift in shifts])
    assert 0.7 < np.sqrt(np.mean(errors**2)) < 1.4
    assert np.mean([low <= 0.0 <= high for low, high in (shift.interval95 for shift in shifts)]) >= 0.85
    assert min(shift.sigma for shift in shifts) > 2.0 * _GRID_RAD
