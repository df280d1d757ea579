"""The synthetic recording: energy of the simulated machine, sensor errors, the recording in bags/."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from tests.generators.tufting_bag import ANGLE_TOPIC, START_NS, TORQUE_TOPIC, Recording, record, write_bag
from tests.generators.tufting_rig import STEPS_PER_SECOND, Rig, Run, run, tabulated_linkage, tufting_multibody

BAG = Path(__file__).parents[2] / "bags" / "tufting_160rpm_synthetic"
SHORT = Recording(duration_s=2.5, rig=Rig(brake_s=0.3, ramp_s=0.8))


@pytest.fixture(scope="module")
def start_up() -> Run:
    """Simulate the first six seconds behind the recording in bags/."""
    return run(Rig(), 6.0)


def linkage_at(theta: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Evaluate inertia, half its slope, gravity torque, needle below C and its slope, one row each."""
    linkage = tabulated_linkage()
    return np.array([linkage.at(angle) for angle in theta.tolist()]).T


def messages(path: Path) -> dict[str, tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]]:
    """Read stamps [ns since the start] and values of both topics."""
    rows: dict[str, list[tuple[int, float]]] = {ANGLE_TOPIC: [], TORQUE_TOPIC: []}
    with AnyReader([path]) as bag:
        for connection, _, raw in bag.messages():
            message: Any = bag.deserialize(raw, connection.msgtype)
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec - START_NS
            is_angle = connection.topic == ANGLE_TOPIC
            rows[connection.topic].append((stamp, message.position[0] if is_angle else message.wrench.torque.z))
    return {topic: (np.array([r[0] for r in row]), np.array([r[1] for r in row])) for topic, row in rows.items()}


def test_work_of_the_shaft_is_stored_or_lost(start_up: Run) -> None:
    """Work of the shaft on the crank equals stored energy plus losses in bearings and backing."""
    rig, theta, omega = Rig(), start_up.theta_rad, start_up.omega_rad_s
    inertia, _, _, below, slope = linkage_at(theta)
    masses = np.array([body.mass_kg for body in tufting_multibody().bodies])
    turn = 2.0 * math.pi * np.arange(4097) / 4096
    heights = 9.81 * (tufting_multibody().turn(turn).q[:, 1::3] @ masses)
    stored = 0.5 * inertia * omega**2 + np.interp(theta % (2.0 * math.pi), turn, heights)
    bearing = rig.bearing_viscous_Nms * omega + rig.bearing_coulomb_Nm * np.tanh(omega / rig.bearing_creep_rad_s)
    force = rig.backing_force_N * np.clip(0.5 + (below - rig.backing_plane_m) / rig.needle_spread_m, 0.0, 1.0)
    backing = slope * force * np.tanh(slope * omega / rig.backing_creep_m_s)
    power = (start_up.shaft_torque_Nm - bearing - backing) * omega
    put_in = np.cumsum(0.5 * (power[1:] + power[:-1])) / STEPS_PER_SECOND
    balance = stored[1:] - stored[0] - put_in
    work = np.sum(np.abs(start_up.shaft_torque_Nm * omega)) / STEPS_PER_SECOND
    assert work > 200.0
    assert np.abs(balance).max() < 1e-4 * work


def test_machine_runs_up_and_ripples(start_up: Run) -> None:
    at_rest = start_up.time_s < Rig().brake_s
    assert np.all(start_up.omega_rad_s[at_rest] == 0.0)
    rpm = start_up.omega_rad_s[start_up.time_s > 5.0] * 30.0 / math.pi
    smooth = np.convolve(rpm, np.full(160, 1.0 / 160.0), mode="valid")
    assert smooth.mean() == pytest.approx(160.0, abs=0.8)
    assert 0.02 < np.ptp(smooth) / 160.0 < 0.05


