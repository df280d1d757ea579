"""Records of loggers and wheels: printed angles, pauses before the first motion, run-downs, many turns."""

from __future__ import annotations

import numpy as np
import pytest

from tests.campaign import more
from tests.shaft.kinds import TURN, make
from textile_twin_core.shaft import ShaftEstimator, ShaftStates, create_estimator
from textile_twin_core.shaft.encoder import encoder_step


def _run(estimator: ShaftEstimator, time: np.ndarray, angles: np.ndarray) -> ShaftStates:
    return ShaftStates.join([part for part in (estimator.step(time, angles), estimator.finish()) if len(part)])


@pytest.mark.parametrize("in_degrees", [False, True])
@pytest.mark.parametrize(("counts", "decimals"), [(48, 4), (1024, 4), (4096, 4), (4096, 5), (10_000, 5), (16_384, 6)])
@pytest.mark.parametrize("seed", range(3))
def test_the_step_is_the_encoders_and_not_the_last_decimal_of_a_log(
    seed: int, counts: int, decimals: int, in_degrees: bool
) -> None:
    rng, time, step = np.random.default_rng(seed), np.arange(768) * 0.002, TURN / counts
    speed = rng.uniform(4.0, 15.0)
    theta = speed * time + 0.02 * np.sin(3.0 * speed * time) + rng.uniform(10.0, 30.0) * time**2 + rng.random()
    counted = np.rint(theta / step) * step
    printed = np.deg2rad(np.round(np.rad2deg(counted), decimals - 1)) if in_degrees else np.round(counted, decimals)
    assert encoder_step(time, printed) == pytest.approx(step, rel=3e-3)


@pytest.mark.parametrize("seed", [9, 14])
def test_a_decimal_is_no_step_before_enough_readings_show_the_encoders(seed: int) -> None:
    """The first moves of a pendulum with growing swings have many different numbers of decimals as well."""
    rng, time, step = np.random.default_rng(seed), np.arange(900) * 0.002, TURN / 10_000
    theta = 0.4 * time**2 * np.sin(rng.uniform(8.0, 20.0) * time) + rng.random()
    estimator = create_estimator("causal")
    _run(estimator, time, np.round(np.rint(theta / step) * step, 4))
    assert estimator.report.resolution_rad == pytest.approx(step, rel=3e-3)


@pytest.mark.parametrize("seed", [*range(6), *more(*range(6, 20))])
def test_a_fine_encoder_is_no_coarse_one_that_was_printed(seed: int) -> None:
    """Moves that are alike, or few, are multiples of many steps."""
    rng = np.random.default_rng(seed)
    time, step = np.arange(768) * 0.002, TURN / 2 ** int(rng.integers(14, 19))
    late = rng.normal(0.0, rng.choice((1e-6, 2e-5)), time.size)
    theta = rng.uniform(3.0, 30.0) * (time + late) + rng.choice((0.0, 0.1)) * np.sin(7.0 * time)
    found = encoder_step(time, np.rint(theta / step) * step)
    assert found in (None, 0.0, pytest.approx(step, rel=1e-3))


@pytest.mark.parametrize("seed", range(4))
def test_a_shaft_that_is_inched_is_seen_once_it_moved_by_two_steps(seed: int) -> None:
    """Ten bits, 50 ms to 1.6 rad/s after 10 s of standstill: two steps take seven readings."""
    time, step, begin = np.arange(2750) * 0.004, TURN / 1024, 10.0 + 0.001 * seed
    gone = np.maximum(time - begin, 0.0)
    theta = np.where(gone < 0.05, 16.0 * gone**2, 1.6 * (gone - 0.025)) + 0.7 * seed
    states = _run(create_estimator("causal"), time, np.rint(theta / step) * step)
    truth = np.minimum(32.0 * gone, 1.6)[states.index]
    assert np.sum((truth > 0.03) & (np.abs(states.omega_rad_s) < 0.1 * truth)) <= 8


@pytest.mark.parametrize("view", ["causal", "lag", "smooth"])
def test_a_start_read_without_any_noise(view: str) -> None:
    """Readings of a simulator: a filter exact at standstill dominated for ten readings of the start."""
    record = make("runs", 34)
    states = _run(create_estimator(view), record.time_s, record.fed_rad)
    start = (record.time_s[states.index] > 9.9) & (record.time_s[states.index] < 10.5)
    off = (states.omega_rad_s - record.omega[states.index])[start]
    assert np.abs(off).max() < 0.004 * record.omega.max()


