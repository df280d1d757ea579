"""The simulated shaft and its sensors."""

from __future__ import annotations

import math
import statistics
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from textile_twin_core.machine import Encoder, TorqueSensor
from textile_twin_ros.shaft_motion import Marks, SimulatedEncoder, SimulatedShaft, SimulatedTorqueSensor


@given(
    time=st.floats(0.01, 20.0),
    rpm=st.floats(-300.0, 300.0),
    run_up=st.sampled_from([0.0, 3.0]),
    ripple=st.floats(0.0, 0.5),
)
def test_speed_and_acceleration_are_derivatives(time: float, rpm: float, run_up: float, ripple: float) -> None:
    motion = SimulatedShaft(rpm, run_up, ripple)
    step = 1e-4
    if abs(time - run_up) < 2 * step:
        return
    before, now, after = (motion.at(time + shift)[0] for shift in (-step, 0.0, step))
    _, omega, alpha = motion.at(time)
    assert omega == pytest.approx((after - before) / (2 * step), rel=1e-4, abs=1e-3)
    assert alpha == pytest.approx((after - 2 * now + before) / step**2, rel=1e-3, abs=1.0)


def test_run_up_joins_the_steady_speed() -> None:
    motion = SimulatedShaft(160.0, 3.0, 0.02)
    assert motion.at(0.0) == (0.0, 0.0, pytest.approx(160 * math.tau / 60 / 3.0 * 1.02))
    (theta, omega, _), (theta_after, omega_after, _) = motion.at(3.0 - 1e-12), motion.at(3.0)
    assert theta == pytest.approx(theta_after, abs=1e-9) and omega == pytest.approx(omega_after, abs=1e-9)


@given(theta=st.floats(-100.0, 100.0), bits=st.integers(1, 20), direction=st.sampled_from([1, -1]))
def test_encoder_shows_the_shaft_angle_to_its_resolution(theta: float, bits: int, direction: int) -> None:
    encoder = SimulatedEncoder(bits, Encoder(zero_rad=0.3, direction=direction))
    measured = encoder.read(theta)
    assert 0.0 <= measured < math.tau
    step = math.tau / 2**bits
    assert measured / step == pytest.approx(round(measured / step), abs=1e-6)
    error = math.remainder((measured - 0.3) * direction - theta, math.tau)
    assert abs(error) <= step * (1 + 1e-6)


def test_torque_sensor_has_gain_offset_and_noise() -> None:
    late = SimulatedTorqueSensor(TorqueSensor(1.01, 0.2, 0.5), lambda time: 10.0 * time)
    assert late.read(1.5) == pytest.approx(10.3)
    noisy = SimulatedTorqueSensor(TorqueSensor(), np.ones_like, noise_Nm=0.05, seed=3)
    values = [noisy.read(0.01 * k) for k in range(4000)]
    assert statistics.mean(values) == pytest.approx(1.0, abs=0.004)
    assert statistics.stdev(values) == pytest.approx(0.05, rel=0.05)


def test_torque_sensor_filters() -> None:
    """The response of a Butterworth filter to a step, in closed form."""
    sensor = SimulatedTorqueSensor(
        TorqueSensor(2.0, 0.2, low_pass_hz=20.0, low_pass_order=2), lambda time: 3.0 * (time > 0.1)
    )
    w = math.tau * 20.0 / math.sqrt(2.0)
    for k in range(200):
        late = 0.002 * k - 0.1
        response = 1.0 - math.exp(-w * late) * (math.cos(w * late) + math.sin(w * late)) if late > 0.0 else 0.0
        assert sensor.read(0.002 * k) == pytest.approx(2.0 * 3.0 * response + 0.2, abs=6.0 * 1.5e-3)


def test_encoder_runs_out() -> None:
    encoder = Encoder(zero_rad=0.3, direction=-1, ratio=0.5, eccentricity_rad=((0.01, -0.02),))
    for theta in (0.0, 1.0, -40.0):
        q = -2.0 * theta + 0.3
        expected = q + 0.01 * math.cos(q) - 0.02 * math.sin(q)
        assert SimulatedEncoder(0, encoder).turned(theta) == pytest.approx(expected, abs=1e-13)


@pytest.mark.parametrize("rpm", [240.0, 160.0, 97.3])
def test_every_mark_passes_once_a_turn(rpm: float) -> None:
    # At 240 rpm a turn is 125 samples: those at 0.625 s, 0.75 s and so on stand where tooth 0 does.
    teeth, rate_hz, run_up_s = 36, 500, 0.5
    marks = Marks([k * math.tau / teeth for k in range(teeth - 1)], SimulatedShaft(rpm, run_up_s), SimulatedEncoder(0))
    samples = [number / rate_hz for number in range(rate_hz // 2 + 1, 20 * rate_hz)]
    passed = [time for begin, end in pairwise(samples) for time in marks.passed(begin, end)]
    pitch_s = 60.0 / rpm / teeth
    edges = [(k, 0.5 * run_up_s + k * pitch_s) for k in range(int(20.0 / pitch_s)) if k % teeth != teeth - 1]
    expected = [time for _, time in edges if samples[0] < time <= samples[-1]]
    assert passed == pytest.approx(expected, abs=1e-9)
