"""Faults that set in while the machine runs: found, named by their evidence, and nothing said of a healthy machine."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.generators.faults import EXPECTED, SIZES, faulty
from tests.generators.told_machine import told_machine
from textile_twin_core.comparison.fault_watch import WatchSettings
from textile_twin_core.comparison.monitor import Monitor, Trend, monitor_recording
from textile_twin_core.comparison.readings import Readings
from textile_twin_core.machines import tufting

_SETTINGS = WatchSettings(learn_turns=60)


def watched(kind: str, size: float, seed: int) -> tuple[Trend, int]:
    made = faulty(kind, size, seed, duration_s=38.0, onset_s=28.0, rate=250.0)
    r = made.recording
    readings = Readings(r.angle_stamps_ns, r.angle, r.torque_stamps_ns, r.torque)
    onset = int(r.torque_stamps_ns[0] + made.onset_s * 1e9)
    return monitor_recording(readings, told_machine(made.case), _SETTINGS), onset


@pytest.mark.parametrize("kind", ["needle_force", "friction", "sensor_gain", "encoder_slip", "bearing_bump", "stuck"])
def test_a_fault_is_found_and_named(kind: str) -> None:
    trend, onset = watched(kind, SIZES[kind][-1], 981)
    assert [alarm.kind for alarm in trend.alarms] == [EXPECTED[kind]]
    turn_ns = 2.0 * np.pi / 16.755 * 1e9
    assert 0.0 <= (trend.alarms[0].stamp_ns - onset) / turn_ns < 20.0


def test_nothing_is_said_of_a_healthy_machine() -> None:
    trend, _ = watched("", 0.0, 982)
    assert trend.alarms == ()
    assert len(trend.columns["turn"]) > 95


@pytest.mark.parametrize("encoder", ["as the machine", "against it", "against it, geared 1:2"])
def test_live_in_small_blocks_finds_the_same_fault(encoder: str) -> None:
    made = faulty("needle_force", 0.2, 983, duration_s=38.0, onset_s=28.0, rate=250.0)
    r, machine = made.recording, told_machine(made.case)
    if encoder != "as the machine":
        factor = -2.0 if "geared" in encoder else -1.0
        old, sensors = machine.sensors.encoder, machine.sensors
        assert old.direction == 1 and old.ratio == 1.0
        told = replace(old, direction=-1, ratio=-1.0 / factor, zero_rad=factor * old.zero_rad)
        machine = replace(machine, sensors=replace(sensors, encoder=told))
        r = replace(r, angle=factor * np.unwrap(r.angle))
    monitor = Monitor(machine, _SETTINGS)
    alarms = []
    edges = np.arange(r.angle_stamps_ns[0], r.angle_stamps_ns[-1], 500_000_000)
    for begin, end in pairwise(edges.tolist()):
        angle = (r.angle_stamps_ns >= begin) & (r.angle_stamps_ns < end)
        torque = (r.torque_stamps_ns >= begin) & (r.torque_stamps_ns < end)
        monitor.add_angles(r.angle_stamps_ns[angle], r.angle[angle])
        monitor.add_torques(r.torque_stamps_ns[torque], r.torque[torque])
        alarms += monitor.advance().alarms
    assert [alarm.kind for alarm in alarms] == ["load_force"]
    assert monitor.turns > 90
    assert monitor.watch.active == ("load_force",)


def test_a_shaft_that_turns_backwards_is_watched_in_the_order_of_time() -> None:
    made = faulty("", 0.0, 984, duration_s=20.0, onset_s=19.0, rate=250.0)
    r, machine = made.recording, told_machine(made.case)
    backwards = Readings(r.angle_stamps_ns, -r.angle, r.torque_stamps_ns, r.torque)
    for live in (False, True):
        monitor = Monitor(machine, _SETTINGS)
        monitor.add_torques(backwards.torque_stamps_ns, backwards.torque)
        monitor.add_angles(backwards.angle_stamps_ns, backwards.angle)
        columns = (monitor.advance() if live else monitor.finish()).columns
        assert len(columns["turn"]) > 45
        assert set(np.diff(columns["turn"])) == {-1}
        assert np.all(np.diff(columns["stamp_ns"]) > 0.3e9)
        assert np.all(columns["speed_rad_s"] < 0.0)


def test_a_shaft_that_stands_or_a_silent_sensor_fills_no_memory() -> None:
    """Three minutes at 50 Hz; what no turn ends is held for one."""
    stamps = 1_700_000_000_000_000_000 + np.arange(180 * 50) * 20_000_000
    for angle, torque in ((True, True), (True, False), (False, True)):
        monitor = Monitor(tufting())
        for second in np.split(stamps, 180):
            if angle:
                monitor.add_angles(second, np.full(50, 0.7))
            if torque:
                monitor.add_torques(second, np.full(50, 3.0))
            monitor.advance()
        states, torques = sum(map(len, monitor._states)), sum(len(piece) for piece, _ in monitor._torque)
        assert angle * 55 * 50 <= states <= 60 * 50 + 1
        assert torque * 55 * 50 <= torques <= 60 * 50 + 1


def test_time_set_back_is_watched_on() -> None:
    """The healthy part is learnt; then the clock goes back, and the needles' force has changed."""
    monitor = Monitor(told_machine(faulty("", 0.0, 983, duration_s=1.0, onset_s=0.5, rate=250.0).case), _SETTINGS)
    alarms = []
    for kind, size in (("", 0.0), ("needle_force", 0.2)):
        made = faulty(kind, size, 983, duration_s=30.0, onset_s=1.0, rate=250.0).recording
        back = 0 if not kind else 3600 * 10**9
        monitor.restart()
        monitor.add_angles(made.angle_stamps_ns - back, made.angle)
        monitor.add_torques(made.torque_stamps_ns - back, made.torque)
        alarms += monitor.advance().alarms
        assert monitor.report.accepted == len(made.angle)
    assert [alarm.kind for alarm in alarms] == ["load_force"]


@pytest.mark.parametrize("wrong_Nm", [1e4, 1e12])
def test_one_wrong_value_among_those_learnt_from_hides_no_fault(wrong_Nm: float) -> None:
    made = faulty("friction", SIZES["friction"][-1], 981, duration_s=38.0, onset_s=28.0, rate=250.0)
    r = made.recording
    torque = r.torque.copy()
    torque[len(torque) // 4] = wrong_Nm
    readings = Readings(r.angle_stamps_ns, r.angle, r.torque_stamps_ns, torque)
    trend = monitor_recording(readings, told_machine(made.case), _SETTINGS)
    assert [alarm.kind for alarm in trend.alarms] == ["constant_torque"]
