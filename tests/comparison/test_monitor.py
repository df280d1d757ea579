"""Faults that begin while the machine runs: detected and named by their evidence; no alarm of a healthy machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.generators import mill_recordings
from tests.generators.configured_machine import configured_machine
from tests.generators.faults import EXPECTED, SIZES, faulty, with_fault
from tests.generators.mill_recordings import SPEED, MillRecording, healthy, record, torque_of
from tests.generators.planned_motion import Plan
from tests.generators.shaft_law import Friction
from textile_twin_core.comparison.fault_watch import WatchSettings
from textile_twin_core.comparison.monitor import Monitor, Trend, monitor_recording
from textile_twin_core.comparison.readings import Readings
from textile_twin_core.machines import tufting
from textile_twin_core.twin import compile_machine

_SETTINGS = WatchSettings(learn_turns=60)


def watched(kind: str, size: float, seed: int) -> tuple[Trend, int]:
    made = faulty(kind, size, seed, duration_s=38.0, onset_s=28.0, rate=250.0)
    onset = int(made.recording.torque_stamps_ns[0] + made.onset_s * 1e9)
    return monitor_recording(readings_of(made.recording), configured_machine(made.case), _SETTINGS), onset


def readings_of(r: MillRecording) -> Readings:
    return Readings(r.angle_stamps_ns, r.angle, r.torque_stamps_ns, r.torque)


def in_blocks(monitor: Monitor, r: MillRecording, block_s: float) -> Iterator[tuple[float, Trend]]:
    """Play a recording live: yield the time since its begin, and the trend of the turns watched by then."""
    edges = np.arange(r.angle_stamps_ns[0], r.angle_stamps_ns[-1], round(block_s * 1e9)).tolist()
    for number, (begin, end) in enumerate(pairwise(edges), 1):
        angle = (r.angle_stamps_ns >= begin) & (r.angle_stamps_ns < end)
        torque = (r.torque_stamps_ns >= begin) & (r.torque_stamps_ns < end)
        monitor.add_angles(r.angle_stamps_ns[angle], r.angle[angle])
        monitor.add_torques(r.torque_stamps_ns[torque], r.torque[torque])
        yield number * block_s, monitor.advance()


@pytest.mark.parametrize("kind", ["needle_force", "friction", "sensor_gain", "encoder_slip", "bearing_bump", "stuck"])
def test_a_fault_is_found_and_named(kind: str) -> None:
    trend, onset = watched(kind, SIZES[kind][-1], 981)
    assert [alarm.kind for alarm in trend.alarms] == [EXPECTED[kind]]
    turn_ns = 2.0 * np.pi / 16.755 * 1e9
    assert 0.0 <= (trend.alarms[0].stamp_ns - onset) / turn_ns < 20.0


@pytest.mark.parametrize("shape", ["dies away in the middle", "begins in the middle"])
def test_a_growing_force_of_another_shape_than_the_files_is_one_of_the_loads(shape: str) -> None:
    """The change takes only that part of the turn in which the loads act; a gain or a bearing would show outside."""
    made = faulty("", 0.0, 981, duration_s=50.0, onset_s=28.0, rate=250.0)
    r, case = made.recording, made.case
    time = (r.torque_stamps_ns - r.torque_stamps_ns[0]) * 1e-9 + 0.0507
    states = r.plan.at(np.clip(time, 0.0, case.duration_s))
    bare = torque_of(replace(case, backing=replace(case.backing, force_N=0.0)), *states)
    middle = np.exp(-0.5 * ((np.mod(states[0] - 1.9 + np.pi, 2.0 * np.pi) - np.pi) / 0.8) ** 2)
    changed = middle if shape == "begins in the middle" else 1.0 - middle
    grown = r.torque + (torque_of(case, *states) - bare) * changed * 0.8 * np.clip((time - 28.0) / 25.0, 0.0, 1.0)
    alarms = monitor_recording(readings_of(replace(r, torque=grown)), configured_machine(case), _SETTINGS).alarms
    assert {alarm.kind for alarm in alarms} == {"load_force"} and len(alarms) <= 3
    assert all(one.size * 1.9 < other.size for one, other in pairwise(alarms))


@pytest.mark.parametrize(("kind", "size", "largest_Nm"), [("sensor_gain", 0.12, 17.0), ("needle_force", 0.2, 12.0)])
@pytest.mark.parametrize("live", [False, True])
def test_a_fault_of_a_torque_that_is_cut_off_is_named_with_its_size(
    kind: str, size: float, largest_Nm: float, live: bool
) -> None:
    made = faulty(kind, size, 981, duration_s=38.0, onset_s=28.0, rate=500.0)
    r = replace(made.recording, torque=np.minimum(made.recording.torque, largest_Nm))
    monitor = Monitor(configured_machine(made.case), _SETTINGS)
    found = [each for _, each in in_blocks(monitor, r, 1.0)] if live else []
    found = found or [monitor_recording(readings_of(r), configured_machine(made.case), _SETTINGS)]
    alarms = [alarm for trend in found for alarm in trend.alarms]
    assert [(alarm.kind, alarm.size) for alarm in alarms] == [(EXPECTED[kind], pytest.approx(size, rel=0.03))]
    assert f" {largest_Nm:g} N m" in found[-1].notes[0]


@pytest.mark.parametrize("end", [np.min, np.max])
def test_a_sensor_that_stands_still_at_its_largest_or_smallest_torque_stands_still(end: Callable[..., float]) -> None:
    made = faulty("", 0.0, 981, duration_s=38.0, rate=500.0)
    r = made.recording
    since = (r.torque_stamps_ns - r.torque_stamps_ns[0]) * 1e-9 > 28.0
    r = replace(r, torque=np.where(since, end(r.torque), r.torque))
    trend = monitor_recording(readings_of(r), configured_machine(made.case), _SETTINGS)
    assert [alarm.kind for alarm in trend.alarms] == ["stuck"]


def onset_turns(trend: Trend, recording: MillRecording, *onsets_s: float) -> list[float]:
    """Number of turns from each onset until its alarm."""
    since = np.array([alarm.stamp_ns - recording.torque_stamps_ns[0] for alarm in trend.alarms]) * 1e-9
    return [float(away) for away in (since - np.array(onsets_s)) * SPEED["tufting"] / (2.0 * np.pi)]


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (("friction", 0.6), ("sensor_gain", 0.12)),
        (("friction", 0.6), ("sensor_offset", -1.8)),
        (("sensor_gain", 0.12), ("stuck", 1.0)),
        (("encoder_slip", 0.03), ("needle_force", 0.2)),
        (("noise", 2.0), ("friction", 1.2)),
    ],
)
def test_a_fault_beside_a_standing_one_is_reported_too(first: tuple[str, float], second: tuple[str, float]) -> None:
    made = faulty(*first, 985, duration_s=62.0, onset_s=28.0, rate=250.0)
    both = with_fault(made.recording, made.case, *second, 48.0)
    trend = monitor_recording(readings_of(both), configured_machine(made.case), _SETTINGS)
    assert [alarm.kind for alarm in trend.alarms] == [EXPECTED[first[0]], EXPECTED[second[0]]]
    assert all(0.0 <= turns < 20.0 for turns in onset_turns(trend, both, 28.0, 48.0))
    told = trend.alarms[1].size
    assert second[0] in ("stuck", "sensor_offset") or told == pytest.approx(second[1], rel=0.1)
    assert second[0] != "sensor_offset" or told == pytest.approx(first[1] + second[1], rel=0.1)


def test_a_standing_fault_is_reported_once_and_clears_when_the_machine_is_as_learnt() -> None:
    """Friction from 28 s to 70 s, and a gain in between, corrected at 60 s."""
    made = faulty("", 0.0, 986, duration_s=112.0, rate=250.0)
    worn = with_fault(made.recording, made.case, "friction", 0.6, 28.0, 70.0)
    worn = with_fault(worn, made.case, "sensor_gain", 0.12, 45.0, 60.0)
    monitor = Monitor(configured_machine(made.case), _SETTINGS)
    told, standing = [], {}
    for second, trend in in_blocks(monitor, worn, 1.0):
        told += [alarm.kind for alarm in trend.alarms]
        standing[second] = tuple(alarm.kind for alarm in monitor.watch.standing)
    assert told == ["constant_torque", "sensor_gain"]
    assert standing[44] == ("constant_torque",) and standing[59] == ("constant_torque", "sensor_gain")
    assert standing[110] == ()


@pytest.mark.parametrize("viscous_Nms", [0.0, 0.04])
def test_an_alarm_at_another_speed_than_learnt_says_so(viscous_Nms: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """A healthy machine whose file lacks friction runs at 0.7 and 0.5 of its speed, then again at the learnt one."""
    speed = SPEED["tufting"]
    shares = ((0.0, 1.0), (30.0, 1.0), (33.0, 0.7), (48.0, 0.7), (51.0, 0.5), (66.0, 0.5), (70.0, 1.0), (80.0, 1.0))
    plan = Plan([(time, share * speed) for time, share in shares], 0.4, [(1, 0.02, 0.3)])
    monkeypatch.setattr(mill_recordings, "steady", lambda *_: plan)
    case = replace(healthy("tufting", 987, run_up=False, duration_s=80.0), friction=Friction(viscous_Nms))
    alarms = monitor_recording(readings_of(record(case)), configured_machine(case), _SETTINGS).alarms
    assert len(alarms) == (viscous_Nms > 0.0)
    assert all("at another speed than learnt" in alarm.text and "learnt at 160)" in alarm.text for alarm in alarms)
    fault = with_fault(record(case), case, "friction", 1.2, 72.0)
    alarm = monitor_recording(readings_of(fault), configured_machine(case), _SETTINGS).alarms[-1]
    assert alarm.kind == "constant_torque" and "another speed" not in alarm.text


def test_noise_free_torque_raises_no_noise_alarm() -> None:
    """A simulator's torque: from the 55th turn on, rounding was 3.9 times the learnt noise."""
    theta = 16.755 * 0.002 * np.arange(12_000)
    torque = compile_machine(tufting(), ["balancing_torque_Nm"]).evaluate(theta, 16.755)["balancing_torque_Nm"]
    stamps = 10**18 + 2_000_000 * np.arange(theta.size)
    assert monitor_recording(Readings(stamps, theta, stamps, torque), tufting(), WatchSettings(20)).alarms == ()


