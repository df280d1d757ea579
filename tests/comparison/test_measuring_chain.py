"""The chain between shaft and log, inferred from recordings of independent equations and filters of scipy."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.campaign import more
from tests.generators.configured_machine import configured_machine
from tests.generators.mill_recordings import Case, Encoder, TorqueSensor, healthy, record
from textile_twin_core.comparison import Assessment, Readings, assess, calibrate
from textile_twin_core.comparison.torque_readings import fresh_readings, time_lines
from textile_twin_core.inference.chain import EvenGrid, torque_filter
from textile_twin_core.inference.parameter import DELAY, FILTERS, GAIN, LOW_PASS, ZERO, gain_factor

FORCE = "loads.backing.force_N"
CHAINS: dict[str, tuple[Encoder, TorqueSensor, str, float]] = {
    "runs out once": (Encoder(run_out_rad=((0.004, -0.007),)), TorqueSensor(), "encoder_eccentricity", 0.00806),
    "runs out twice": (
        Encoder(run_out_rad=((0.0, 0.0), (0.003, 0.004))),
        TorqueSensor(),
        "encoder_eccentricity",
        0.005,
    ),
    "low pass": (
        Encoder(),
        TorqueSensor(low_pass_hz=1.0 / (2.0 * math.pi * 0.01), low_pass_order=1),
        "torque_low_pass",
        0.01,
    ),
    "Butterworth": (Encoder(), TorqueSensor(low_pass_hz=22.0, low_pass_order=2), "torque_low_pass", 22.0),
    "AC coupled": (Encoder(), TorqueSensor(high_pass_hz=0.4), "torque_high_pass", 0.4),
    "mains hum": (Encoder(), TorqueSensor(hum=(1.0, 50.02)), "periodic_noise", 50.02),
    "held": (Encoder(), TorqueSensor(hold_hz=50.0), "", 0.0),
    "stepped": (Encoder(), TorqueSensor(step_Nm=0.5), "", 0.0),
}
NO_PART = {"mass", "inertia", "centroid", "length", "spring", "other_machine"}


def case_of(chain: str) -> Case:
    """A tufting machine of another force, with a sensor that is late, read through a chain."""
    encoder, torque, _, _ = CHAINS[chain]
    case = healthy("tufting", 921, duration_s=18.0 if chain == "AC coupled" else 12.0)
    torque = replace(torque, gain=1.01, delay_s=0.0025)
    return replace(case, encoder=encoder, torque=torque, backing=replace(case.backing, force_N=1180.0))


def judged(case: Case) -> Assessment:
    made = record(case)
    return assess(
        Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque), configured_machine(case)
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "chain",
    ["runs out once", "low pass", "mains hum", "held", *more("runs out twice", "Butterworth", "AC coupled", "stepped")],
)
def test_the_chain_is_named_with_its_value_and_no_part_of_the_machine(chain: str) -> None:
    found = judged(case_of(chain))
    named = {cause.cause: cause for cause in found.verdict}
    _, _, cause, value = CHAINS[chain]
    assert not NO_PART & set(named)
    if cause:
        sigma = named[cause].sigma
        assert named[cause].value == pytest.approx(value, abs=0.05 if math.isnan(sigma) else 3.5 * sigma)
    assert found.found is not None
    p = found.found.posterior
    for name, departure, true in (
        (FORCE, p.value(FORCE), 1180.0),
        (GAIN, gain_factor(p.value(GAIN)), 1.01),
        (DELAY, p.value(DELAY), 0.0025),
        (ZERO, p.value(ZERO), 0.0),
    ):
        # a drive that holds its reading is late by up to a log's interval
        allowed = 3.5 * p.sigma(name) + (1e-3 if name == DELAY and chain == "held" else 0.0)
        assert departure == pytest.approx(true, abs=allowed), name


@pytest.mark.slow
def test_a_slow_low_pass_at_one_speed_reads_as_no_reversed_encoder() -> None:
    case = healthy("tufting", 33, run_up=False, duration_s=12.0)
    slow = replace(case.torque, gain=1.02, delay_s=0.0014, low_pass_hz=10.4, low_pass_order=1)
    named = {each.cause: each for each in judged(replace(case, torque=slow)).verdict}
    assert not {*NO_PART, "torque_sign", "encoder_direction", "encoder_eccentricity"} & set(named)
    low_pass = named["torque_low_pass"]
    assert low_pass.value == pytest.approx(1.0 / (2.0 * math.pi * 10.4), abs=3.5 * low_pass.sigma)


def test_a_reading_beside_an_unknown_torque_is_not_settled() -> None:
    """Its interpolation and the sharpening of the grid reach three points to either side."""
    time = np.arange(0.0, 2.0, 0.002)
    grid = EvenGrid(time, 16.0)
    torque = np.sin(20.0 * grid.time_s)
    good = np.ones(grid.time_s.size, np.bool_)
    good[grid.time_s.size // 2] = False
    settled = grid.settled(torque_filter(dict.fromkeys(FILTERS, 0.0)), good)
    spoilt = np.where(good, torque, 1e3)
    sharp = spoilt.copy()
    sharp[1:-1] -= 0.2 * (spoilt[2:] - 2.0 * spoilt[1:-1] + spoilt[:-2])
    assert 0 < np.count_nonzero(~settled) < 5
    np.testing.assert_allclose(grid.at_samples(sharp)[settled], np.sin(20.0 * time)[settled], atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("torque", "cause", "value"),
    [
        (TorqueSensor(delay_s=0.0017, low_pass_hz=16.0, low_pass_order=2), "torque_low_pass", 16.0),
        *more((TorqueSensor(delay_s=0.0034, high_pass_hz=0.26), "torque_high_pass", 0.26)),
    ],
)
def test_a_loom_whose_smooth_torque_hardly_shows_the_filter(torque: TorqueSensor, cause: str, value: float) -> None:
    found = judged(healthy("loom", 925, torque=torque, duration_s=18.0))
    named = {each.cause: each for each in found.verdict}
    assert not {*NO_PART, "torque_sign", "encoder_direction", "encoder_zero"} & set(named)
    assert named[cause].value == pytest.approx(value, abs=3.5 * named[cause].sigma)
    assert found.found is not None
    p = found.found.posterior
    assert p.value(DELAY) == pytest.approx(torque.delay_s, abs=3.5 * p.sigma(DELAY))


@pytest.mark.slow
@pytest.mark.campaign
def test_a_low_pass_behind_an_amplifier_that_blocks_the_mean_keeps_its_order() -> None:
    """Without the mean a Butterworth fits first; its values lead to the low pass of the first order."""
    case = healthy("tufting", 41)
    torque = replace(case.torque, delay_s=0.0029, low_pass_hz=11.9, low_pass_order=1, high_pass_hz=0.78)
    found = judged(replace(case, torque=torque, backing=replace(case.backing, force_N=1230.0)))
    named = {each.cause: each for each in found.verdict}
    assert not {*NO_PART, "torque_gain", "force_law"} & set(named)
    true = ("torque_low_pass", 1.0 / (2.0 * math.pi * 11.9)), ("torque_high_pass", 0.78), ("load_force", 1.23)
    for cause, value in (*true, ("delay", 0.0029)):
        assert named[cause].value == pytest.approx(value, abs=3.5 * named[cause].sigma), cause
    assert named["torque_low_pass"].unit == "s"


@pytest.mark.slow
def test_a_filter_that_a_smooth_torque_hardly_tells_from_a_delay_is_said_beside_it() -> None:
    """A first order of 5 ms and 1 ms of delay, which a loom shows as 6 ms of delay."""
    torque = TorqueSensor(delay_s=0.0011, low_pass_hz=32.0, low_pass_order=1)
    named = {each.cause: each for each in judged(healthy("loom", 43, torque=torque)).verdict}
    assert not {*NO_PART, "torque_low_pass"} & set(named)
    delay = named["delay"]
    assert delay.value == pytest.approx(0.0011 + 1.0 / (64.0 * math.pi), abs=3.5 * delay.sigma)
    assert LOW_PASS in delay.equivalents


@pytest.mark.slow
@pytest.mark.campaign
def test_calibrate_writes_the_chain_into_the_machine_file() -> None:
    case = case_of("low pass")
    case = replace(case, encoder=CHAINS["runs out once"][0])
    made = record(case)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    sensors = calibrate(readings, configured_machine(case)).machine.sensors
    assert sensors.torque.low_pass_s == pytest.approx(0.01, rel=0.01)
    assert np.ravel(sensors.encoder.eccentricity_rad)[:2] == pytest.approx([0.004, -0.007], abs=3e-3)
    again = assess(readings, replace(configured_machine(case), sensors=sensors))
    assert not {"torque_low_pass", "encoder_eccentricity", "delay"} & {cause.cause for cause in again.verdict}


def test_a_healthy_torque_has_no_slower_clock_and_a_coarse_one_neither() -> None:
    rng = np.random.default_rng(3)
    time = np.arange(5000) / 500.0
    torque = 10.0 * np.sin(16.8 * time) + 0.05 * rng.standard_normal(time.size)
    assert fresh_readings(time, torque).all()
    assert fresh_readings(time, np.rint(torque / 0.5) * 0.5).all()
    held = torque[(np.arange(time.size) // 10) * 10]
    assert np.count_nonzero(fresh_readings(time, held)) == time.size // 10


def test_a_line_in_time_differs_from_a_torque_that_follows_the_shaft() -> None:
    rng = np.random.default_rng(4)
    time = np.sort(np.arange(12000) / 500.0)[rng.random(12000) > 0.02]
    theta = 16.8 * time + 0.01 * np.sin(16.8 * time)
    noise = 0.08 * rng.standard_normal(time.size)
    (line,) = time_lines(time, noise + 0.3 * np.sin(2.0 * math.pi * 50.02 * time + 0.4), theta, 16.8)
    assert line.frequency_hz == pytest.approx(50.02, abs=2e-3)
    assert line.amplitude_Nm == pytest.approx(0.3, rel=0.03)
    assert time_lines(time, noise + 0.3 * np.cos(19.0 * theta), theta, 16.8) == ()
    assert time_lines(time, noise, theta, 16.8) == ()
