"""Outliers of half a radian, against known truth: the estimate is right, or reported as unsettled."""

from __future__ import annotations

import numpy as np
import pytest

from tests.campaign import more
from tests.shaft.kinds import make
from tests.shaft.shaft_motion import rippling
from textile_twin_core.shaft import ESTIMATORS, ShaftStates, create_estimator

HARD = (12, 17, 23, 43, 46, 187, 218, 237, 290, 317)
"""Records of few samples a turn in which two or three outliers meet a start, a stop or each other."""


@pytest.mark.parametrize("view", ESTIMATORS)
@pytest.mark.parametrize("seed", [*HARD[:4], *more(*HARD[4:], *range(2000, 2010))])
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


@pytest.mark.parametrize("seed", range(4))
def test_outliers_on_one_side_that_follow_no_line_are_no_motion(seed: int) -> None:
    """Accepted as motion, three of them would give a speed wrong by some hundred rad/s."""
    rng, time, step = np.random.default_rng(seed), np.arange(4000) / 500.0, 2.0 * np.pi / 4096
    angles = np.round((20.0 * time + 0.02 * np.sin(20.0 * time)) / step) * step
    for place in range(300, 3900, 120):
        angles[place : place + 3] += np.array([0.5, 0.1, 0.45]) * rng.uniform(0.7, 1.0, 3)
    estimator = create_estimator("causal")
    states = estimator.step(time, angles)
    assert (estimator.report.outliers, estimator.report.jumps) == (90, 0)
    off = states.omega_rad_s - 20.0 - 0.4 * np.cos(20.0 * time[states.index])
    assert np.abs(off[states.index > 200]).max() < 0.1


@pytest.mark.parametrize("view", ["causal", "smooth"])
@pytest.mark.parametrize("seed", [19, 39, 133, 135, 175, 199, 249, 274, 323])
def test_speeds_above_the_highest_need_more_readings(seed: int, view: str) -> None:
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


@pytest.mark.parametrize("wild", [8.5, 20.0, -1000.0])
def test_a_reading_beyond_the_turn_does_not_end_unwrapping(wild: float) -> None:
    """A single reading does not extend the range that decides wrapping; otherwise each turn was a discontinuity."""
    time, step = np.arange(5000) / 500.0, 2.0 * np.pi / 4096
    angles = np.round(17.0 * time / step) * step % (2.0 * np.pi)
    angles[1000] = wild
    estimator = create_estimator("causal")
    states = estimator.step(time, angles)
    assert (estimator.report.jumps, estimator.report.outliers) == (0, 1)
    assert abs(states.theta_rad[-1] - 17.0 * time[-1]) < 2.0 * step


@pytest.mark.parametrize(("speed", "rate_hz"), [(400.0, 100.0), (1000.0, 50.0), (-400.0, 50.0)])
def test_an_angle_with_steps_of_more_than_half_a_turn_keeps_its_turns(speed: float, rate_hz: float) -> None:
    """Its first readings show that it is not wrapped; the turns added until then are removed."""
    time = np.arange(2000) / rate_hz
    states = create_estimator("causal").step(time, 3.0 + speed * time)
    assert np.allclose(states.theta_rad[50:], 3.0 + speed * time[states.index[50:]], rtol=0.0, atol=1e-6)
    assert np.allclose(states.omega_rad_s[50:], speed)


@pytest.mark.parametrize("place", range(23, 30))
def test_no_place_of_a_wrong_reading_hides_the_ripple(place: int) -> None:
    """Once the noise is known the ripple returns to its prior covariance, with the next reading if one is wrong."""
    time, step = np.arange(2000) / 1000.0, 2.0 * np.pi / 2**17
    theta, _, alpha = rippling(50.0 * time, 50.0, 0.0, 0.05)
    angles = np.round(theta / step) * step
    angles[place] += 0.5
    states = create_estimator("causal").step(time, angles)
    late = states.index > 500
    assert np.sqrt(np.mean((states.alpha_rad_s2 - alpha[states.index])[late] ** 2)) < 0.5


@pytest.mark.parametrize(("view", "most"), [("lag", 1.0), ("smooth", 0.01)])
def test_three_outliers_on_one_side_are_no_motion_once_the_old_motion_continues(view: str, most: float) -> None:
    """Accepted as a manoeuvre, as the causal view may, they gave a speed of 170 rad/s for 12."""
    time, step = np.arange(1600) * 0.0025, 2.0 * np.pi / 4096
    readings = np.floor(12.0 * time / step) * step
    readings[800:803] += (-0.27, -0.27, -0.21)
    estimator = create_estimator(view)
    states = [estimator.step(time, readings), estimator.finish()][view == "smooth"]
    around = np.abs(states.index - 801) < 40
    assert np.abs(states.omega_rad_s[around] - 12.0).max() < most
