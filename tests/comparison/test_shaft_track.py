"""What a track of the shaft tells of itself."""

from __future__ import annotations

import math

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.comparison import Readings, assess
from textile_twin_core.comparison.shaft_track import shaft_track
from textile_twin_core.machine.sensors import Encoder

SPEED = 16.0
REST_S, RAMP_S = 2.0, 0.15
ENCODER_STEP = 2.0 * math.pi / 8192


def started(time_s: np.ndarray, first_rad: float, speed: float = SPEED) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angle, speed and acceleration of a shaft that rests, starts at once and keeps its speed."""
    ramp, after = np.clip(time_s - REST_S, 0.0, RAMP_S), np.clip(time_s - REST_S - RAMP_S, 0.0, None)
    growth = np.where((time_s > REST_S) & (time_s < REST_S + RAMP_S), speed / RAMP_S, 0.0)
    return first_rad + speed * (ramp**2 / (2.0 * RAMP_S) + after), speed * ramp / RAMP_S, growth


def seen(theta: np.ndarray) -> np.ndarray:
    """What an encoder with some noise shows of angles."""
    noisy = theta + 2e-4 * np.random.default_rng(1).normal(size=theta.size)
    return np.asarray(np.mod(np.round(noisy / ENCODER_STEP) * ENCODER_STEP, 2.0 * math.pi))


@pytest.mark.parametrize("first_rad", [0.0, 1.0])
@pytest.mark.parametrize(("slower", "one"), [(1.0, True), (0.7, False)])
def test_one_speed_wherever_the_shaft_rests(first_rad: float, slower: float, one: bool) -> None:
    """An encoder that counts from where it is switched on shows an angle at rest that trembles about 0."""
    time = np.arange(0.0, 20.0, 0.002)
    theta = started(time, first_rad)[0] - (1.0 - slower) * SPEED * np.clip(time - 11.0, 0.0, None)
    track = shaft_track((time * 1e9).astype(np.int64), seen(theta), None, origin_ns=0, encoder=Encoder())
    assert track.at_one_speed == one


def test_after_a_rest_where_the_encoder_begins_a_delay_is_no_zero_that_is_known() -> None:
    machine = ttc.machines.tufting()
    twin = ttc.compile(machine, ["balancing_torque_Nm"])
    time, late_s = np.arange(0.0, 20.0, 0.002), 0.002
    torque = twin.evaluate(*started(time - late_s, 0.0))["balancing_torque_Nm"]
    stamps = (time * 1e9).astype(np.int64)
    (found,) = assess(Readings(stamps, seen(started(time, 0.0)[0]), stamps, torque), machine).verdict
    assert found.cause == "zero_or_delay" and isinstance(found.value, dict)
    assert found.value["delay_s"] == pytest.approx(late_s, rel=0.01)


@pytest.mark.parametrize("run_up_s", [3.0, 5.0, 12.0])
@pytest.mark.parametrize("record_s", [24.0, 120.0])
def test_a_short_run_up_after_standstill_is_another_speed(run_up_s: float, record_s: float) -> None:
    time = np.arange(0.0, record_s, 0.002)
    ramp, after = np.clip(time - REST_S, 0.0, run_up_s), np.clip(time - REST_S - run_up_s, 0.0, None)
    theta = SPEED * (ramp**2 / (2.0 * run_up_s) + after)
    track = shaft_track((time * 1e9).astype(np.int64), seen(theta), None, origin_ns=0, encoder=Encoder())
    assert not track.at_one_speed


def test_a_speed_that_wanders_by_a_hundredth_is_one_speed() -> None:
    time = np.arange(0.0, 120.0, 0.002)
    wander = np.random.default_rng(5).normal(size=41)
    omega = SPEED * (1.0 + 0.01 * np.interp(time, 3.0 * np.arange(41), wander))
    theta = np.cumsum(omega) * 0.002
    track = shaft_track((time * 1e9).astype(np.int64), seen(theta), None, origin_ns=0, encoder=Encoder())
    assert track.at_one_speed