def test_torque_without_any_noise_beside_a_real_encoder_has_no_unknown_part() -> None:
    """The residual is of 1e-8 N m, and changes as the samples move through the turn."""
    twin, step, noise = (
        compile_machine(tufting(), ["balancing_torque_Nm"]),
        2.0 * np.pi / 8192,
        np.random.default_rng(4),
    )
    time = 0.002 * np.arange(15_000)
    late = time + 0.0007
    theta, at_torque = (1.0 + 16.0 * t + 1e-5 * t**2 for t in (time, late))
    torque = twin.evaluate(at_torque, 16.0 + 2e-5 * late, 2e-5)["balancing_torque_Nm"]
    seen = np.round((theta + 2e-4 * noise.normal(size=theta.size)) / step) * step
    stamps = 2_000_000 * np.arange(theta.size)
    readings = Readings(stamps, seen, stamps + 700_000, torque)
    assert monitor_recording(readings, tufting(), WatchSettings(20)).alarms == ()


def test_nothing_is_said_of_a_healthy_machine() -> None:
    trend, _ = watched("", 0.0, 982)
    assert trend.alarms == ()
    assert len(trend.columns["turn"]) > 95


def test_a_turn_that_the_shaft_does_not_end_lacks_no_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """The machine stops within a turn, which then has more samples than a whole one at speed."""
    speed = SPEED["tufting"]
    plan = Plan([(0.0, speed), (30.0, speed), (32.0, 0.1 * speed), (32.5, 0.1 * speed), (33.3, 0.0)], 0.4, [])
    monkeypatch.setattr(mill_recordings, "steady", lambda *_: plan)
    case = healthy("tufting", 988, run_up=False, duration_s=36.0)
    turns = plan.at(np.array([36.0]))[0] / (2.0 * np.pi)
    assert 0.1 < turns % 1.0 < 0.7
    trend = monitor_recording(readings_of(record(case)), configured_machine(case), _SETTINGS)
    assert trend.alarms == ()
    assert trend.columns["turn"][-1] == np.floor(turns) - 1.0


