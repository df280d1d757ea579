"""A network or a disk that pauses: the motion before predicts the motion after."""

from __future__ import annotations

import numpy as np
import pytest

from tests.campaign import more
from tests.shaft.shaft_signal import make_signal
from textile_twin_core.shaft import ShaftStates, create_estimator


@pytest.mark.parametrize("view", ["causal", "lag", "smooth"])
@pytest.mark.parametrize("pause_s", [0.3, *more(0.12, 0.7)])
def test_an_even_shaft_continues_over_pauses(view: str, pause_s: float) -> None:
    """Once a second: the ripple's phase and the speed are known, and the estimator does not restart."""
    signal = make_signal(5, duration_s=16.0, dropped=0.0)
    heard = signal.time % 1.0 >= pause_s
    errors = []
    for part in (heard, np.ones(heard.size, bool)):
        estimator = create_estimator(view)
        states = [estimator.step(signal.stamps_ns[part], signal.angles[part])]
        states.append(estimator.finish())
        late = np.concatenate([np.flatnonzero(part)[each.index] for each in states]) > 0.4 * heard.size
        index = np.concatenate([np.flatnonzero(part)[each.index] for each in states])[late]
        assert np.concatenate([each.settled for each in states])[late].all()
        alpha = np.concatenate([each.alpha_rad_s2 for each in states])[late]
        errors.append(np.sqrt(np.mean((alpha - signal.alpha[index]) ** 2)))
    assert errors[0] < 2.0 * errors[1]


@pytest.mark.parametrize("seed", range(6))
def test_a_stop_within_a_pause_gives_a_standstill(seed: int) -> None:
    signal = make_signal(seed, duration_s=8.0, dropped=0.0)
    heard = signal.time < 6.0 + 0.01 * seed
    stamps = np.append(signal.stamps_ns[heard], signal.stamps_ns[heard][-1] + 10**9 + 2_000_000 * np.arange(500))
    angles = np.append(signal.angles[heard], np.full(500, signal.angles[heard][-1] + 0.37 * seed))
    if seed == 0:  # where it would be, had it not stopped
        angles[heard.sum() :] = signal.angles[np.searchsorted(signal.stamps_ns, stamps[heard.sum()])]
    estimator = create_estimator("causal")
    states = estimator.step(stamps, angles)
    rest = states.index > heard.sum() + 40
    assert np.abs(states.omega_rad_s[rest]).max() < 0.02
    assert estimator.report.state == "standstill"
    assert estimator.report.gaps == 1


@pytest.mark.parametrize("seed", range(6))
def test_another_speed_after_a_pause_is_estimated_from_the_new_readings(seed: int) -> None:
    """The estimate restarts at once: the first readings after the pause are neither outliers nor a slip."""
    before, after = make_signal(seed, duration_s=6.0, dropped=0.0), make_signal(seed + 50, rpm=95.0, duration_s=4.0)
    estimator = create_estimator("causal")
    estimator.step(before.stamps_ns, before.angles)
    states = estimator.step(before.stamps_ns[-1] + 10**9 + after.stamps_ns - after.stamps_ns[0], after.angles)
    off = states.omega_rad_s - after.omega[states.index - before.angles.size]
    assert np.abs(off[25:]).max() < 0.25 and np.abs(off[5:]).max() < 1.5
    report = estimator.report
    assert (report.gaps, report.jumps, report.outliers, report.losses) == (1, 0, 0, 0)


@pytest.mark.parametrize("view", ["causal", "lag", "smooth"])
def test_a_stop_in_a_pause_that_is_no_gap_by_its_length(view: str) -> None:
    """The turns of a braking shaft in 45 intervals are unknown: no speed from them is settled."""
    time = np.arange(900) / 64.0
    speed = np.interp(time, [2.0, 6.0, 6.4], [60.0, 60.0, 0.0])
    kept = (time < 6.12) | (time > 6.12 + 45.0 / 64.0)
    angle = np.round(np.cumsum(speed) / 64.0 / np.deg2rad(1.0)) * np.deg2rad(1.0) % (2.0 * np.pi)
    estimator = create_estimator(view)
    parts = [estimator.step(time[kept], angle[kept]), estimator.finish()]
    states = ShaftStates.join([part for part in parts if len(part)])
    after = time[kept][states.index] > 6.4
    assert np.abs(states.omega_rad_s)[after & states.settled].max() < 5.0
    assert np.abs(states.omega_rad_s)[after].max() < 61.0
