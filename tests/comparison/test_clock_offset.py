"""Offset and drift of two loggers' clocks, found from a speed that both logged, or refused."""

from __future__ import annotations

import numpy as np
import pytest

from tests.campaign import more
from tests.generators.two_loggers import Pair, pair
from textile_twin_core.comparison.clock_offset import ClockOffset, Undetermined, find_clock_offset


def found_by_speed(pair: Pair, seed: int, unit: float = 1.0, rounded: bool = False) -> ClockOffset:
    speed = pair.omega * unit + 0.02 * unit * np.random.default_rng(seed).standard_normal(pair.omega.size)
    logged = np.round(speed) if rounded else speed
    return find_clock_offset(pair.angle_s, np.gradient(pair.angle_rad, pair.angle_s), pair.drive_s, logged)


AMBIGUOUS = (11, 23, 38)
"""Seeds whose speeds fit at another offset nearly as well, which is refused."""


@pytest.mark.parametrize("seed", [1, *more(*(seed for seed in range(40) if seed != 1))])
def test_offset_and_drift_are_within_a_millisecond_and_their_interval(seed: int) -> None:
    made = pair(seed, steady=seed % 3 == 2)
    found = found_by_speed(made, seed, 30.0 / np.pi, rounded=seed % 3 == 1)
    at = made.drive_s + found.offset_s + found.drift * (made.drive_s - found.origin_s)
    error_s = float(np.abs(at - made.true_s).max())
    if seed in AMBIGUOUS:
        assert found.undetermined is Undetermined.AMBIGUOUS
    else:
        assert found.undetermined is None
        assert error_s < 1e-3 and error_s <= found.half_width_s, (error_s, found)


def test_a_shaft_that_turns_evenly_does_not_determine_the_offset() -> None:
    made = pair(3, steady=True, wander=0.0, longest_s=60.0)
    found = found_by_speed(made, 3)
    assert found.undetermined is Undetermined.AMBIGUOUS
    turn_s = 2.0 * np.pi / float(made.omega.mean())
    turns = (found.offset_s - found.other_offset_s) / turn_s
    assert abs(turns - round(turns)) < 0.02


def test_signals_of_other_shafts_are_unrelated_or_too_short() -> None:
    made, other = pair(4, longest_s=50.0), pair(5, longest_s=50.0)
    random = np.random.default_rng(6)
    noise = random.standard_normal(made.drive_s.size)
    speed = np.gradient(made.angle_rad, made.angle_s)
    assert find_clock_offset(made.angle_s, speed, made.drive_s, noise).undetermined in (
        Undetermined.UNRELATED,
        Undetermined.AMBIGUOUS,
    )
    short = slice(0, 200)
    found = find_clock_offset(made.angle_s, speed, other.drive_s[short], other.omega[short])
    assert found.undetermined is Undetermined.TOO_SHORT
