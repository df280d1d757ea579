"""A long standstill between a run-down and a start spoils the states on neither side."""

from __future__ import annotations

import numpy as np
import pytest

from tests.campaign import more
from tests.shaft.kinds import make
from tests.shaft.textbook import textbook
from textile_twin_core.shaft import ShaftStates, create_estimator

TURN = 2.0 * np.pi
SPEED = 18.85
DOWN_S, UP_S = (10.0, 6.0), (30.0, 4.0)
"""When the shaft slows down and starts, and for how long it does."""


def motion(time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angle, speed, acceleration: cycloids between speed and standstill."""
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
def test_run_down_and_start_around_a_long_standstill(view: str, bits: int | None, jitter_s: float) -> None:
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
    # The first steps of an encoder after a standstill give a poor acceleration, and its sigma says so.
    leaving = (at > 29.9) & (at < 31.5) & states.settled
    assert np.all(off[leaving] < np.maximum(5.0 * sigma[leaving], 1.0))


@pytest.mark.parametrize("noise_rad", [2e-4, 1e-3, 3e-3])
@pytest.mark.parametrize("bits", [16, None])
def test_noise_that_does_not_fade_with_the_speed(bits: int | None, noise_rad: float) -> None:
    """Resolvers, and encoders finer than their vibration: a running shaft cannot separate noise and late stamps."""
    time = np.arange(0.0, 40.0, 0.002)
    read = motion(time)[0] + noise_rad * np.random.default_rng(3).normal(size=time.size)
    if bits:
        read = np.rint(read * 2**bits / TURN) * TURN / 2**bits
    assert np.all(beside_the_textbook(time, read) < [1.1, 1.35])


def test_stamps_that_are_late_now_and_then_are_no_blows() -> None:
    """Stamps late by 0.3 ms on average, exponentially: two very late ones in a row look like a blow."""
    time, ratios = np.arange(0.0, 40.0, 0.002), []
    for seed in range(1, 7):
        late = time + np.random.default_rng(seed).exponential(3e-4, time.size)
        ratios.append(beside_the_textbook(late, np.rint(motion(time)[0] * 2**16 / TURN) * TURN / 2**16))
    assert np.all(np.median(ratios, axis=0) < [1.1, 1.25]), ratios


def beside_the_textbook(time: np.ndarray, read: np.ndarray) -> np.ndarray:
    """Errors of speed and acceleration (causal, smooth; 2) over those of the textbook's filter tuned on the record."""
    book, truth, ratios = textbook(time, read), np.stack(motion(time)[1:], axis=1), []
    for view, tuned in (("causal", book.causal), ("smooth", book.smooth)):
        estimator = create_estimator(view)
        states = [estimator.step(time, read), estimator.finish()][view == "smooth"]
        at = states.index[states.index > 0.1 * time.size]
        ours = np.stack([states.omega_rad_s, states.alpha_rad_s2], axis=1)[-at.size :]
        errors = [np.mean((each - truth[at]) ** 2, axis=0) for each in (ours, tuned[at, 1:])]
        ratios.append(np.sqrt(errors[0] / errors[1]))
    return np.array(ratios)


@pytest.mark.parametrize("seeds", [range(12), *more(range(12, 24))], ids=str)
@pytest.mark.parametrize("view", ["causal", "lag", "smooth"])
def test_no_sequence_of_runs_and_standstills_spoils_its_neighbours(view: str, seeds: range) -> None:
    spoilt = []
    for seed in seeds:
        record = make("runs", seed)
        estimator = create_estimator(view)
        states = [estimator.step(record.time_s, record.fed_rad), estimator.finish()][view == "smooth"]
        off = np.abs(states.alpha_rad_s2 - record.alpha[states.index])
        sigma = states.sigma[:, 2]
        assert np.all(np.isfinite(states.covariance))
        counts = states.settled & (states.index > 0.1 * record.time_s.size)
        if np.quantile(off[counts], 0.95) > 10.0 or sigma[counts].max() > 1e4:
            spoilt.append((seed, np.quantile(off[counts], 0.95), sigma[counts].max()))
    assert len(spoilt) <= 1, spoilt  # the first steps of a coarse encoder after a standstill may still look like a blow


@pytest.mark.parametrize("view", ["causal", "smooth"])
@pytest.mark.parametrize("configured", [False, True])
@pytest.mark.parametrize("steps", [0.05, 0.25, 0.33, 0.5, 0.9, 0.95, 0.98, 1.01, 1.05, 1.3, 2.01, 7.05])
def test_rounding_that_goes_in_step_with_the_sampling_is_no_motion(view: str, steps: float, configured: bool) -> None:
    """A steady shaft that turns by near whole steps between readings: the beat of both is no blow."""
    rng, step, rate = np.random.default_rng(3), TURN / 1024, 1000.0
    time = np.arange(6000) / rate
    speed = steps * step * rate
    angles = np.round((speed * (time + 5e-6 * rng.normal(size=time.size)) + rng.uniform(0.0, 1.0)) / step) * step
    estimator = create_estimator(view, resolution_rad=step if configured else None)
    states = [estimator.step(np.rint(time * 1e9).astype(np.int64), angles), estimator.finish()][view == "smooth"]
    late = states.index > 2000
    assert np.sqrt(np.mean(states.alpha_rad_s2[late] ** 2)) < 1.0
    assert np.abs(states.omega_rad_s - speed)[late].max() < 0.06 * max(speed, step * rate)


@pytest.mark.parametrize("view", ["causal", "lag", "smooth"])
def test_the_noise_estimate_of_a_standstill_does_not_last(view: str) -> None:
    """A record from standstill: the encoder's step, here none, shows as the shaft turns; the noise must follow."""
    record = make("runs", 7)
    estimator = create_estimator(view)
    states = [estimator.step(record.time_s, record.fed_rad), estimator.finish()][view == "smooth"]
    part = (record.time_s[states.index] > 3.0) & (record.time_s[states.index] < 8.5)
    off = (states.alpha_rad_s2 - record.alpha[states.index])[part]
    assert np.sqrt(np.mean(off**2)) < 1.0


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("view", "most"), [("causal", 1.1), ("lag", 0.95), ("smooth", 0.85)])
def test_noise_of_an_indexed_shaft(view: str, most: float, seed: int) -> None:
    """Moves within 40 ms alternate with standstills, under additive noise.

    Apparent late stamps in a move must not shrink the noise at standstill, and a start must not spoil the standstill
    before it.
    """
    rng, time = np.random.default_rng([81, seed]), np.arange(3000) / 4000.0
    theta, omega, begin = np.zeros(time.size), np.zeros(time.size), 0.04
    while begin < time[-1]:
        x = np.clip((time - begin) / 0.05, 0.0, 1.0)
        height = rng.uniform(2.0, 4.0)
        theta += height * (x - np.sin(TURN * x) / TURN)
        omega += height / 0.05 * (1.0 - np.cos(TURN * x))
        begin += 0.05 + rng.uniform(0.03, 0.05)
    readings = theta + 2e-4 * rng.normal(size=time.size)
    estimator, book = create_estimator(view), textbook(time, readings)
    states = [estimator.step(time, readings), estimator.finish()]
    joined = ShaftStates.join([part for part in states if len(part)])
    late = joined.index > 0.15 * time.size
    tuned = (book.causal if view == "causal" else book.smooth)[joined.index[late], 1]
    truth = omega[joined.index[late]]
    off = np.sqrt(np.mean((joined.omega_rad_s[late] - truth) ** 2) / np.mean((tuned - truth) ** 2))
    assert off < most


