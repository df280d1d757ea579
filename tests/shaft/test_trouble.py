"""Faults of sensors and machines: nothing raises or diverges, every accepted sample gets its state."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.benchmarks.shaft_judge.kinds_score import not_positive
from tests.shaft.kinds import make
from tests.shaft.shaft_signal import make_signal
from textile_twin_core.errors import SceneError
from textile_twin_core.shaft import ShaftStates, create_estimator

NAMES = ("causal", "lag", "smooth")
STEP = 2 * np.pi / 2**14
W = 160 * 2 * np.pi / 60


def run(name: str, stamps: np.ndarray, angles: np.ndarray, **settings: object) -> tuple[ShaftStates, object]:
    estimator = create_estimator(name, **settings)
    parts = [estimator.step(stamps, angles), estimator.finish()]
    return ShaftStates.join([part for part in parts if len(part)]), estimator.report


def turned(speed: Callable[[np.ndarray], np.ndarray], seconds: float) -> tuple[np.ndarray, ...]:
    """Stamps [s], true angle and speed, and readings of a 14-bit encoder with 20 us of jitter."""
    fine = np.arange(0, seconds + 0.01, 1e-4)
    omega = speed(fine)
    theta = np.concatenate([[0.0], np.cumsum((omega[1:] + omega[:-1]) / 2 * 1e-4)])
    time = np.arange(0, seconds, 0.002)
    seen = np.interp(time + np.random.default_rng(7).normal(0, 2e-5, time.size), fine, theta)
    reading = np.mod(np.round(seen / STEP) * STEP, 2 * np.pi)
    return time, np.interp(time, fine, theta), np.interp(time, fine, omega), reading


def off(states: ShaftStates, theta: np.ndarray) -> np.ndarray:
    difference = states.theta_rad - theta[states.index]
    return difference - 2 * np.pi * np.round(difference / (2 * np.pi))


MOTIONS = {
    "standstill": lambda t: 0 * t,
    "run-up": lambda t: W * np.clip((t - 1) / 1.5, 0, 1),
    "stop and restart": lambda t: W * np.interp(t, [0, 1.5, 1.8, 2.8, 3.8, 9], [1, 1, 0, 0, 1, 1]),
    "emergency stop": lambda t: W * np.interp(t, [0, 3, 3.05, 9], [1, 1, 0, 0]),
    "reversal": lambda t: W * np.interp(t, [0, 2, 3, 9], [1, 1, -1, -1]),
}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("motion", MOTIONS)
def test_motions(name: str, motion: str) -> None:
    time, theta, omega, reading = turned(MOTIONS[motion], 5.0)
    states, report = run(name, time, reading)
    assert len(states) == time.size - 2
    assert np.isfinite(states.covariance).all() and np.isfinite(states.alpha_rad_s2).all()
    assert np.abs(off(states, theta)).max() < 0.1
    error = np.abs(states.omega_rad_s - omega[states.index])
    assert np.sqrt(np.mean(error**2)) < 0.015 * W
    assert error[-250:].max() < 0.01 * W
    if motion == "reversal" and name != "smooth":
        assert report.reversals == 1
    if motion == "standstill":
        assert np.abs(states.omega_rad_s).max() < 1e-6
        assert np.all(states.sigma[:, 0] < 0.02)


@pytest.mark.parametrize("name", NAMES)
def test_a_gap_of_ten_seconds(name: str) -> None:
    signal = make_signal(3, duration_s=17.0)
    kept = (signal.time < 4) | (signal.time > 14)
    states, report = run(name, signal.stamps_ns[kept], signal.angles[kept])
    assert report.gaps == 1
    assert len(states) == np.count_nonzero(kept) - 2
    assert np.abs(off(states, signal.theta[kept])).max() < 0.01
    error = np.abs(states.omega_rad_s - signal.omega[kept][states.index])
    time = signal.time[kept][states.index]
    assert error[time > 15].max() < 0.02
    assert error[time > 1].max() < 1.0


@pytest.mark.parametrize("name", NAMES)
def test_an_encoder_that_slips_by_half_a_turn(name: str) -> None:
    signal = make_signal(4, duration_s=8.0)
    jumped = signal.time > 4
    states, report = run(name, signal.stamps_ns, np.mod(signal.angles + np.pi * jumped, 2 * np.pi))
    assert report.jumps == 1
    error = np.abs(states.omega_rad_s - signal.omega[states.index])
    assert error[signal.time[states.index] > 1].max() < 0.7
    assert np.abs(off(states, signal.theta + np.pi * jumped))[signal.time[states.index] > 4.1].max() < 0.005


@pytest.mark.parametrize("name", NAMES)
def test_single_wild_readings_are_bridged(name: str) -> None:
    signal = make_signal(5, duration_s=6.0)
    angles = signal.angles.copy()
    angles[[1500, 2000]] = np.mod(angles[[1500, 2000]] + (1.0, 3.0), 2 * np.pi)
    states, report = run(name, signal.stamps_ns, angles)
    assert (report.outliers, report.jumps) == (2, 0)
    assert len(states) == angles.size - 2
    assert np.abs(off(states, signal.theta))[1000:].max() < 0.002


@pytest.mark.parametrize("name", NAMES)
def test_bad_samples_change_nothing_for_the_good_ones(name: str) -> None:
    signal = make_signal(6, duration_s=4.0)
    clean, _ = run(name, signal.stamps_ns, signal.angles)
    rng = np.random.default_rng(0)
    places = np.sort(rng.choice(np.arange(1, signal.angles.size), 90, replace=False))
    stamps = np.insert(signal.stamps_ns, places, signal.stamps_ns[places - 1] - np.repeat([0, 1, 10**7], 30))
    angles = np.insert(signal.angles, places, rng.uniform(0, 6, 90))
    nan_at = np.arange(5, angles.size, 400)
    stamps = np.insert(stamps, nan_at, stamps[nan_at])
    angles = np.insert(angles, nan_at, np.nan)
    dirty, report = run(name, stamps, angles)
    assert report.rejected["duplicate_stamp"] == 30
    assert report.rejected["older_stamp"] == 60
    assert report.rejected["not_finite"] == nan_at.size
    assert np.array_equal(clean.stamps, dirty.stamps)
    assert dirty.stamps.dtype == np.int64
    for field in ("theta_rad", "omega_rad_s", "alpha_rad_s2", "covariance"):
        assert np.array_equal(getattr(clean, field), getattr(dirty, field)), field


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("largest", [5e11, 5e259])
def test_numbers_that_are_no_angles_spoil_no_others(name: str, largest: float) -> None:
    """Logs hold what was in memory: squared often enough it overflowed, and smoothing ended the process."""
    time = np.arange(0.0, 6.0, 0.002)
    rng = np.random.default_rng(4)
    wild = (rng.random(time.size) < 0.01) & (time > 1.0)
    wrong = 10.0 ** rng.uniform(-300.0, np.log10(largest), time.size)
    states, report = run(name, time, np.where(wild, wrong, W * time))
    assert np.isfinite(states.covariance).all()
    assert not_positive(states.covariance) == 0
    assert report.rejected["not_finite"] == np.count_nonzero(wild & (wrong > 1e12))
    assert np.median(np.abs(states.omega_rad_s[states.settled] - W)) < 1e-3 * W


@pytest.mark.parametrize("name", NAMES)
def test_stamps_less_than_a_nanosecond_apart_are_one(name: str) -> None:
    """Stamps in a unit of another size: speeds overflowed."""
    time, estimator = np.arange(0.0, 6.0, 0.002), create_estimator(name)
    assert len(estimator.step(1e-100 * time, W * time)) == len(estimator.finish()) == 0
    assert estimator.report.rejected["duplicate_stamp"] == time.size - 1


@pytest.mark.parametrize("name", NAMES)
def test_blocks_do_not_matter(name: str) -> None:
    signal = make_signal(7, duration_s=4.0, knocks=True)
    whole, _ = run(name, signal.stamps_ns, signal.angles)
    estimator, parts, at = create_estimator(name), [], 0
    rng = np.random.default_rng(1)
    while at < signal.angles.size:
        size = int(rng.choice([1, 2, 7, 100]))
        parts.append(estimator.step(signal.stamps_ns[at : at + size], signal.angles[at : at + size]))
        at += size
    parts.append(estimator.finish())
    cut = ShaftStates.join(parts)
    for field in ("stamps", "index", "theta_rad", "omega_rad_s", "alpha_rad_s2", "covariance", "settled"):
        assert np.array_equal(getattr(whole, field), getattr(cut, field)), field


def test_states_come_when_they_should() -> None:
    signal = make_signal(8, duration_s=2.0)
    causal, lag = create_estimator("causal"), create_estimator("lag", shaft_lag_s=0.04)
    for place, (stamp, angle) in enumerate(zip(signal.stamps_ns, signal.angles, strict=True)):
        now = causal.step(stamp, angle)
        assert now.index.tolist() == ([place] if place >= 2 else [])
        for late in lag.step(stamp, angle).stamps:
            assert stamp - late >= 40_000_000
            assert stamp - late < 40_000_000 + 30_000_000  # a few dropped samples
    assert len(causal.finish()) == 0
    assert 15 <= len(lag.finish()) <= 21
    for estimator in (causal, lag):
        estimator.reset()
        assert estimator.report.received == 0
        assert len(estimator.step(signal.stamps_ns[:3], signal.angles[:3])) == (1 if estimator is causal else 0)


@pytest.mark.parametrize("name", NAMES)
def test_a_counting_input_keeps_its_count_and_its_digits(name: str) -> None:
    signal = make_signal(9, duration_s=4.0, bits=None, wrapped=False)
    near, _ = run(name, signal.stamps_ns, signal.angles)
    assert np.abs(near.theta_rad - signal.theta[near.index]).max() < 0.005
    turns = 159_154_943
    far, _ = run(name, signal.stamps_ns, signal.angles + 2 * np.pi * turns)
    assert np.abs(far.theta_rad - 1e9).max() < 100
    assert np.array_equal(far.turns - near.turns, np.full(len(far), turns))
    late = slice(1000, None)
    # The input itself is rounded to 1.2e-7 rad out there.
    assert np.abs(far.phase_rad - near.phase_rad)[late].max() < 1e-6
    assert np.abs(far.omega_rad_s - near.omega_rad_s)[late].max() < 1e-3


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.filterwarnings("error")
def test_readings_that_follow_no_motion_do_no_harm(name: str) -> None:
    rng = np.random.default_rng(2)
    stamps = np.arange(400) * 2_000_000
    for angles in (rng.uniform(0, 6.28, 400), rng.normal(0, 1e6, 400), np.zeros(400), rng.choice([0.0, 3.0], 400)):
        states, _ = run(name, stamps, angles)
        assert len(states) == 398
        assert np.isfinite(states.omega_rad_s).all()
        assert np.isfinite(states.covariance).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_handful_of_samples(name: str) -> None:
    for count in range(7):
        stamps, angles = np.arange(count) * 0.01, 0.1 * np.arange(count)
        estimator = create_estimator(name)
        parts = [estimator.step(stamps, angles), estimator.finish()]
        assert sum(len(part) for part in parts) == max(count - 2, 0)


@pytest.mark.parametrize("rate_hz", [25.0, 100.0, 5000.0])
def test_any_sample_rate(rate_hz: float) -> None:
    seconds = 1.2 if rate_hz > 1000 else 8.0
    signal = make_signal(10, rate_hz=rate_hz, duration_s=seconds)
    states, report = run("lag", signal.stamps_ns, signal.angles)
    late = signal.time[states.index] > seconds * 0.7
    error = states.omega_rad_s - signal.omega[states.index]
    assert np.sqrt(np.mean(error[late] ** 2)) < 0.02
    assert report.period_s == pytest.approx(1 / rate_hz, rel=0.15)


@pytest.mark.parametrize("view", ["causal", "smooth"])
def test_a_speed_that_the_sensor_gives_helps_at_the_start_and_harms_nowhere(view: str) -> None:
    """A drive's speed is smoothed and late: here by 20 ms, with load knocks. Zero at all times is not believed."""
    errors = {}
    for seed in range(11, 15):
        signal = make_signal(seed, duration_s=3.0, bits=10, knocks=True)
        late = np.interp(signal.time - 0.02, signal.time, signal.omega)
        for label, velocities in {"none": None, "good": signal.omega, "late": late, "zero": 0.0 * late}.items():
            estimator = create_estimator(view)
            states = [estimator.step(signal.stamps_ns, signal.angles, velocities), estimator.finish()][view == "smooth"]
            off = (states.omega_rad_s - signal.omega[states.index]) ** 2
            errors.setdefault(label, []).append([off[:8].mean(), off[700:].mean()])
    start, rest = np.sqrt(np.mean(list(errors.values()), axis=1)).T
    assert start[1] < (0.8 if view == "causal" else 1.3) * start[0]  # smooth knows what follows, and needs it not
    assert np.all(start[2:] < (1.01 if view == "causal" else 1.3) * start[0])
    np.testing.assert_allclose(rest, rest[0], rtol=0.1)


