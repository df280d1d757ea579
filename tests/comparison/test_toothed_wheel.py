"""Machine with a toothed wheel as encoder: verdict and monitor use the wheel of the machine file."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.generators.configured_machine import configured_machine
from tests.generators.mill_recordings import START_NS, healthy, torque_of
from tests.generators.planned_motion import steady
from textile_twin_core.comparison import Readings, assess
from textile_twin_core.comparison.fault_watch import WatchSettings
from textile_twin_core.comparison.monitor import Monitor
from textile_twin_core.machine import Machine
from textile_twin_core.machine.sensors import Encoder, Sensors

TEETH, MISSING, SECONDS, NOISE_NM = 60, 2, 12.0, 0.08
CASE = healthy("tufting", 961, run_up=False, duration_s=SECONDS)
PITCH = np.concatenate([0.002 * np.random.default_rng(3).standard_normal(TEETH - MISSING), np.zeros(MISSING)])


@pytest.fixture(scope="module")
def readings() -> Readings:
    """Stamps of a wheel's edges, each displaced by its pitch error, and the torque at 500 Hz."""
    rng = np.random.default_rng(961)
    plan = steady(SECONDS, 16.755, rng)
    time = np.linspace(0.0, SECONDS, 200_000)
    theta = plan.at(time)[0]
    step = 2.0 * math.pi / TEETH
    number = np.arange(math.ceil(theta[0] / step) + 1, math.floor(theta[-1] / step) - 1)
    number = number[np.mod(number, TEETH) < TEETH - MISSING]
    edge = number * step + PITCH[np.mod(number, TEETH)]
    at = np.interp(edge, theta, time)
    for _ in range(3):
        angle, omega, _ = plan.at(at)
        at -= (angle - edge) / omega
    stamps = np.rint((at + 5e-6 * rng.standard_normal(at.size)) * 1e9).astype(np.int64) + START_NS
    time = np.arange(0.05, SECONDS - 0.05, 1.0 / 500.0)
    torque = torque_of(CASE, *plan.at(time)) + NOISE_NM * rng.standard_normal(time.size)
    return Readings(stamps, number * step, np.rint(time * 1e9).astype(np.int64) + START_NS, torque)


def machine(pitch: tuple[float, ...] | None) -> Machine:
    configured = configured_machine(CASE)
    encoder = Encoder(teeth=TEETH, missing_teeth=MISSING, pitch_errors_rad=pitch)
    return replace(configured, sensors=Sensors(encoder, configured.sensors.torque))


@pytest.mark.slow
def test_a_healthy_machine_has_no_fault(readings: Readings) -> None:
    configured, unknown = (assess(readings, machine(pitch)) for pitch in (tuple(PITCH.tolist()), None))
    assert configured.verdict == () and configured.explained > 0.9997
    # Errors missing in the file are learnt, also those of the ripple's orders.
    assert unknown.verdict == () and unknown.explained > 0.9997
    assert not any("pitch errors" in note for note in (*configured.notes, *unknown.notes))


def test_the_monitor_sees_the_noise_of_the_torque_alone(readings: Readings) -> None:
    """The wheel's errors may be missing in the file: as ripple they enlarged the noise by half and more."""
    noise = []
    for pitch in (tuple(PITCH.tolist()), None):
        monitor = Monitor(machine(pitch), WatchSettings(learn_turns=20))
        monitor.add_torques(readings.torque_stamps_ns, readings.torque)
        monitor.add_angles(readings.angle_stamps_ns, readings.angle)
        trend = monitor.finish()
        assert trend.alarms == ()
        noise.append(float(np.median(trend.columns["noise_Nm"])))
    assert noise == pytest.approx([NOISE_NM, NOISE_NM], rel=0.05)
