"""Properties of a track of the shaft."""

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
    """Angle, speed and acceleration of a shaft that stands, starts at once and keeps its speed."""
    ramp, after = np.clip(time_s - REST_S, 0.0, RAMP_S), np.clip(time_s - REST_S - RAMP_S, 0.0, None)
    growth = np.where((time_s > REST_S) & (time_s < REST_S + RAMP_S), speed / RAMP_S, 0.0)
    return first_rad + speed * (ramp**2 / (2.0 * RAMP_S) + after), speed * ramp / RAMP_S, growth


def seen(theta: np.ndarray) -> np.ndarray:
    """Angles as read by an encoder with some noise."""
    noisy = theta + 2e-4 * np.random.default_rng(1).normal(size=theta.size)
    return np.asarray(np.mod(np.round(noisy / ENCODER_STEP) * ENCODER_STEP, 2.0 * math.pi))


@pytest.mark.parametrize("first_rad", [0.0, 1.0])
@pytest.mark.parametrize(("slower", "one"), [(1.0, True), (0.7, False)])
def test_one_speed_wherever_the_shaft_stands_still(first_rad: float, slower: float, one: bool) -> None:
    """An encoder that counts from the angle of its start shows a standstill that trembles about 0."""
    time = np.arange(0.0, 20.0, 0.002)
    theta = started(time, first_rad)[0] - (1.0 - slower) * SPEED * np.clip(time - 11.0, 0.0, None)
    track = shaft_track((time * 1e9).astype(np.int64), seen(theta), None, origin_ns=0, encoder=Encoder())
    assert track.at_one_speed == one


def test_after_a_standstill_at_zero_a_delay_is_not_taken_for_a_zero() -> None:
    machine = ttc.machines.tufting()
    twin = ttc.compile(machine, ["balancing_torque_Nm"])
    time, late_s = np.arange(0.0, 20.0, 0.002), 0.002
    torque = twin.evaluate(*started(time - late_s, 0.0))["balancing_torque_Nm"]
    stamps = (time * 1e9).astype(np.int64)
    (found,) = assess(Readings(stamps, seen(started(time, 0.0)[0]), stamps, torque), machine).verdict
    assert found.cause == "zero_or_delay" and isinstance(found.value, dict)
    assert found.value["delay_s"] == pytest.approx(late_s, rel=0.01)
