"""Difficult records, compared with the textbook's filter or smoother tuned on each."""

from __future__ import annotations

import numpy as np
import pytest

from tests.benchmarks.shaft_judge.kinds_score import score
from tests.benchmarks.shaft_judge.views import package
from tests.campaign import more


@pytest.mark.slow
@pytest.mark.parametrize("view", ["causal", "smooth"])
@pytest.mark.parametrize("seed", [4, 17, *more(23, 25, 27)])
def test_gentle_starts_of_coarse_encoders_are_no_blows(view: str, seed: int) -> None:
    """An encoder's first step after a standstill, and the beat of a steady run with the sampling."""
    made = score(package, "runs", seed, view)
    assert np.all(made.rms < 1.25 * made.book)


@pytest.mark.parametrize("seed", [3, 6])
def test_a_record_from_standstill_shows_the_encoders_step_as_it_moves(seed: int) -> None:
    """Until it is known, the step is at most the smallest move."""
    made = score(package, "standstill", seed, "causal")
    assert made.rms[0] < 1.25 * made.book[0]


def test_the_jerk_is_localised() -> None:
    """Disturbances of every time scale: the window of the smoothed jerk is short where few samples are informative."""
    made = score(package, "scales", 9, "smooth")
    assert np.all(made.rms < 1.25 * made.book)


@pytest.mark.parametrize("seed", [16, 21])
def test_no_more_ripple_than_the_readings_support(seed: int) -> None:
    made = score(package, "runs", seed, "smooth")
    assert np.all(made.rms < 1.5 * made.book)


@pytest.mark.parametrize("seed", [16, 19, 29])
@pytest.mark.parametrize("view", ["causal", "smooth"])
def test_the_model_with_the_orders_of_the_ripple_leads(view: str, seed: int) -> None:
    """The leading model is not the one with memories near the motion's: spurious orders disturb the acceleration."""
    made = score(package, "slow", seed, view)
    assert np.all(made.rms < 1.1 * made.book)


@pytest.mark.parametrize("seed", [0, 3, 4, 7])
def test_a_suspended_model_is_compared_at_the_memory_of_the_leading_one(seed: int) -> None:
    """Its own memory dates from its suspension; with it, orders that exist looked unlikely."""
    made = score(package, "teeth", seed, "smooth")
    assert np.all(made.rms < made.book)


def test_all_stored_ripples_may_be_wrong_for_a_part() -> None:
    """Ripples were estimated before and after a reversal; in between the plain model is likelier."""
    made = score(package, "runs", 1, "smooth")
    assert np.all(made.rms < 0.7 * made.book)


def test_where_several_ripples_enter_the_simplest_leads() -> None:
    """Seven readings a turn: three orders fit the first readings as well as two, and then disturb the acceleration."""
    made = score(package, "coarse", 3, "causal")
    assert np.all(made.rms < 1.25 * made.book)


def test_an_order_that_stands_above_the_sensors_is_no_motion_yet() -> None:
    """An order is ten times above by chance in 1 record of 100; counted fully as motion, its acceleration was 15."""
    made = score(package, "pitch+3%", 5, "smooth")
    assert np.all(made.rms < 2.0 * made.book)


@pytest.mark.parametrize(("view", "most"), [("smooth", (1.25, 1.25)), *more(("causal", (1.05, 1.05)))])
def test_unconfigured_pitch_errors_do_not_count_as_ripple(view: str, most: tuple[float, float]) -> None:
    """Medians: readings alone do not assign an order of the turn to sensor or motion. Counted as ripple: 1.3, 3."""
    made = [score(package, "pitch", seed, view) for seed in range(16)]
    assert np.all(np.median([one.rms / one.book for one in made], axis=0) < most)
