"""Wrapped and counting angles of machines that start and stop within a few readings, distinguished by the readings."""

from __future__ import annotations

import numpy as np
import pytest

from tests.shaft.kinds import TURN
from textile_twin_core.shaft import ShaftStates, create_estimator


def _machine(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps, readings and truth: runs of up to 2.5 rad a reading, starts within 0 to 10 readings, standstills."""
    rng = np.random.default_rng([seed, 51])
    rate, count = rng.choice((20.0, 50.0, 100.0, 500.0)), 700
    top, ramp = np.exp(rng.uniform(np.log(0.05), np.log(2.5))), int(rng.choice((0, 1, 2, 4, 10)))
    moves, place = np.zeros(count), int(rng.integers(3, 60))
    while place < count:
        rise = np.ones(int(rng.integers(20, 90)))
        rise[: ramp + 1] = np.linspace(0.0, 1.0, ramp + 2)[1:]
        run = np.minimum(rise, rise[::-1]) * top * rng.choice((1.0, 0.6, -0.8))
        run = run[: count - place]
        moves[place : place + run.size] = run
        place += run.size + int(rng.integers(5, 60))
    theta = rng.uniform(0.0, TURN) + np.cumsum(moves)
    step = rng.choice((TURN / 42, TURN / 360, TURN / 4096, 1e-12))
    return np.arange(count) / rate + rng.normal(0.0, 0.01 / rate, count), np.round(theta / step) * step, theta


def _run(view: str, time: np.ndarray, readings: np.ndarray) -> tuple[ShaftStates, str]:
    estimator = create_estimator(view)
    states = ShaftStates.join([estimator.step(time, readings), estimator.finish()])
    return states, estimator.report.wrapping


@pytest.mark.parametrize("seed", range(24))
@pytest.mark.parametrize("view", ["causal", "smooth"])
def test_a_start_is_no_wrap(view: str, seed: int) -> None:
    """An angle that counts turns gives the states of `wrapping="unwrapped"`, starts and stops included."""
    time, readings, _ = _machine(seed)
    states, wrapping = _run(view, time, readings)
    estimator = create_estimator(view, wrapping="unwrapped")
    known = ShaftStates.join([estimator.step(time, readings), estimator.finish()])
    assert np.array_equal(states.theta_rad, known.theta_rad)
    assert wrapping == ("unwrapped" if np.ptp(readings) > 1.3 * TURN else "open")


@pytest.mark.parametrize("seed", range(24))
@pytest.mark.parametrize("low", [0.0, -np.pi])
def test_starts_and_stops_lose_no_turn_of_a_wrapped_angle(low: float, seed: int) -> None:
    """A settled state stands in the right turn, and the record ends in the turn in which the shaft stands."""
    time, readings, theta = _machine(seed)
    wrapped = np.mod(readings - low, TURN) + low
    states, wrapping = _run("causal", time, wrapped)
    off = states.theta_rad - theta[states.index]
    turns = np.rint((off - off[0]) / TURN)
    assert turns[-1] == 0.0
    assert not np.any(turns[states.settled])
    assert wrapping != "unwrapped"


def test_an_open_wrapping_is_reported_until_readings_decide() -> None:
    """Half a turn shows nothing; a wrap where the track leads, or a range of more than a turn, decides."""
    time = np.arange(400) * 0.01
    theta = 2.0 + 2.5 * time
    for readings, decided in ((theta % TURN, "wrapped"), (theta, "unwrapped")):
        estimator = create_estimator("causal")
        estimator.step(time[:100], readings[:100])
        assert estimator.report.wrapping == "open"
        estimator.step(time[100:], readings[100:])
        assert estimator.report.wrapping == decided
    for wrapping in ("wrapped", "unwrapped"):
        estimator = create_estimator("causal", wrapping=wrapping)
        estimator.step(time[:3], theta[:3])
        assert estimator.report.wrapping == wrapping