@pytest.mark.parametrize("view", ["causal", "lag"])
def test_a_ripple_that_led_before_a_standstill_does_not_prolong_it(view: str) -> None:
    """The ripple model absorbed the start, and at standstill the models were not compared."""
    record = make("runs+3%", 791)
    estimator = create_estimator(view)
    parts = [estimator.step(record.time_s, record.fed_rad), estimator.finish()]
    states = ShaftStates.join([part for part in parts if len(part)])
    truth = record.omega[states.index]
    starts = states.settled & (states.index > 5450) & (states.index < 5550) & (np.abs(truth) > 2.0)
    assert np.all(np.abs(states.omega_rad_s - truth)[starts] < 0.5 * np.abs(truth)[starts])


@pytest.mark.parametrize("seed", range(3))
def test_a_standstill_before_the_encoders_step_was_known(seed: int) -> None:
    """Its readings kept the noise of a guessed step of 9 bits: smoothed angles were a dozen steps off."""
    time, step = np.arange(2000) / 200.0, TURN / 2**15
    x = np.clip(time - 5.0 - 0.1 * seed, 0.0, None)
    readings = np.round((0.2 + 0.02 * x**2 / (1.0 + x)) / step) * step
    estimator = create_estimator("smooth")
    estimator.step(time, readings)
    states = estimator.finish()
    rest = x[states.index] == 0.0
    assert np.abs(states.theta_rad - readings[states.index])[rest].max() < 1.5 * step
    assert np.abs(states.omega_rad_s[rest]).max() < 2e-3


@pytest.mark.parametrize("seed", [433, 450, 463])
def test_exact_readings_at_standstill_do_not_blind_the_start(seed: int) -> None:
    """Weighted by a millionth of their rounding, they made readings of the next start outliers and slips."""
    record = make("runs", seed)
    estimator = create_estimator("causal")
    estimator.step(record.time_s, record.fed_rad)
    report = estimator.report
    assert (report.jumps, report.outliers, report.losses) == (0, 0, 0)
