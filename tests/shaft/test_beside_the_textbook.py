"""Records that were hard once, beside the textbook's filter or smoother tuned on each."""

from __future__ import annotations

import numpy as np
import pytest

from tests.benchmarks.shaft_judge.kinds_score import score
from tests.benchmarks.shaft_judge.views import package


@pytest.mark.parametrize("view", ["causal", "smooth"])
@pytest.mark.parametrize("seed", [4, 17, 23, 25, 27])
def test_gentle_starts_of_coarse_encoders_are_no_blows(view: str, seed: int) -> None:
    """An encoder's first step after a rest, and the beat of a steady run with the sampling."""
    made = score(package, "runs", seed, view)
    assert np.all(made.rms < 1.25 * made.book)


@pytest.mark.parametrize("seed", [3, 6])
def test_a_record_that_begins_at_rest_tells_the_encoders_step_as_it_moves(seed: int) -> None:
    """Until it is known, the step is at most the smallest move."""
    made = score(package, "standstill", seed, "causal")
    assert made.rms[0] < 1.25 * made.book[0]


def test_the_jerk_is_found_where_it_is() -> None:
    """Disturbances of every time scale: what the smoothed jerk says is asked over few samples where they tell much."""
    made = score(package, "scales", 9, "smooth")
    assert np.all(made.rms < 1.25 * made.book)


@pytest.mark.parametrize("seed", [16, 21])
def test_no_more_ripple_than_the_readings_speak_for(seed: int) -> None:
    made = score(package, "runs", seed, "smooth")
    assert np.all(made.rms < 1.5 * made.book)


@pytest.mark.parametrize("seed", [16, 19, 29])
@pytest.mark.parametrize("view", ["causal", "smooth"])
def test_the_family_leads_that_has_the_orders_of_the_ripple(view: str, seed: int) -> None:
    """Not the one whose memories happen to be near the motion's: orders that are none shook the acceleration."""
    made = score(package, "slow", seed, view)
    assert np.all(made.rms < 1.1 * made.book)


@pytest.mark.parametrize("seed", [0, 3, 4, 7])
def test_a_family_that_rested_is_asked_at_the_memory_of_the_leading_one(seed: int) -> None:
    """At its own, of where it rested, orders that are there looked unlikely."""
    made = score(package, "teeth", seed, "smooth")
    assert np.all(made.rms < made.book)


def test_all_ripples_that_are_known_may_be_wrong_for_a_part() -> None:
    """Found before a reversal and after it: in between the plain family is likelier."""
    made = score(package, "runs", 1, "smooth")
    assert np.all(made.rms < 0.7 * made.book)


def test_where_several_ripples_enter_the_simplest_leads() -> None:
    """At seven readings a turn three orders fit the first ones as well as two, and then shake the acceleration."""
    made = score(package, "coarse", 3, "causal")
    assert np.all(made.rms < 1.25 * made.book)


def test_an_order_that_stands_above_the_sensors_is_no_motion_yet() -> None:
    """Ten times above by chance, in one of a hundred records: all of it taken for motion, its acceleration was 15."""
    made = score(package, "pitch+3%", 5, "smooth")
    assert np.all(made.rms < 2.0 * made.book)


@pytest.mark.parametrize(("view", "most"), [("causal", (1.05, 1.05)), ("smooth", (1.25, 1.25))])
def test_pitch_errors_that_nobody_told_of_are_not_taken_for_ripple(view: str, most: tuple[float, float]) -> None:
    """Medians: of a turn's orders the readings alone do not tell which is whose. Taken for ripple: 1.3, 3."""
    made = [score(package, "pitch", seed, view) for seed in range(16)]
    assert np.all(np.median([one.rms / one.book for one in made], axis=0) < most)
