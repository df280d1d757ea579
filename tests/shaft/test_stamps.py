"""Stamps of an operating system's making: the first two at once, or several readings at the end of each wait."""

from __future__ import annotations

import numpy as np
import pytest

from tests.shaft.shaft_signal import make_signal
from textile_twin_core.shaft import create_estimator


def test_two_samples_at_once_in_the_beginning_do_not_make_gaps_of_all_others() -> None:
    signal = make_signal(3, duration_s=4.0)
    stamps = signal.stamps_ns.copy()
    stamps[0] = stamps[1] - 1000
    estimator = create_estimator("causal")
    states = estimator.step(stamps, signal.angles)
    assert estimator.report.gaps == 0
    assert estimator.report.losses == 1
    assert states.settled[50:].all()
    assert np.abs(states.omega_rad_s - signal.omega[states.index])[50:].max() < 0.5


@pytest.mark.parametrize("view", ["causal", "smooth"])
def test_readings_that_are_stamped_in_bunches(view: str) -> None:
    """Four every 8 ms, as a serial adapter hands them over, their stamps 50 us apart."""
    signal = make_signal(4, duration_s=20.0, dropped=0.0, jitter_s=0.0, ripple=())
    count = np.arange(signal.time.size)
    time = signal.time[count // 4 * 4 + 3] + count % 4 * 5e-5
    estimator = create_estimator(view)
    states = [estimator.step(time, signal.angles), estimator.finish()][view == "smooth"]
    late = states.index > 0.15 * time.size
    assert states.settled[late].all()
    assert np.abs(states.omega_rad_s - signal.omega[states.index])[late].max() < 0.02
    assert np.abs(states.alpha_rad_s2[late]).max() < 0.1
