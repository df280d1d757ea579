"""Predictions from estimated states: no friction at standstill, full friction in the slowest motion of known sense."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison import compare_torque
from textile_twin_core.machine import Encoder, Sensors
from textile_twin_core.twin import Samples, Twin

TORQUE, LOAD = "balancing_torque_Nm", "torque_load_Nm"
STEP_RAD = 2.0 * math.pi / 2**14
PERIOD_S = 0.002
SPEED = 16.755  # [rad/s], 160 rpm
START_S, STOP_S, RAMP_S, END_S = 1.0, 4.0, 1.0, 7.0
UNSEEN_S = 0.08  # a start or a stop moves the encoder by one or two steps within this time
VIEWS = ("causal", "lag", "smooth")
Motion = tuple[FloatArray, FloatArray, FloatArray]


def between_standstills(stop_rad: float) -> tuple[FloatArray, Motion]:
    """Return times [s] and the motion in closed form: standstill, run-up, constant speed, coast-down, standstill
    at an angle.
    """
    time = np.arange(0.0, END_S, PERIOD_S)
    theta, omega, alpha = np.zeros((3, time.size))
    for begin, way in ((START_S, 1.0), (STOP_S, -1.0)):
        u = np.clip((time - begin) / RAMP_S, 0.0, 1.0)
        past = np.maximum(time - begin - RAMP_S, 0.0)
        theta += way * SPEED * (RAMP_S * (u**3 - 0.5 * u**4) + past)
        omega += way * SPEED * u * u * (3.0 - 2.0 * u)
        alpha += way * SPEED / RAMP_S * 6.0 * u * (1.0 - u)
    moved = (time > START_S) & (time < STOP_S + RAMP_S)
    omega[~moved] = alpha[~moved] = 0.0
    return time, (theta - theta[-1] + stop_rad, omega, alpha)


def stamps_of(time: FloatArray) -> np.ndarray:
    return np.asarray(1_700_000_000_000_000_000 + np.rint(time * 1e9), np.int64)


def predicted(twin: Twin, shaft: str, time: FloatArray, theta: FloatArray) -> Samples:
    """Return all predictions for a record of a 14-bit encoder."""
    session = twin.session(shaft)
    stamps, angles = stamps_of(time), np.mod(np.floor(theta / STEP_RAD) * STEP_RAD, 2.0 * math.pi)
    parts = [part for part in (session.step(stamps, angles), session.finish()) if len(part)]
    states = type(parts[0].states).join([part.states for part in parts])
    outputs = {name: np.concatenate([part[name] for part in parts]) for name in twin.outputs}
    return Samples(states, outputs, None)


@pytest.fixture(scope="module")
def twin() -> Twin:
    return ttc.compile(ttc.machines.tufting(), [TORQUE, LOAD, "needle_velocity_m_s"], method="exact")


@pytest.mark.parametrize("shaft", VIEWS)
@pytest.mark.parametrize("stop_rad", [0.7, 1.5, 2.5, 3.2])
def test_a_needle_that_stops_in_the_backing_has_no_friction(twin: Twin, shaft: str, stop_rad: float) -> None:
    time, motion = between_standstills(stop_rad)
    truth = twin.evaluate(*motion)[TORQUE]
    assert abs(twin.evaluate(stop_rad, 1e-7, 0.0)[LOAD]) > 1.0  # the needle stops in the backing
    found = predicted(twin, shaft, time, motion[0])
    error = found[TORQUE] - truth[found.index]
    moment = time[found.index]
    rests = (moment < START_S - UNSEEN_S) | (moment > STOP_S + RAMP_S + UNSEEN_S)
    assert np.abs(found[LOAD][rests]).max() < 1e-6
    assert np.abs(error[rests & found.settled]).max() < 1.0  # inertia, while the estimate still converges
    measured = truth + 0.05 * np.random.default_rng(3).standard_normal(truth.size)
    stamps = stamps_of(time)
    compared = compare_torque(
        stamps, measured, stamps[found.index], found[TORQUE], found.theta_rad,
        events=twin.machine.events(), settled=found.settled,
    )  # fmt: skip
    # The remaining error: a start is not visible until the encoder has moved by more than its steps.
    assert compared.errors.rms_error_Nm < 2.0
    assert compared.errors.correlation > 0.95


@pytest.mark.parametrize("shaft", VIEWS)
@pytest.mark.parametrize("speed", [0.05, -0.05])
def test_creeping_keeps_its_friction(twin: Twin, shaft: str, speed: float) -> None:
    time = np.arange(0.0, 4.0, PERIOD_S)
    theta = 2.5 + speed * time
    found = predicted(twin, shaft, time, theta)
    truth = twin.evaluate(theta, np.full_like(theta, speed), np.zeros_like(theta))[LOAD][found.index]
    later = time[found.index] > 0.5
    assert np.abs(truth).min() > 5.0
    assert np.abs(found[LOAD] - truth)[later].max() < 0.02


@pytest.mark.parametrize("shaft", VIEWS)
def test_a_reversal_turns_the_friction_round(twin: Twin, shaft: str) -> None:
    time = np.arange(0.0, 4.0, PERIOD_S)
    theta, omega = 2.5 - 0.4 * np.cos(0.5 * math.pi * time), 0.2 * math.pi * np.sin(0.5 * math.pi * time)
    found = predicted(twin, shaft, time, theta)
    true_speed = omega[found.index]
    known = (np.abs(true_speed) > 0.06) & (time[found.index] > 0.5)
    force = found[LOAD] * np.sign(true_speed)
    there = np.abs(twin.evaluate(theta, omega, np.zeros_like(theta))[LOAD][found.index])
    assert np.abs(force - there)[known & (there > 1.0)].max() < 0.1
    sides = known & (there > 1.0)
    assert (true_speed[sides] > 0.0).any() and (true_speed[sides] < 0.0).any()


def test_samples_one_by_one_are_those_of_a_block_around_rests(twin: Twin) -> None:
    sensors = Sensors(encoder=Encoder(resolution_rad=STEP_RAD))
    twin = ttc.compile(replace(twin.machine, sensors=sensors), twin.outputs, method="exact")
    time, motion = between_standstills(2.5)
    angles = np.floor(motion[0] / STEP_RAD) * STEP_RAD
    block = twin.session().step(stamps_of(time), angles)
    session, one_by_one = twin.session(), []
    for stamp, angle in zip(stamps_of(time).tolist(), angles.tolist(), strict=True):
        one_by_one += session.step_one(stamp, angle)
    assert len(one_by_one) == len(block)
    for name in twin.outputs:
        live = np.array([sample.outputs[name] for sample in one_by_one])
        assert np.abs(live - block[name]).max() < 1e-9


@pytest.mark.parametrize("shaft", VIEWS)
def test_only_friction_waits_for_the_sense(twin: Twin, shaft: str) -> None:
    """Check that velocity, inertia and damping follow the estimate even where its sign is uncertain."""
    time, motion = between_standstills(0.7)
    found = predicted(twin, shaft, time, motion[0])
    plain = twin.evaluate(found.states.phase_rad, found.omega_rad_s, found.alpha_rad_s2)
    apart = np.abs(found["needle_velocity_m_s"] - plain["needle_velocity_m_s"])
    assert apart.max() < 1e-12
    less = (found[TORQUE] - found[LOAD]) - (plain[TORQUE] - plain[LOAD])
    assert np.abs(less).max() < 1e-9
