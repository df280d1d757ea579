"""A mill's recording, rest to run-up to stop: what happens at its ends does not spoil the hour between them."""

from __future__ import annotations

import numpy as np
import pytest

from tests.generators.mill_recordings import START_NS, healthy, record
from textile_twin_core.shaft import create_estimator


@pytest.mark.parametrize("duration_s", [60.0, 280.0])
def test_the_stop_does_not_choose_the_ripple_of_the_whole(duration_s: float) -> None:
    """Truth by a motion that no estimator knows; turned by its end the acceleration would be off by 3 rad/s^2."""
    made = record(healthy("tufting", 2003, duration_s=duration_s))
    estimator = create_estimator("smooth")
    estimator.step(made.angle_stamps_ns, made.angle)
    states = estimator.finish()
    time = (states.stamps - START_NS) * 1e-9
    steady = (time > 0.1 * time[-1]) & (time < 0.9 * time[-1])
    _, omega, alpha = made.plan.at(time)
    assert np.sqrt(np.mean((states.alpha_rad_s2 - alpha)[steady] ** 2)) < 0.3
    assert np.sqrt(np.mean((states.omega_rad_s - omega)[steady] ** 2)) < 0.003


@pytest.mark.parametrize("view", ["causal", "lag"])
@pytest.mark.parametrize("seed", [2003, 2007])
def test_a_start_from_rest_does_not_hide_the_ripple(view: str, seed: int) -> None:
    """What a slow start tells of the stamps' error must not last: readings would be thought too bad to tell ripple.

    The steady acceleration was off by 2 to 10 rad/s^2 then, of ripple that has up to 8.
    """
    made = record(healthy("tufting", seed, duration_s=30.0))
    estimator = create_estimator(view)
    states = estimator.step(made.angle_stamps_ns, made.angle)
    time = (states.stamps - START_NS) * 1e-9
    steady = (time > 15.0) & (time < 20.0)
    _, omega, alpha = made.plan.at(time)
    assert np.sqrt(np.mean((states.alpha_rad_s2 - alpha)[steady] ** 2)) < 0.5
    assert np.sqrt(np.mean((states.omega_rad_s - omega)[steady] ** 2)) < 0.01
    assert estimator.report.stamp_jitter_s < 1e-4
