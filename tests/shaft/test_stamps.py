"""Stamps of others' making: two at once, several at the end of each wait, readings as old as a controller's cycle."""

from __future__ import annotations

import numpy as np
import pytest

from tests.shaft.disturbances import wander
from tests.shaft.shaft_motion import Law, ShaftMotion
from tests.shaft.shaft_signal import make_signal
from tests.shaft.textbook import textbook
from textile_twin_core.shaft import ShaftStates, create_estimator


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


@pytest.mark.parametrize("view", ["causal", "lag", "smooth"])
def test_readings_that_arrive_in_packets(view: str) -> None:
    """Eight every 8 ms from the very first on, 20 us apart: the slope within a packet, 2000 rad/s, is no speed."""
    signal = make_signal(5, duration_s=8.0, rate_hz=1000.0, rpm=380.0, dropped=0.0, jitter_s=0.0)
    count, estimator = np.arange(signal.time.size), create_estimator(view)
    parts = [estimator.step(signal.time[count // 8 * 8 + 7] + count % 8 * 2e-5, signal.angles), estimator.finish()]
    states = ShaftStates.join([part for part in parts if len(part)])
    late = states.index > 0.15 * signal.time.size
    assert states.settled[late].all()
    assert np.abs(states.omega_rad_s - signal.omega[states.index])[late].max() < 0.8


@pytest.mark.parametrize("view", ["causal", "smooth"])
def test_readings_of_a_controller_whose_cycle_drifts_past_the_polls(view: str) -> None:
    """Asked at 50 Hz, it reads each 4 ms by a clock of its own: for seconds readings are new or a cycle old by chance.

    Few of them are there in a turn, so that the ripple alternates, too. Taken for motion, they are up to 2000 times the
    error of the textbook. Live that is still so in one record of five (docs/validation/shaft.md): these are others.
    """
    assert max(_polled(seed, view) for seed in (0, 2, 3, 4, 5, 6)) < 2.0


@pytest.mark.parametrize("view", ["causal", "lag", "smooth"])
def test_readings_of_a_controller_read_once_a_cycle(view: str) -> None:
    """The clocks drift apart: each of some hundred readings may be a cycle old, and the next one is not.

    Such a reading has the innovation of the rejected one before it, and is no motion, though short memories would
    follow it: then one record in four is off by 1.9 to 4 times the textbook's error, one in 24 by 16.
    """
    drifts = [10.0 ** np.random.default_rng(seed).uniform(-4.0, -1.7) for seed in range(12)]
    ratios = np.array([_read_each_cycle(seed, view, drift) for seed, drift in enumerate(drifts)])
    assert np.exp(np.mean(np.log(ratios))) < 0.7
    assert ratios.max() < 2.0


@pytest.mark.parametrize("seed", [0, 5, 15, 17, 20, 21])
def test_slips_that_come_again_and_again_are_a_speed(seed: int) -> None:
    """Asked at intervals 6 to 15 % other than its cycle: as slips they left the speed off by as much, 3 to 9 times."""
    drift = (-1) ** seed * np.random.default_rng(seed).uniform(0.06, 0.15)
    assert _read_each_cycle(seed, "causal", drift, late=0.0) < 1.0


@pytest.mark.parametrize("view", ["causal", "smooth"])
@pytest.mark.parametrize(("cycle_s", "rate_hz"), [(4e-3, 50.0), (10e-3, 50.0), (10e-3, 100.0)])
def test_a_configured_cycle_of_the_controller(view: str, cycle_s: float, rate_hz: float) -> None:
    """The stamps' error is 0.3 of the cycle (1 / sqrt 12); readings equally old for minutes are not exact.

    Filters that take them for exact see slips and outliers when the clocks pass each other.
    """
    ratios = [_polled(seed, view, cycle_s, rate_hz, 0.3 * cycle_s) for seed in range(4, 8)]
    assert max(ratios) < 1.4


def _read_each_cycle(seed: int, view: str, drift: float, late: float = 0.05) -> float:
    """Error of the speed over the textbook's, of a controller read once in (1 + `drift`) cycles."""
    rng = np.random.default_rng([seed, 41])
    cycle_s, count = rng.choice([2e-3, 4e-3, 10e-3]), 6000
    speed = rng.uniform(60.0, 400.0) * 2.0 * np.pi / 60.0
    waves = np.array([(float(k), rng.uniform(0.005, 0.03), rng.uniform(0.0, 6.0)) for k in range(1, 5)])
    stamps = 0.1 + np.arange(count) * cycle_s * (1.0 + drift)
    stamps += late * cycle_s * np.abs(rng.normal(size=count))
    grid = np.ones(int(stamps[-1] / 5e-4) + 2)
    motion = ShaftMotion.solve(Law(5e-4, 0.0 * grid, speed * grid, 20.0, waves, grid), 0.3)
    step = 2.0 * np.pi / 2.0 ** rng.integers(12, 15)
    age = rng.uniform(0.0, cycle_s)
    read = np.floor(motion.at(np.maximum(np.floor((stamps + age) / cycle_s) * cycle_s - age, 0.0))[0] / step) * step
    estimator = create_estimator(view)
    states = ShaftStates.join([part for part in (estimator.step(stamps, read), estimator.finish()) if len(part)])
    rows, truth = states.index[states.index > 0.1 * count], motion.at(stamps)[1]
    book = getattr(textbook(stamps, read), "causal" if view == "causal" else "smooth")[rows, 1]
    off = states.omega_rad_s[states.index > 0.1 * count] - truth[rows]
    return float(np.sqrt(np.mean(off**2) / np.mean((book - truth[rows]) ** 2)))


def _polled(
    seed: int, view: str, cycle_s: float = 4e-3, rate_hz: float = 50.0, configured_s: float | None = None
) -> float:
    """Error of the acceleration over the textbook's, of two minutes."""
    rng = np.random.default_rng([seed, 99])
    count, drift = 240_001, cycle_s * (1.0 + 1e-4)
    speed = rng.uniform(80.0, 180.0) * 2.0 * np.pi / 60.0
    push = wander(rng, count, 5e-4, rng.uniform(0.5, 5.0), 0.01 * speed)
    waves = np.array([[1.0, 0.01, 1.0], [2.0, 0.003, 2.0]])[: 2 * (seed % 2)].reshape(-1, 3)
    motion = ShaftMotion.solve(Law(5e-4, push, np.full(count, speed), 2.0, waves, np.ones(count)), 0.3)
    stamps = np.arange(0.04, 119.6, 1.0 / rate_hz)
    stamps += np.abs(rng.normal(0.0, 5e-4, stamps.size))
    step = 2.0 * np.pi / 4096
    read = np.round(motion.at(np.floor((stamps - 0.013) / drift) * drift + 0.013)[0] / step) * step
    estimator = create_estimator(view, stamp_jitter_s=configured_s)
    states = [estimator.step(stamps, read), estimator.finish()][view == "smooth"]
    late = states.index > 0.25 * stamps.size
    rows, truth = states.index[late], motion.at(stamps)[2]
    off, book = states.alpha_rad_s2[late] - truth[rows], getattr(textbook(stamps, read), view)[rows, 2] - truth[rows]
    return float(np.sqrt(np.mean(off**2) / np.mean(book**2)))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("view", ["causal", "lag", "smooth"])
def test_stamps_of_a_host_that_is_late_now_and_then(view: str, seed: int) -> None:
    """Up to 30 ms late, with the readings that waited stamped 10 ns apart: no speed is computed between these."""
    rng, time, step = np.random.default_rng([80, seed]), np.arange(2500) * 2e-3, 2.0 * np.pi / 2**14
    phase = rng.uniform(0.0, 2.0 * np.pi)
    theta = 20.0 * time + 0.05 * np.sin(20.0 * time + phase)
    late = np.minimum(1e-4 * np.abs(rng.standard_t(1.5, time.size)), 0.03)
    stamps = np.maximum.accumulate(time + late) + 1e-8 * np.arange(time.size)
    estimator = create_estimator(view)
    parts = [estimator.step(stamps, np.round(theta / step) * step), estimator.finish()]
    states = ShaftStates.join([part for part in parts if len(part)])
    off = np.abs(states.omega_rad_s - 20.0 - np.cos(20.0 * stamps[states.index] + phase))
    assert off[states.index > 0.15 * time.size].max() < 2.0
    assert estimator.report.losses == 0
