"""Unknowns at first: the encoder's step, repetitions of the sensor, the noise of readings at standstill."""

from __future__ import annotations

import numpy as np
import pytest

from tests.shaft.kinds import TURN
from textile_twin_core.shaft import create_estimator
from textile_twin_core.shaft.encoder import encoder_step


@pytest.mark.parametrize(("bits", "most"), [(12, 6), (14, 4)])
@pytest.mark.parametrize("offset_rad", [0.3, 0.4, 0.5])
def test_the_first_motion_after_a_standstill_is_seen_before_the_step_is_known(
    bits: int, most: int, offset_rad: float
) -> None:
    """Inched to 1.6 rad/s in 50 ms; with a guessed step 11 states in a row were at standstill, and settled."""
    time, rise, top, step = np.arange(750) * 0.004, 0.05, 1.6, TURN / 2**bits
    gone = np.maximum(time - 1.5, 0.0)
    theta = np.where(gone < rise, 0.5 * top * gone**2 / rise, top * (gone - 0.5 * rise)) + offset_rad
    omega = top * np.minimum(gone / rise, 1.0)
    states = create_estimator("causal").step(time, np.floor(theta / step) * step)
    truth = omega[states.index]
    assert np.sum(states.settled & (np.abs(states.omega_rad_s - truth) > 0.5 * np.maximum(truth, 0.1 * top))) <= most


@pytest.mark.parametrize("steps", [6.5, 6.9, 6.95, 7.03])
def test_equal_moves_for_long_are_rounded_readings(steps: float) -> None:
    """Treated as unrounded readings, the acceleration of an even speed was .01 to .02."""
    time, step = np.arange(300) * 0.04, TURN / 2**14
    readings = np.floor(steps * np.arange(300)) * step
    assert encoder_step(time[:12], readings[:12]) in (None, pytest.approx(step))
    estimator = create_estimator("smooth")
    estimator.step(time, readings)
    states = estimator.finish()
    off = np.abs(states.alpha_rad_s2)[(states.index > 30) & (states.index < 250)]
    assert np.sqrt(np.mean(off**2)) < 1e-5


@pytest.mark.parametrize("period_s", [0.0064, 0.0085, 0.0101])
def test_smooth_rejects_copies_of_readings(period_s: float) -> None:
    """A sensor read each 2 ms: copies accepted as readings gave speeds wrong by up to 70."""
    time, step = np.arange(0.0, 4.0, 0.002), TURN / 4096
    measured = np.floor(time / period_s) * period_s
    estimator = create_estimator("smooth")
    estimator.step(time, np.floor((17.0 * measured - 2.0 * np.cos(measured)) / step) * step % TURN)
    states = estimator.finish()
    off = states.omega_rad_s - 17.0 - 2.0 * np.sin(time[states.index])
    assert np.abs(off[states.index > 10]).max() < 1.1


@pytest.mark.parametrize("view", ["lag", "smooth"])
@pytest.mark.parametrize("offset_rad", [0.1, 0.3, 0.5])
def test_a_standstill_does_not_teach_the_noise_of_readings(view: str, offset_rad: float) -> None:
    """A start at full torque after 1 s of equal readings: with the standstill's noise it was off by up to 196."""
    time, delay, top, step = np.arange(1200) * 0.0025, 0.15, 46.0, TURN / 4096
    gone = np.maximum(time - 1.0, 0.0)
    theta = top * (gone - delay * (1.0 - np.exp(-gone / delay))) + offset_rad
    alpha = np.where(gone > 0.0, top / delay * np.exp(-gone / delay), 0.0)
    estimator = create_estimator(view)
    states = [estimator.step(time, np.floor(theta / step) * step % TURN), estimator.finish()][view == "smooth"]
    soon = (time[states.index] > 1.01) & (time[states.index] < 1.5)
    assert np.sqrt(np.mean((states.alpha_rad_s2 - alpha[states.index])[soon] ** 2)) < 10.0