@pytest.mark.parametrize("encoder", ["as the machine", "against it", "against it, geared 1:2"])
def test_live_in_small_blocks_finds_the_same_fault(encoder: str) -> None:
    made = faulty("needle_force", 0.2, 983, duration_s=38.0, onset_s=28.0, rate=250.0)
    r, machine = made.recording, configured_machine(made.case)
    if encoder != "as the machine":
        factor = -2.0 if "geared" in encoder else -1.0
        old, sensors = machine.sensors.encoder, machine.sensors
        assert old.direction == 1 and old.ratio == 1.0
        told = replace(old, direction=-1, ratio=-1.0 / factor, zero_rad=factor * old.zero_rad)
        machine = replace(machine, sensors=replace(sensors, encoder=told))
        r = replace(r, angle=factor * np.unwrap(r.angle))
    monitor = Monitor(machine, _SETTINGS)
    alarms = [alarm for _, trend in in_blocks(monitor, r, 0.5) for alarm in trend.alarms]
    assert [alarm.kind for alarm in alarms] == ["load_force"]
    recorded = monitor_recording(readings_of(r), machine, _SETTINGS).alarms
    assert [(alarm.kind, alarm.stamp_ns) for alarm in alarms] == [(alarm.kind, alarm.stamp_ns) for alarm in recorded]
    assert alarms[0].size == pytest.approx(recorded[0].size, rel=1e-3)
    assert monitor.turns > 90
    assert monitor.watch.active == ("load_force",)


