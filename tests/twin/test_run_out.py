"""Readings of an encoder that runs out: its shaft is estimated as well as by an encoder without the error."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

import textile_twin_core as ttc
from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison.shaft_track import shaft_track
from textile_twin_core.machine import Encoder, Sensors
from textile_twin_core.twin import Samples

TURN = 2.0 * math.pi
STEP_RAD = TURN / 2**13
OUT = ("balancing_torque_Nm",)
RUN_OUT = Encoder(zero_rad=0.4, direction=-1, ratio=0.5, eccentricity_rad=((0.0056, 0.0067), (0.002, -0.001)))
IDEAL = replace(RUN_OUT, eccentricity_rad=())


@cache
def _motion() -> tuple[IntArray, FloatArray, FloatArray]:
    """Stamps [ns], angle and speed of a shaft at about 160 rpm, with a ripple once a turn and a slow change."""
    time = np.arange(4000) * 0.002
    phase = 16.755 * time + 0.2 * np.sin(1.3 * time)
    rate = 16.755 + 0.26 * np.cos(1.3 * time)
    return (time * 1e9).astype(np.int64), phase + 0.02 * np.sin(phase), rate * (1.0 + 0.02 * np.cos(phase))


def _readings(encoder: Encoder) -> FloatArray:
    """Quantised readings, by the definition: q + c1 cos q + s1 sin q + c2 cos 2q + s2 sin 2q, wrapped."""
    q = _motion()[1] / (encoder.direction * encoder.ratio) + encoder.zero_rad
    angle = q.copy()
    for order, (c, s) in enumerate(encoder.eccentricity_rad, 1):
        angle += c * np.cos(order * q) + s * np.sin(order * q)
    return np.asarray(np.floor(angle % TURN / STEP_RAD) * STEP_RAD)


@cache
def _session(encoder: Encoder, readings_of: Encoder, shaft: str = "causal") -> tuple[Samples, float]:
    """Samples of a session configured with an encoder, and the step that it finds in the readings of another."""
    machine = replace(ttc.machines.tufting(), sensors=Sensors(encoder))
    session = ttc.compile(machine, OUT).session(shaft)
    parts = session.step(_motion()[0], _readings(readings_of)), session.finish()
    return max(parts, key=len), session.report.resolution_rad


def _error(samples: Samples) -> FloatArray:
    """RMS errors of angle, speed and acceleration after the first second."""
    time, theta, omega = _motion()
    alpha = np.gradient(omega, time * 1e-9)
    late = samples.index >= 500
    at = samples.index[late]
    turns = np.rint((samples.theta_rad[late] - theta[at])[0] / (0.5 * TURN)) * 0.5 * TURN
    gaps = (
        samples.theta_rad[late] - turns - theta[at],
        samples.omega_rad_s[late] - omega[at],
        samples.alpha_rad_s2[late] - alpha[at],
    )
    return np.array([np.sqrt(np.mean(gap**2)) for gap in gaps])


@pytest.mark.parametrize("shaft", ["causal", "smooth"])
def test_the_motion_is_that_of_an_ideal_encoder(shaft: str) -> None:
    corrected, step = _session(RUN_OUT, RUN_OUT, shaft)
    ideal, ideal_step = _session(IDEAL, IDEAL, shaft)
    assert step == pytest.approx(0.5 * STEP_RAD, rel=1e-3)
    assert ideal_step == pytest.approx(0.5 * STEP_RAD, rel=1e-3)
    error = _error(corrected)
    assert (error < 1.25 * _error(ideal) + 1e-9).all()
    uncorrected = _error(_session(IDEAL, RUN_OUT, shaft)[0])
    assert uncorrected[0] > 10.0 * error[0]


def test_single_samples_equal_a_block() -> None:
    machine = replace(ttc.machines.tufting(), sensors=Sensors(RUN_OUT))
    session = ttc.compile(machine, OUT).session("causal")
    stamps, readings = _motion()[0][:300], _readings(RUN_OUT)[:300]
    single = [
        each
        for stamp, angle in zip(stamps.tolist(), readings.tolist(), strict=True)
        for each in session.step_one(stamp, angle)
    ]
    block = _session(RUN_OUT, RUN_OUT)[0]
    assert_allclose([each.theta_rad for each in single], block.theta_rad[: len(single)], rtol=0.0, atol=1e-12)
    assert_allclose([each.alpha_rad_s2 for each in single], block.alpha_rad_s2[: len(single)], rtol=0.0, atol=1e-9)


def test_measured_speeds_are_corrected() -> None:
    """An encoder that measures its speed, too, reads q' (1 + e')."""
    machine = replace(ttc.machines.tufting(), sensors=Sensors(RUN_OUT))
    stamps, theta, omega = _motion()
    speeds = np.gradient(np.unwrap(RUN_OUT.measured_angle(theta)), stamps * 1e-9)
    block = ttc.compile(machine, OUT).session("causal").step(stamps, RUN_OUT.measured_angle(theta), speeds)
    late = block.index >= 500
    assert_allclose(block.omega_rad_s[late], omega[block.index[late]], atol=0.01)
    session = ttc.compile(machine, OUT).session("causal")
    for k in range(20):
        single = session.step_one(int(stamps[k]), float(RUN_OUT.measured_angle(theta[k])), float(speeds[k]))
    assert single[0].omega_rad_s == pytest.approx(block.omega_rad_s[19 - 2], abs=1e-9)


def test_a_track_of_a_recording_is_corrected() -> None:
    """The track keeps zero and direction of the encoder; with ratio 0.5 its error has orders 2 and 4 of the shaft."""
    stamps, theta, _ = _motion()
    track = shaft_track(stamps, _readings(RUN_OUT), None, origin_ns=0, encoder=RUN_OUT)
    found = -(track.theta_rad - 0.4 * 0.5)
    at = np.rint(track.time_s / 0.002).astype(np.int64)
    gap = found - theta[at]
    gap -= np.rint(gap[0] / (0.5 * TURN)) * 0.5 * TURN
    assert np.abs(gap[100:-100]).max() < STEP_RAD


def test_a_wheel_with_a_run_out_beyond_its_teeth_is_refused() -> None:
    with pytest.raises(ttc.MachineError, match="leaves the teeth of this wheel uncertain"):
        Encoder(teeth=360, eccentricity_rad=((0.01, 0.0),))
    assert Encoder(teeth=60, eccentricity_rad=((0.01, 0.0),)).is_corrected
