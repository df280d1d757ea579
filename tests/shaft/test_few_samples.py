"""Few samples a turn in coarse steps, with outliers: the step and the ripple are estimated, the sigmas hold."""

from __future__ import annotations

import numpy as np
import pytest

from tests.shaft.kinds import TURN, make
from tests.shaft.shaft_motion import Law, ShaftMotion
from tests.shaft.textbook import textbook
from textile_twin_core.shaft import ShaftStates, create_estimator
from textile_twin_core.shaft.encoder import encoder_step

LATE = 0.15
"""Part of a record in which estimators adapt."""


@pytest.mark.parametrize("seed", [31, 35, 39])
def test_the_step_is_estimated_beside_outliers(seed: int) -> None:
    """One degree; of the first 24 readings up to two are half a radian off."""
    record = make("coarse+3%", seed)
    step = encoder_step(record.time_s[:24], record.fed_rad[:24])
    assert step == pytest.approx(np.deg2rad(1.0), rel=1e-9)


def test_outliers_do_not_define_the_step_of_a_shaft_at_standstill() -> None:
    record = make("standstill+3%", 9)
    estimator = create_estimator("causal")
    estimator.step(record.time_s, record.fed_rad)
    assert estimator.report.resolution_rad == pytest.approx(2.0 * np.pi / 4096, rel=1e-9)


def test_no_step_where_readings_are_not_rounded() -> None:
    rng = np.random.default_rng(1)
    assert encoder_step(np.arange(48.0), np.cumsum(rng.uniform(0.5, 1.0, 48))) == 0.0
    assert encoder_step(np.arange(48.0), np.zeros(48)) is None


def test_an_even_speed_that_stops_is_no_step() -> None:
    """A simulated shaft, or exact stamps: moves from sample to sample are equal for long."""
    sample = np.arange(768.0)
    for brake in (20.6, 61.0, 120.6):
        gone = np.clip((sample - 480.0) / brake, 0.0, 1.0)
        turned = np.minimum(sample, 480.0) + 0.5 * brake * (gone + np.sin(np.pi * gone) / np.pi)
        assert encoder_step(0.004 * sample, 0.1511 * turned) == 0.0


def test_edges_of_teeth_are_not_rounded_and_sampling_nearly_in_step_is() -> None:
    """Edges: a gap of teeth takes longer, also where every second tooth is fed; sampling: a skipped step does not."""
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


def test_ripple_is_estimated_at_seven_samples_a_turn() -> None:
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
    assert 0.62 <= np.median(inside) <= 0.82


@pytest.mark.parametrize(("orders", "samples"), [(3, 7.3), (3, 11.7), (4, 10.2), (4, 13.9), (6, 16.3), (6, 25.3)])
@pytest.mark.parametrize("view", ["causal", "smooth"])
def test_as_many_orders_of_ripple_are_estimated_as_the_samples_resolve(view: str, orders: int, samples: float) -> None:
    """A controller at 100 Hz, 14 bits: speed and acceleration beside the textbook's, which takes ripple for noise.

    As ripple of two orders 0.3 to 5 times as much where the ripple has three or more.
    """
    dt, speed, rng = 1e-3, TURN * 100.0 / samples, np.random.default_rng(orders)
    sizes = (0.02, 0.03, 0.01, 0.004, 0.003, 0.002)[:orders]
    waves = np.array([(k + 1.0, size, rng.uniform(0.0, TURN)) for k, size in enumerate(sizes)])
    push = 0.02 * speed * np.sin(0.7 * dt * np.arange(30_001))
    motion = ShaftMotion.solve(Law(dt, push, np.full(30_001, speed), 3.0, waves, np.ones(30_001)), 1.0)
    time = np.arange(1, 2990) / 100.0
    angles = np.round(motion.at(time)[0] / (TURN / 2**14)) * (TURN / 2**14)
    estimator = create_estimator(view)
    states = ShaftStates.join([estimator.step(time, angles), estimator.finish()])
    late = states.index > 600
    at = states.index[late]
    truth = np.stack(motion.at(time[at])[1:], axis=1)
    off = np.stack([states.omega_rad_s[late], states.alpha_rad_s2[late]], axis=1) - truth
    book = getattr(textbook(time, angles), view)[at, 1:] - truth
    most = 0.3 if view == "causal" else 0.8
    assert np.all(np.mean(off**2, axis=0) < most**2 * np.mean(book**2, axis=0))


