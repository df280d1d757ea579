"""Few samples a turn in coarse steps, with wild readings: the step is found, the ripple is told, the sigmas hold."""

from __future__ import annotations

import numpy as np
import pytest

from tests.shaft.kinds import make
from tests.shaft.textbook import textbook
from textile_twin_core.shaft import ShaftStates, create_estimator
from textile_twin_core.shaft.encoder import encoder_step

LATE = 0.15
"""Part of a record in which estimators learn."""


@pytest.mark.parametrize("seed", [31, 35, 39])
def test_the_step_is_found_beside_wild_readings(seed: int) -> None:
    """One degree; of the first 24 readings up to two are half a radian off."""
    record = make("coarse+3%", seed)
    step = encoder_step(record.time_s[:24], record.fed_rad[:24])
    assert step == pytest.approx(np.deg2rad(1.0), rel=1e-9)


def test_the_step_of_a_shaft_at_rest_is_not_what_wild_readings_have_in_common() -> None:
    record = make("standstill+3%", 9)
    estimator = create_estimator("causal")
    estimator.step(record.time_s, record.fed_rad)
    assert estimator.report.resolution_rad == pytest.approx(2.0 * np.pi / 4096, rel=1e-9)


def test_no_step_where_readings_are_not_rounded() -> None:
    rng = np.random.default_rng(1)
    assert encoder_step(np.arange(48.0), np.cumsum(rng.uniform(0.5, 1.0, 48))) == 0.0
    assert encoder_step(np.arange(48.0), np.zeros(48)) is None


def test_an_even_speed_that_stops_is_no_step() -> None:
    """A simulated shaft, or one whose stamps are exact: what it turns from sample to sample is the same for long."""
    sample = np.arange(768.0)
    for brake in (20.6, 61.0, 120.6):
        gone = np.clip((sample - 480.0) / brake, 0.0, 1.0)
        turned = np.minimum(sample, 480.0) + 0.5 * brake * (gone + np.sin(np.pi * gone) / np.pi)
        assert encoder_step(0.004 * sample, 0.1511 * turned) == 0.0


def test_edges_of_teeth_are_not_rounded_and_sampling_nearly_in_step_is() -> None:
    """Edges: a gap of teeth takes longer, also where every second tooth is heard; sampling: a skipped step does not."""
    tooth = np.arange(400)
    heard = tooth[tooth % 60 < 57]
    for edges in (heard, heard[::2]):
        assert encoder_step(edges / 60.0 + 1e-4 * np.sin(edges), edges * 0.1) == 0.0
    time = np.arange(200) * 1e-3
    heard = np.random.default_rng(2).random(time.size) > 0.3
    for steps in (1.01, 2.02, 3.01, 333.77):
        readings = np.round(steps * 1000.0 * time) * 0.002
        assert encoder_step(time, readings) == pytest.approx(0.002, rel=1e-9)
        if steps > 4.0:
            assert encoder_step(time[heard], readings[heard]) == pytest.approx(0.002, rel=1e-9)


def test_ripple_is_told_at_seven_samples_a_turn() -> None:
    """The textbook's smoother, its noises tuned on the record, takes ripple for noise. Half the records have little."""
    ratios, inside = [], []
    for seed in range(100, 132):
        record = make("coarse", seed)
        estimator = create_estimator("smooth")
        states = ShaftStates.join([estimator.step(record.time_s, record.fed_rad), estimator.finish()])
        late = states.index >= LATE * record.time_s.size
        at = states.index[late]
        error = states.omega_rad_s[late] - record.omega[at]
        book = textbook(record.time_s, np.unwrap(record.fed_rad)).smooth[at, 1] - record.omega[at]
        ratios.append(np.sqrt(np.mean(error**2) / np.mean(book**2)))
        inside.append(np.mean(np.abs(error) <= states.sigma[late, 1]))
    assert np.quantile(ratios, 0.25) < 0.6
    assert 0.62 <= np.median(inside) <= 0.8


def test_a_wrapped_angle_does_not_run_away() -> None:
    """Of a record in which wild readings fall on a stop: a speed of more than half a period a sample is none."""
    record = make("coarse+3%", 23)
    states = create_estimator("causal").step(record.time_s, record.fed_rad)
    error = np.abs(states.omega_rad_s - record.omega[states.index])
    assert np.mean(error > 0.2 * np.abs(record.omega).max()) < 0.05
