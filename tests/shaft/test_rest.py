"""A shaft that rests for long between a run-down and a start: neither blinds what is before or after it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.shaft.kinds import make
from textile_twin_core.shaft import create_estimator

TURN = 2.0 * np.pi
SPEED = 18.85
DOWN_S, UP_S = (10.0, 6.0), (30.0, 4.0)
"""When the shaft slows down and starts, and for how long it does."""


def motion(time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angle, speed, acceleration: cycloids between speed and rest."""
    theta, omega, alpha = SPEED * time, np.full(time.size, SPEED), np.zeros(time.size)
    for (begin, length), sense in ((DOWN_S, -1.0), (UP_S, 1.0)):
        x = np.clip((time - begin) / length, 0.0, 1.0)
        after = np.maximum(time - begin - length, 0.0)
        theta += sense * SPEED * (length * (0.5 * x**2 + (np.cos(TURN * x) - 1.0) / TURN**2) + after)
        omega += sense * SPEED * (x - np.sin(TURN * x) / TURN)
        alpha += sense * SPEED / length * (1.0 - np.cos(TURN * x)) * ((x > 0.0) & (x < 1.0))
    return theta, omega, alpha


@pytest.mark.parametrize("jitter_s", [0.0, 20e-6])
@pytest.mark.parametrize("bits", [13, 16, None])
@pytest.mark.parametrize("view", ["causal", "lag", "smooth"])
def test_run_down_and_start_around_a_long_rest(view: str, bits: int | None, jitter_s: float) -> None:
    time = np.arange(0.0, 40.0, 0.002)
    read = motion(time + jitter_s * np.random.default_rng(11).normal(size=time.size))[0]
    step = TURN / 2**bits if bits else 0.0
    if bits:
        read = np.floor(read / step) * step
    stamps = np.rint(time * 1e9).astype(np.int64) + 10**9
    estimator = create_estimator(view)
    states = [estimator.step(stamps, read), estimator.finish()][view == "smooth"]
    at = time[states.index]
    off = np.abs(states.alpha_rad_s2 - motion(at)[2])
    sigma = states.sigma[:, 2]
    assert np.all(np.isfinite(states.covariance))
    for first, last, allowed in ((10.5, 15.5, 0.3), (17.0, 29.5, 0.01), (31.5, 34.5, 0.5)):
        part = (at > first) & (at < last) & states.settled
        assert part.sum() > 0.99 * (last - first) / 0.002
        assert np.sqrt(np.mean(off[part] ** 2)) < allowed
        assert sigma[part].max() < 20.0
    # The first steps of an encoder after a rest say little of the acceleration, and that is told.
    leaving = (at > 29.9) & (at < 31.5) & states.settled
    assert np.all(off[leaving] < np.maximum(5.0 * sigma[leaving], 1.0))


@pytest.mark.parametrize("view", ["causal", "lag", "smooth"])
def test_no_order_of_runs_and_rests_spoils_what_is_around_it(view: str) -> None:
    """But where a coarse encoder moves by about a step from reading to reading: the beat of both looks like motion."""
    spoilt = []
    for seed in range(24):
        record = make("runs", seed)
        estimator = create_estimator(view)
        states = [estimator.step(record.time_s, record.fed_rad), estimator.finish()][view == "smooth"]
        off = np.abs(states.alpha_rad_s2 - record.alpha[states.index])
        sigma = states.sigma[:, 2]
        assert np.all(np.isfinite(states.covariance))
        step = max(estimator.report.resolution_rad, 1e-12)
        steps = np.abs(record.omega[states.index]) * estimator.report.period_s / step
        counts = states.settled & (states.index > 0.1 * record.time_s.size) & (np.abs(steps - 1.0) > 0.2)
        if np.quantile(off[counts], 0.95) > 10.0 or sigma[counts].max() > 1e4:
            spoilt.append((seed, np.quantile(off[counts], 0.95), sigma[counts].max()))
    assert len(spoilt) <= 1, spoilt  # the first steps of a coarse encoder after a rest may still look like a blow
