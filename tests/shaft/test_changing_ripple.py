"""A ripple that changes with the speed, as that of a machine with gravity, load and a drive with slip."""

from __future__ import annotations

import numpy as np
import pytest

from tests.campaign import more
from tests.shaft.shaft_motion import Law, ShaftMotion
from tests.shaft.textbook import textbook
from textile_twin_core.shaft import create_estimator

TURN = 2.0 * np.pi
STEP = TURN / 2**14
TAKES_S, AFTER_S = 3.0, 60.0
"""Times that the machine takes to change its speed, and stays at the new speed."""


def motion(seed: int, change_s: float) -> ShaftMotion:
    rng = np.random.default_rng([seed, 5])
    time = np.arange(0.0, change_s + AFTER_S, 5e-4)
    x = np.clip((time - change_s) / TAKES_S, 0.0, 1.0)
    changed = x * x * (3.0 - 2.0 * x)
    speed = rng.uniform(60.0, 150.0) * TURN / 60.0 * (1.0 + 0.3 * changed)
    depth = 1.0 + rng.choice((-0.5, -0.3, 0.3, 0.6)) * changed
    waves = np.array([(order, size, rng.uniform(0.0, TURN)) for order, size in ((1.0, 4e-3), (2.0, 6e-3), (3.0, 1e-3))])
    return ShaftMotion.solve(Law(5e-4, np.zeros(time.size), speed, 20.0, waves, depth), 0.3)


def beside_the_textbook(view: str, seed: int, change_s: float, first_s: float, last_s: float) -> float:
    """Error of the acceleration between two times over that of the textbook's tuned on the record."""
    shaft, time = motion(seed, change_s), np.arange(1, int(500.0 * (change_s + AFTER_S)) - 100) / 500.0
    stamps = time + 5e-6 * np.random.default_rng(seed).normal(size=time.size)
    read, truth = np.round(shaft.at(time)[0] / STEP) * STEP, shaft.at(stamps)[2]
    estimator = create_estimator(view)
    states = [estimator.step(stamps, np.mod(read, TURN)), estimator.finish()][view == "smooth"]
    counts = (time[states.index] > first_s) & (time[states.index] < last_s)
    rows, book = states.index[counts], getattr(textbook(stamps, read), view)
    off = states.alpha_rad_s2[counts] - truth[rows]
    return float(np.sqrt(np.mean(off**2) / np.mean((book[rows, 2] - truth[rows]) ** 2)))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, *more(1, 2, 3)])
def test_smooth_knows_each_parts_own_ripple(seed: int) -> None:
    assert beside_the_textbook("smooth", seed, 60.0, 20.0, 59.0) < 0.7
    assert beside_the_textbook("smooth", seed, 60.0, 80.0, 119.0) < 0.7


def test_states_near_a_boundary_use_both_parts() -> None:
    assert beside_the_textbook("smooth", 2, 60.0, 60.0, 119.0) < 0.4


@pytest.mark.parametrize("seed", [0, *more(1, 2, 3)])
def test_the_causal_view_soon_estimates_the_new_ripple(seed: int) -> None:
    """The time at the previous speed does not matter."""
    assert beside_the_textbook("causal", seed, 300.0, 310.0, 350.0) < 0.3


@pytest.mark.parametrize(("view", "seed"), [("smooth", 15), *more(("causal", 15), ("smooth", 27))])
def test_orders_of_the_change_alone_are_dropped(view: str, seed: int) -> None:
    """A model of fewer orders that predicts as well leads again."""
    assert beside_the_textbook(view, seed, 60.0, 80.0, 119.0) < 0.2


@pytest.mark.parametrize(("view", "most"), [("causal", 0.05), ("smooth", 0.12)])
@pytest.mark.parametrize("seed", [6, *more(9, 16)])
def test_known_orders_are_taken_over(view: str, most: float, seed: int) -> None:
    """Models start from the leading one; models that had to estimate all orders again gave .06 to .12, and .2 to .4."""
    assert beside_the_textbook(view, seed, 60.0, 80.0, 119.0) < most


def test_fewer_orders_that_predict_as_well_lead() -> None:
    """The same while more orders are slightly likelier: .011 where those continued to lead."""
    found = [beside_the_textbook("causal", seed, 60.0, 80.0, 119.0) for seed in (12, 16, 20)]
    assert np.exp(np.mean(np.log(found))) < 0.009