@pytest.mark.parametrize("standstill_s", [0.7, 8.0])
@pytest.mark.parametrize("teeth", [0, 6])
@pytest.mark.parametrize("view", ["causal", "smooth"])
def test_a_pause_before_the_first_motion_is_no_interval(view: str, teeth: int, standstill_s: float) -> None:
    """A wheel at standstill has no edges, and a logger may begin with an old reading."""
    if teeth:
        angles = np.arange(600) * TURN / teeth
        time = np.append(0.0, standstill_s + np.sqrt(2.0 * angles[1:] / 3.0))  # 3 rad/s^2 from standstill
    else:
        time = np.append(0.0, standstill_s + np.arange(600) * 0.002)
        angles = np.append(0.0, 1.5 * (time[1:] - standstill_s) ** 2)
    estimator = create_estimator(view, teeth=teeth)
    states = _run(estimator, time, angles)
    truth = 3.0 * (time[states.index] - standstill_s)
    late = states.index > 60
    assert np.abs(states.omega_rad_s - truth)[late].max() < 0.02 * truth.max()
    assert estimator.report.repeats <= (1 if teeth else 25)
    assert estimator.report.losses == 0


@pytest.mark.parametrize("seed", [0, *more(1, 2)])
def test_smooth_is_as_good_before_a_run_down_as_without_it(seed: int) -> None:
    """A flywheel of 6 edges a turn, driven by strokes, that coasts at the end: its edges come ever more seldom."""
    rng, dt = np.random.default_rng(seed), 1e-4
    time = np.arange(0.0, 90.0, dt)
    driven = time < 30.0
    push = np.where(driven, 12.0 * np.maximum(np.sin(TURN * time / 1.9), 0.0) ** 2, 0.0)
    omega, theta = np.empty(time.size), np.empty(time.size)
    omega[0], theta[0] = 50.0, 0.0
    for i in range(time.size - 1):
        omega[i + 1] = omega[i] + dt * (push[i] - 0.12 * omega[i])
        theta[i + 1] = theta[i] + dt * 0.5 * (omega[i] + omega[i + 1])
    edges = np.arange(1, int(theta[-1] * 6.0 / TURN)) * TURN / 6.0
    stamps = np.interp(edges, theta, time) + rng.normal(0.0, 20e-6, edges.size)
    off = []
    for last in (29.0, 90.0):
        part = stamps < last
        estimator = create_estimator("smooth", teeth=6)
        states = _run(estimator, stamps[part], edges[part])
        at = stamps[states.index]
        late = (at > 5.0) & (at < 25.0)
        off.append(np.sqrt(np.mean((states.omega_rad_s - np.interp(at, time, omega))[late] ** 2)))
    assert off[1] < 1.2 * off[0]


def test_a_reading_far_beyond_a_turn_is_not_wrapped() -> None:
    """The first reading decides: otherwise turns within a pause are lost before the readings' range shows it."""
    time = np.arange(400) * 0.02
    theta = -48.0 - 12.5 * np.clip(time - 4.0, 0.0, None) ** 2
    heard = (time < 4.1) | (time > 5.0)
    states = _run(create_estimator("causal"), time[heard], theta[heard])
    assert np.abs(states.theta_rad - theta[heard][states.index]).max() < 0.1


@pytest.mark.parametrize("counts", [24, 48, 90])
@pytest.mark.parametrize("view", ["causal", "lag", "smooth"])
def test_a_wheel_of_few_steps_that_moves_by_one_at_a_time_does_not_slip(view: str, counts: int) -> None:
    """Hall sensors: after a standstill each step is far larger than the guessed one."""
    rng, time, step = np.random.default_rng(counts), np.arange(6000) * 0.002, TURN / counts
    pace = np.where(time > 2.0, 0.5 + 3.0 * np.abs(np.sin(0.9 * time)), 0.0) * 12.0 / counts
    theta = np.cumsum(pace * TURN / 12.0) * 0.002 * counts / 12.0 + rng.random()
    estimator = create_estimator(view)
    states = _run(estimator, time, np.floor(theta / step) * step)
    assert np.abs(states.omega_rad_s).max() < 8.0 * np.gradient(theta, time).max()
    assert np.abs(states.theta_rad - theta[states.index]).max() < 2.0 * step
    assert estimator.report.jumps <= 1
