"""Readings that are wrong by half a radian, against known truth: the estimate is told to be in doubt, or is right."""

from __future__ import annotations

import numpy as np
import pytest

from tests.shaft.kinds import make
from textile_twin_core.shaft import ESTIMATORS, ShaftStates, create_estimator

HARD = (12, 17, 23, 43, 46, 187, 218, 237, 290, 317)
"""Records of few samples a turn in which two or three outliers meet a start, a stop or each other."""


@pytest.mark.parametrize("view", ESTIMATORS)
@pytest.mark.parametrize("seed", [*HARD, *range(2000, 2010)])
def test_a_settled_speed_is_never_off_by_half(view: str, seed: int) -> None:
    record = make("coarse+3%", seed)
    estimator = create_estimator(view)
    parts = [estimator.step(record.time_s, record.fed_rad), estimator.finish()]
    states = ShaftStates.join([part for part in parts if len(part)])
    late = states.settled & (states.index > 0.15 * record.time_s.size)
    truth = record.omega[states.index]
    least = np.maximum(np.abs(truth), 0.3 * np.abs(record.omega).max())
    assert np.all(np.abs(states.omega_rad_s - truth)[late] < 0.5 * least[late])
    assert np.mean(late) > 0.7


def test_as_many_readings_must_fit_as_did_not() -> None:
    stamps, angles = np.arange(400) * 2_000_000, np.arange(400) * 0.03
    angles[200] += 0.5
    states = create_estimator("causal").step(stamps, angles)
    assert states.index[~states.settled & (states.index > 100)].tolist() == [200, 201]


def test_outliers_on_both_sides_of_the_motion_are_no_motion() -> None:
    stamps, angles = np.arange(400) * 2_000_000, np.arange(400) * 0.03
    angles[200:203] += 0.5, 0.02, -0.46  # on a line, as a shaft that turned back at once would show
    estimator = create_estimator("causal")
    states = estimator.step(stamps, angles)
    assert estimator.report.outliers == 3
    assert np.allclose(states.omega_rad_s[states.index > 100], 15.0, rtol=1e-3)


@pytest.mark.parametrize("view", ["causal", "smooth"])
@pytest.mark.parametrize("seed", [19, 39, 133, 135, 175, 199, 249, 274, 323])
def test_speeds_above_all_that_were_seen_take_more_to_be_believed(seed: int, view: str) -> None:
    """Outliers on one side that follow a line look like speeds of many times full speed, of which a quarter is much."""
    rng, time = np.random.default_rng([11, seed]), np.arange(20_000) * 1e-3
    top = rng.uniform(10.0, 25.0)
    knots = np.cumsum(rng.uniform(0.5, 2.0, 20))
    omega = np.interp(time, knots, np.repeat(rng.choice((0.0, 0.0, 1.0, 0.5), 10), 2) * top)
    step = 2.0 * np.pi / 2**13
    angles = np.round(np.cumsum(omega) * 1e-3 / step) * step
    angles += np.where(rng.random(time.size) < 0.03, rng.uniform(0.0, 0.5, time.size), 0.0)
    estimator = create_estimator(view)
    states = [estimator.step(time, angles), estimator.finish()][view == "smooth"]
    off = np.abs(states.omega_rad_s - omega[states.index])[states.settled & (states.index > 2000)]
    assert off.max() < top