def test_a_run_up_is_not_learnt_as_healthy(monkeypatch: pytest.MonkeyPatch) -> None:
    """The file lacks friction that grows with the speed, so that each turn of a run-up has another residual."""
    speed = SPEED["tufting"]
    plan = Plan(
        [(time, share * speed) for time, share in ((0.0, 0.2), (14.0, 1.0), (60.0, 1.0))], 0.4, [(1, 0.02, 0.3)]
    )
    monkeypatch.setattr(mill_recordings, "steady", lambda *_: plan)
    case = replace(healthy("tufting", 988, run_up=False, duration_s=60.0), friction=Friction(0.15))
    made = with_fault(record(case), case, "needle_force", 0.2, 50.0)
    trend = monitor_recording(readings_of(made), configured_machine(case), _SETTINGS)
    assert [alarm.kind for alarm in trend.alarms] == ["load_force"]
    assert trend.alarms[0].size == pytest.approx(0.2, rel=0.1)
    learnt = trend.columns["speed_rad_s"][: trend.unwatched]
    assert learnt.size > _SETTINGS.learn_turns + 10  # turns of the run-up are passed over
    away = trend.columns["load_force_sigmas"][trend.unwatched : trend.unwatched + 20]
    assert np.abs(away).max() < 4.0


def test_a_shaft_that_turns_backwards_is_watched_in_the_order_of_time() -> None:
    made = faulty("", 0.0, 984, duration_s=20.0, onset_s=19.0, rate=250.0)
    r, machine = made.recording, configured_machine(made.case)
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
    """Three minutes at 50 Hz; samples of an unfinished turn are dropped after one minute."""
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
        assert torque * 55 * 50 <= torques <= 61 * 50


def test_time_set_back_is_watched_on() -> None:
    """The healthy part is learnt; then the clock is set back, and the needles' force changes."""
    monitor = Monitor(configured_machine(faulty("", 0.0, 983, duration_s=1.0, onset_s=0.5, rate=250.0).case), _SETTINGS)
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
    trend = monitor_recording(readings, configured_machine(made.case), _SETTINGS)
    assert [alarm.kind for alarm in trend.alarms] == ["constant_torque"]


@pytest.mark.parametrize("live", [False, True])
def test_a_filtered_torque_leaves_the_noise(live: bool) -> None:
    """Measured behind a second-order low pass and a high pass, which the file declares."""
    case = healthy("tufting", 77, duration_s=14.0, run_up=False)
    filters = {"low_pass_hz": 20.0, "low_pass_order": 2, "high_pass_hz": 0.5}
    case = replace(case, torque=replace(case.torque, **filters))
    made, machine = record(case), configured_machine(case)
    sensors = replace(machine.sensors, torque=replace(machine.sensors.torque, **filters))
    monitor = Monitor(replace(machine, sensors=sensors), _SETTINGS, "causal" if live else "smooth")
    if live:
        trends = [trend.columns for _, trend in in_blocks(monitor, made, 0.9)]
        rms = np.concatenate([columns["rms_Nm"] for columns in trends if columns])
    else:
        monitor.add_angles(made.angle_stamps_ns, made.angle)
        monitor.add_torques(made.torque_stamps_ns, made.torque)
        rms = monitor.finish().columns["rms_Nm"]
    assert 24 < rms.size < 32
    assert np.median(rms) < 1.1 * case.torque.noise_Nm
    assert rms.max() < 1.5 * case.torque.noise_Nm