@pytest.mark.parametrize("seed", range(6))
def test_a_record_that_ends_faster_keeps_the_ripple_that_it_had(seed: int) -> None:
    """Eight orders, 20 to 34 readings a turn for 9 s and 6 to 15 at the end; ripple forgotten: 0.4 and more."""
    rng, place = np.random.default_rng([6, seed]), np.arange(1000)
    time, ramp = place / 100.0, np.clip((place - 900) / 40.0, 0.0, 1.0)
    more = rng.uniform(1.2, 2.5) * ramp**2 * (3.0 - 2.0 * ramp)
    speed = TURN * 100.0 / rng.uniform(20.0, 34.0) * (1.0 + more)
    even = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1])) / 100.0])
    orders = np.arange(1.0, 9.0)
    angle, size = np.outer(even, orders) + rng.uniform(0.0, TURN, 8), rng.uniform(0.01, 0.03, 8) / orders**2
    step = TURN / 2**14
    estimator = create_estimator("smooth")
    estimator.step(time, np.round((even + np.sin(angle) @ size) / step) * step)
    states = estimator.finish()
    at = states.index[(states.index > 150) & (states.index < 880)]
    truth = -(speed**2 * (np.sin(angle) @ (size * orders**2)))[at]
    off = states.alpha_rad_s2[np.isin(states.index, at)] - truth
    assert np.mean(off**2) < 0.15**2 * np.mean(truth**2)


def test_filters_stay_finite_while_the_orders_change() -> None:
    """Exact readings, 16 to 26 a turn and back each 20 s: filters of long memory get and lose two to four orders."""
    time = np.arange(1, 16_001) / 20.0
    speed = TURN * 20.0 / (21.0 + 5.0 * np.sin(TURN * time / 20.0))
    estimator = create_estimator("causal")
    for part in np.split(np.stack([time, np.cumsum(speed) / 20.0]), 100, axis=1):
        states = estimator.step(*part)
        filters = estimator._status["bank"]["filters"][0]
        assert all(np.all(np.isfinite(filters[name])) for name in ("clock", "factor", "ripple", "probability"))
        assert np.all(np.isfinite(states.covariance))


def test_a_wrapped_angle_does_not_run_away() -> None:
    """A record with outliers at a stop: a speed of more than half a period a sample is ambiguous."""
    record = make("coarse+3%", 23)
    states = create_estimator("causal").step(record.time_s, record.fed_rad)
    error = np.abs(states.omega_rad_s - record.omega[states.index])
    assert np.mean(error > 0.2 * np.abs(record.omega).max()) < 0.05


@pytest.mark.parametrize("view", ["causal", "smooth"])
def test_the_ripple_of_a_long_record_is_not_overrated(view: str) -> None:
    """Stamps wrong by 20 us, 14 exact readings a turn, four orders: a coefficient's error lasts the whole record."""
    inside = []
    for seed in range(8):
        rng, count = np.random.default_rng([seed, 3]), 85_000
        waves = np.array([(k, 0.03 / k * rng.uniform(0.3, 1.0), rng.uniform(0.0, TURN)) for k in (1.0, 2.0, 3.0, 4.0)])
        law = Law(1e-3, np.zeros(count), np.full(count, rng.uniform(60.0, 75.0)), 20.0, waves, np.ones(count))
        shaft, time = ShaftMotion.solve(law, 0.3), np.arange(1, 12_000) / 150.0
        stamps = time + rng.normal(0.0, 2e-5, time.size)
        estimator = create_estimator(view)
        states = [estimator.step(stamps, shaft.at(time)[0]), estimator.finish()][view == "smooth"]
        late = states.index > 6000
        truth = np.stack(shaft.at(stamps)[1:], axis=1)[states.index[late]]
        told = np.stack([states.omega_rad_s[late], states.alpha_rad_s2[late]], axis=1)
        inside.append(np.mean(np.abs(told - truth) <= states.sigma[late, 1:], axis=0))
    most = {"causal": 0.95, "smooth": 0.763}[view]  # `causal` knows the higher orders by the last 1000 readings alone
    assert np.all((np.mean(inside, axis=0) > 0.603) & (np.mean(inside, axis=0) < most)), np.mean(inside, axis=0)