def test_sensors_do_what_the_metadata_says() -> None:
    """Delay, gain, noise, stamps and losses are recovered from samples and truth."""
    sensors = SHORT.sensors
    angles, torques, truth = record(SHORT)
    for samples, phase in ((angles, 0.0), (torques, sensors.torque_phase_s)):
        grid = np.rint((1e-9 * (samples.stamps_ns - START_NS) - phase) * sensors.rate_hz) / sensors.rate_hz + phase
        error = 1e-9 * (samples.stamps_ns - START_NS) - grid
        assert error.std() == pytest.approx(sensors.stamp_error_s, rel=0.1)
        assert 0.0 < 1.0 - samples.values.size / (SHORT.duration_s * sensors.rate_hz) < 0.03
        assert np.all(np.diff(samples.stamps_ns) > 0)
        assert np.all(np.diff(samples.arrivals_ns) >= 0)
        if samples is angles:
            true = np.interp(grid, truth.time_s, truth.theta_rad)
            gap = (samples.values - true + math.pi) % (2.0 * math.pi) - math.pi
            assert np.abs(gap).max() <= 1.001 * math.pi / 2**sensors.encoder_bits
        else:
            true = np.interp(grid - sensors.torque_delay_s, truth.time_s, truth.shaft_torque_Nm)
            gain, offset = np.polyfit(true, samples.values, 1)
            assert gain == pytest.approx(sensors.torque_gain, abs=1e-3)
            assert offset == pytest.approx(sensors.torque_offset_Nm, abs=0.01)
            assert (samples.values - gain * true - offset).std() == pytest.approx(sensors.torque_noise_Nm, rel=0.1)


def test_same_seed_same_bytes(tmp_path: Path) -> None:
    first, second = tmp_path / "one" / "short", tmp_path / "two" / "short"
    write_bag(first, SHORT)
    write_bag(second, SHORT)
    for name in ("metadata.yaml", "short.mcap"):
        assert (first / name).read_bytes() == (second / name).read_bytes()


def test_recording_in_bags_is_what_the_generator_makes(start_up: Run) -> None:
    """The file is small, at least 45 s long, and starts with the simulated machine to one encoder step."""
    assert sum(file.stat().st_size for file in BAG.iterdir()) < 2_000_000
    with AnyReader([BAG]) as bag:
        assert bag.duration > 45e9
        assert {c.topic: c.msgtype for c in bag.connections} == {
            ANGLE_TOPIC: "sensor_msgs/msg/JointState",
            TORQUE_TOPIC: "geometry_msgs/msg/WrenchStamped",
        }
        assert bag.message_count > 2 * 0.97 * 500 * 45
    stamps, angles = messages(BAG)[ANGLE_TOPIC]
    early = stamps < 5.9e9
    ticks = np.rint(stamps[early] * 1e-9 * 500.0).astype(int) * (STEPS_PER_SECOND // 500)
    gap = (angles[early] - start_up.theta_rad[ticks] + math.pi) % (2.0 * math.pi) - math.pi
    assert np.abs(gap).max() < 2.0 * math.pi / 2**16


def test_recording_is_close_to_the_linkage_but_not_the_linkage(start_up: Run) -> None:
    """A twin of the linkage alone misses the measured torque by one to four percent of the peak."""
    stamps, torque = messages(BAG)[TORQUE_TOPIC]
    part = (stamps > 4.2e9) & (stamps < 5.9e9)
    time = 1e-9 * stamps[part] - 0.002
    window = np.hanning(161) / np.hanning(161).sum()
    omega = np.convolve(start_up.omega_rad_s, window, mode="same")
    alpha = np.gradient(omega, start_up.time_s)
    theta, omega, alpha = (np.interp(time, start_up.time_s, x) for x in (start_up.theta_rad, omega, alpha))
    inertia, half_slope, gravity, below, slope = linkage_at(theta)
    linkage = inertia * alpha + half_slope * omega**2 + gravity + np.where(below > 0.55784, 1000.0 * np.abs(slope), 0)
    measured = torque[part]
    rms = np.sqrt(np.mean((measured - linkage) ** 2)) / np.abs(measured).max()
    assert 0.01 < rms < 0.04
    assert np.corrcoef(measured, linkage)[0, 1] > 0.99