def test_an_estimator_restarts_after_the_end() -> None:
    """An earlier record changes nothing, not even the samples at which the ripple is checked."""
    shaft, time = motion(1, 20.0), np.arange(1, 39_900) / 500.0
    read = np.round(shaft.at(time)[0] / STEP) * STEP
    told = {"resolution_rad": STEP, "stamp_jitter_s": 1e-6}
    again, fresh = create_estimator("smooth", **told), create_estimator("smooth", **told)
    again.step(time[:3000], read[:3000])
    again.finish()
    for estimator in (again, fresh):
        estimator.step(time[3000:], read[3000:])
    states, expected = again.finish(), fresh.finish()
    assert np.array_equal(states.alpha_rad_s2, expected.alpha_rad_s2)


@pytest.mark.parametrize("from_the_end", [1200, 3500])
@pytest.mark.parametrize("seed", [1, *more(2, 5)])
def test_outliers_towards_the_end_leave_the_ripple_known(seed: int, from_the_end: int) -> None:
    """States before the outliers are as accurate as in a recording that ends there."""
    shaft, time = motion(seed, 30.0), np.arange(1, 14_000) / 500.0
    read, truth = np.round(shaft.at(time)[0] / STEP) * STEP, shaft.at(time)[2]
    spoilt = read.copy()
    spoilt[-from_the_end:][:14] += np.random.default_rng(1).uniform(-1.0, 1.0, 14)
    off = []
    for angles in (read[:-from_the_end], spoilt):
        estimator = create_estimator("smooth")
        estimator.step(time[: angles.size], angles)
        states = estimator.finish()
        good = (time[states.index] > 5.0) & (states.index < 9000)
        off.append(np.sqrt(np.mean((states.alpha_rad_s2[good] - truth[states.index[good]]) ** 2)))
    assert off[1] < 2.0 * off[0]


@pytest.mark.parametrize("seed", [13, *more(30)])
def test_a_smoother_of_fewer_orders_has_its_own_memory(seed: int) -> None:
    """Ripple by angle, and a vibration by time that spurious orders would absorb: the smoother must not.

    At the long memory of those it lost the shaft for some dozens of readings, off by more than all the acceleration.
    """
    rng, time = np.random.default_rng([5, seed]), np.arange(12_000) * 1e-3
    speed, rate = TURN * rng.uniform(3.0, 15.0), TURN * rng.uniform(11.0, 35.0)
    size, phases = rng.uniform(0.003, 0.02) * speed / rate, rng.uniform(0.0, TURN, 3)
    first, second = 0.5 * rng.uniform(0.02, 0.06), 0.15 * rng.uniform(0.02, 0.06)
    one, two, shaken = speed * time + phases[0], 2.0 * speed * time + phases[1], rate * time + phases[2]
    theta = speed * time + first * np.sin(one) + 0.5 * second * np.sin(two) + size * np.sin(shaken)
    alpha = -(speed**2) * (first * np.sin(one) + 2.0 * second * np.sin(two)) - size * rate**2 * np.sin(shaken)
    step = TURN / 2 ** int(rng.integers(12, 16))
    angles = np.round(theta / step) * step
    angles += np.where(rng.random(time.size) < 0.01, 0.5 * rng.choice((-1, 1), time.size), 0.0)
    estimator = create_estimator("smooth")
    estimator.step(time, angles)
    states = estimator.finish()
    off = np.abs(states.alpha_rad_s2 - alpha[states.index])[300:-50]
    assert off.max() < 0.7 * np.sqrt(np.mean(alpha**2))


@pytest.mark.parametrize(("view", "most"), [("causal", 0.1), *more(("smooth", 0.2))])
def test_no_model_leads_for_long_with_a_past_ripple(view: str, most: float) -> None:
    """All earlier leading models had it, and equal likelihoods at memories of a few samples: 0.5 to 0.8."""
    *others, worst = sorted(beside_the_textbook(view, seed, 30.0, 53.0, 88.0) for seed in (0, 1, 3, 4, 6, 8))
    assert max(others) < most
    assert worst < 0.5