def test_mistakes_of_the_caller_are_named() -> None:
    with pytest.raises(SceneError, match="unknown shaft estimator 'kalman': choose one of causal, lag, smooth"):
        create_estimator("kalman")
    with pytest.raises(
        SceneError, match=r"'causal' has no setting 'shaft_lag'; available: encoder_bits, .*, period_rad, reading_at$"
    ):
        create_estimator("causal", shaft_lag=1)
    with pytest.raises(SceneError, match=r"'lag' has no setting 'shaft_lag'; available: .*, shaft_lag_s$"):
        create_estimator("lag", shaft_lag=1)
    with pytest.raises(SceneError, match="positive"):
        create_estimator("lag", shaft_lag_s=0.0)


@pytest.mark.parametrize("bits", [9, 12, 16])
def test_a_crash_within_two_samples_is_followed(bits: int) -> None:
    """Readings that the gate sets aside until the third tells that they are motion are smoothed with the others."""
    time, crash, step = np.arange(1, 4001) * 0.002, 4.003, 2 * np.pi / 2**bits
    braked = np.clip(time - crash, 0.0, 0.004)
    theta = 30.0 * (np.minimum(time, crash) + braked - braked**2 / 0.008)
    omega = 30.0 * (1.0 - braked / 0.004)
    limits = {"causal": (3.5, 2.0), "lag": (1.0, 0.5), "smooth": (1.0, 0.5)}
    for name, (by_speed, by_steps) in limits.items():
        states, _ = run(name, np.rint(time * 1e9).astype(np.int64), np.round(theta / step) * step)
        around = np.abs(time[states.index] - crash - 0.05) < 0.25
        off_by = (states.omega_rad_s - omega[states.index])[around]
        assert np.sqrt(np.mean(off_by**2)) < by_speed, name
        assert np.sqrt(np.mean(off(states, theta)[around] ** 2)) < max(by_steps * step, 0.01), name


def test_the_covariance_of_a_mixture_does_not_cancel() -> None:
    """A shaft stops, read to 1e-12 rad: the speed changes by a billion times its sigma."""
    record = make("runs", 636)
    assert not_positive(create_estimator("causal").step(record.time_s, record.fed_rad).covariance) == 0
