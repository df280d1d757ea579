"""A drive that starts and stops within a reading, again and again: such leaps of the readings are believed sooner."""

from __future__ import annotations

import numpy as np
import pytest

from tests.shaft.textbook import textbook
from textile_twin_core.shaft import create_estimator

RATE_HZ, STEP_RAD = 50.0, 2.0 * np.pi / 42


def _drive(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps, readings and speeds of a wheel of 42 ticks a turn that is at one speed or at rest, for 1 to 2 s each."""
    rng = np.random.default_rng(seed)
    tops = [top for _ in range(25) for top in (rng.uniform(15.0, 30.0), 0.0)]
    speed = np.concatenate([np.full(rng.integers(50, 100), top) for top in tops])
    angle = np.cumsum(np.repeat(speed, 20)) / (20.0 * RATE_HZ)
    first = int(rng.integers(20))
    return np.arange(speed.size) / RATE_HZ, np.round(angle[first::20] / STEP_RAD) * STEP_RAD, speed


@pytest.mark.parametrize("seed", range(4))
def test_a_start_within_a_reading_is_followed_where_all_leaps_were_motion(seed: int) -> None:
    """At first two readings are set aside each time, and the speed is 1.6 times as far off as the textbook's."""
    time, readings, speed = _drive(seed)
    states, book = create_estimator("causal").step(time, readings), textbook(time, readings)
    late = states.index > 0.5 * time.size
    off, reference = states.omega_rad_s - speed[states.index], book.causal[:, 1] - speed
    assert np.sqrt(np.mean(off[late] ** 2)) < 1.25 * np.sqrt(np.mean(reference[states.index[late]] ** 2))


@pytest.mark.parametrize("seed", range(4))
def test_a_wrong_reading_that_was_believed_is_no_motion(seed: int) -> None:
    """It is not called settled, three readings later all is as it was, and the next one is set aside again."""
    time, readings, speed = _drive(seed)
    running = np.flatnonzero((speed > 0.0) & (np.roll(speed, 25) == speed) & (np.roll(speed, -25) == speed))
    wrong = running[running > 0.7 * time.size][[0, 12]]
    readings[wrong] += 2.0
    estimator = create_estimator("causal")
    states = estimator.step(time, readings)
    for at in wrong:
        after = states.index >= at
        assert not states.settled[after][0]
        assert np.all(np.abs(states.omega_rad_s[after][3:10] - speed[at]) < 4.0)
    assert abs(states.omega_rad_s[states.index == wrong[1]][0] - speed[wrong[1]]) < 3.0
