"""Shafts that rock: a press in pendulum mode, a loom that is inched. Truth by equations of their own."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.generators import mill_recordings
from tests.generators.configured_machine import configured_machine
from tests.generators.faults import with_fault
from tests.generators.mill_recordings import Case, MillRecording, healthy, record
from tests.generators.planned_motion import Plan
from textile_twin_core.comparison import Readings, assess, calibrate
from textile_twin_core.comparison.assessment import Assessment
from textile_twin_core.comparison.fault_watch import Alarm, WatchSettings
from textile_twin_core.comparison.monitor import Monitor, monitor_recording
from textile_twin_core.comparison.shaft_track import ShaftTrack
from textile_twin_core.comparison.torque_readings import stuck_readings
from textile_twin_core.machine import Machine


def rocking(turns: float, period_s: float, monkeypatch: pytest.MonkeyPatch) -> tuple[Case, MillRecording]:
    """Record a loom whose shaft goes a number of turns forward and back again; file and sensors are right."""
    fast = 2.0 * math.pi**2 * turns / period_s
    points = [(0.5 * period_s * k, fast * (-1.0) ** k) for k in range(math.ceil(50.0 / period_s) + 2)]
    monkeypatch.setattr(mill_recordings, "steady", lambda *_: Plan(points, 0.7))
    case = healthy("loom", 71, run_up=False, duration_s=12.0)
    return case, record(case)


PERIOD_S, LEARNT, ONSET_S = 2.0, 15, 60.0
"""Cycles of the watched shaft, cycles learnt, and time after which there is a fault."""


@pytest.fixture(scope="module")
def watched() -> tuple[Case, MillRecording]:
    """Record a tufting machine whose shaft goes 1.6 turns to and fro, 250 times a second."""
    with pytest.MonkeyPatch.context() as patch:
        fast = 2.0 * math.pi**2 * 1.6 / PERIOD_S
        points = [(0.5 * PERIOD_S * k, fast * (-1.0) ** k) for k in range(82)]
        patch.setattr(mill_recordings, "steady", lambda *_: Plan(points, 0.7))
        case = healthy("tufting", 71, run_up=False, duration_s=80.0)
        encoder, torque = replace(case.encoder, rate_hz=250.0), replace(case.torque, rate_hz=250.0)
        case = replace(case, encoder=encoder, torque=torque)
        return case, record(case)


PRESS = """\
name: press
points: {O: [0, 0]}
groups:
  - {type: crank, name: crank, at: O, end: A, length_m: 0.06}
  - {type: rrp_dyad, rod: rod, slider: slide, from: A, end: B, tip: T, lengths_m: [0.25, 0.05], guide_point_m: [0, 0],
     guide_direction: [1, 0]}
gravity_m_s2: [9.81, 0]
bodies:
  crank: {mass_kg: 0, inertia_kgm2: 0.05}
  rod: [{mass_kg: 1, centroid: [0, 0]}, {mass_kg: 1, centroid: [1, 0]}]
  slide: {mass_kg: 8}
loads: [{type: shaft_friction, coulomb_Nm: 2}]
measures: [{type: travel, name: slide, point: B, origin: O, direction: [1, 0]}]
"""


def press_torque(theta: np.ndarray, omega: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Compute the torque of a slider-crank with its rod as two point masses, by its kinetic and potential energy."""
    crank, rod, moved = 0.06, 0.25, 9.0
    s, c = np.sin(theta), np.cos(theta)
    root = np.sqrt(rod**2 - (crank * s) ** 2)
    first = -crank * s - crank**2 * s * c / root
    second = -crank * c - crank**2 * ((c * c - s * s) / root + (crank * s * c) ** 2 / root**3)
    inertia = 0.05 + crank**2 + moved * first**2
    gravity = -9.81 * (-crank * s + moved * first)
    return np.asarray(inertia * alpha + moved * first * second * omega**2 + gravity + 2.0 * np.sign(omega))


def faulty(made: MillRecording, case: Case, kind: str, size: float) -> MillRecording:
    if kind != "friction":
        return with_fault(made, case, kind, size, ONSET_S)
    time = (made.torque_stamps_ns - made.torque_stamps_ns[0]) * 1e-9 + 0.0507
    against = size * np.sign(made.plan.at(np.minimum(time, case.duration_s))[1])
    return replace(made, torque=made.torque + np.where(time > ONSET_S, against, 0.0))


def assessed(made: MillRecording, case: Case) -> Assessment:
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return assess(readings, configured_machine(case))


@pytest.mark.parametrize(("turns", "period_s"), [(0.8, 2.0), (2.6, 6.5)])
def test_a_right_file_of_a_rocking_shaft_is_accused_of_nothing(
    turns: float, period_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    case, made = rocking(turns, period_s, monkeypatch)
    found = assessed(made, case)
    assert found.verdict == () and found.found is not None
    assert found.found.explained > 0.98
    mean = 4.0 * math.pi * turns / period_s
    assert 0.6 * mean < abs(found.found.evidence.working_speed()) < 1.6 * mean
    assert found.found.evidence.track.turns == pytest.approx(2.0 * turns * 12.0 / period_s, rel=0.1)


@pytest.mark.slow
def test_mistakes_of_a_rocking_shaft_are_named_with_their_size(monkeypatch: pytest.MonkeyPatch) -> None:
    """A shaft that rocks tells zero and delay apart: a delay shifts both directions oppositely."""
    case, made = rocking(1.5, 4.0, monkeypatch)
    wrong = replace(case, configured=replace(case.configured, zero_rad=math.radians(30.0)))
    (zero,) = assessed(made, wrong).verdict
    assert zero.cause == "encoder_zero"
    assert zero.value == pytest.approx(-math.radians(30.0), abs=math.radians(0.5))
    late = replace(made, torque_stamps_ns=made.torque_stamps_ns + 30_000_000)
    (delay,) = assessed(late, case).verdict
    assert delay.cause == "delay"
    assert delay.value == pytest.approx(0.03, abs=1e-3)


def test_calibrate_writes_no_worse_sensors_than_those_of_a_right_file(monkeypatch: pytest.MonkeyPatch) -> None:
    case, made = rocking(1.3, 3.0, monkeypatch)
    found = calibrate(
        Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque), configured_machine(case)
    )
    assert found.rms_after_Nm <= found.rms_before_Nm


@pytest.mark.parametrize(
    ("kind", "size", "named"),
    [
        ("", 0.0, None),
        ("needle_force", 0.2, "load_force"),
        ("friction", 0.8, "constant_torque"),
        ("sensor_offset", -1.0, "sensor_offset"),
        ("sensor_gain", 0.1, "sensor_gain"),
        ("encoder_slip", 0.05, "phase"),
    ],
)
def test_a_rocking_shaft_is_watched_by_cycles(
    kind: str, size: float, named: str | None, watched: tuple[Case, MillRecording]
) -> None:
    case, made = watched
    made = faulty(made, case, kind, size)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    trend = monitor_recording(readings, configured_machine(case), WatchSettings(learn_turns=LEARNT))
    assert trend.columns["turn"].tolist() == list(range(39))  # the first reversal begins the first cycle
    assert trend.columns["speed_rad_s"] == pytest.approx(4.0 * math.pi * 1.6 / PERIOD_S, rel=0.02)
    assert [alarm.kind for alarm in trend.alarms] == ([named] if named else [])
    assert trend.cycles
    if named:
        assert abs(trend.alarms[0].size) == pytest.approx(abs(size), rel=0.1)
        assert 0.0 < (trend.alarms[0].stamp_ns - made.torque_stamps_ns[0]) * 1e-9 - ONSET_S < 9.0 * PERIOD_S


def test_a_rocking_shaft_is_watched_live_as_from_a_recording(watched: tuple[Case, MillRecording]) -> None:
    case, made = watched
    made = faulty(made, case, "needle_force", 0.2)
    machine, settings = configured_machine(case), WatchSettings(learn_turns=LEARNT)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    recorded = monitor_recording(readings, machine, settings)
    monitor, alarms, turns = Monitor(machine, settings), list[Alarm](), list[int]()
    for begin in np.arange(made.angle_stamps_ns[0], made.angle_stamps_ns[-1], 700_000_000).tolist():
        for stamps, values, add in (
            (made.angle_stamps_ns, made.angle, monitor.add_angles),
            (made.torque_stamps_ns, made.torque, monitor.add_torques),
        ):
            part = (stamps >= begin) & (stamps < begin + 700_000_000)
            add(stamps[part], values[part])
        trend = monitor.advance()
        alarms += trend.alarms
        turns += trend.columns.get("turn", np.empty(0)).tolist()
    assert [(each.kind, each.stamp_ns) for each in alarms] == [(a.kind, a.stamp_ns) for a in recorded.alarms]
    assert turns == recorded.columns["turn"].tolist()[: len(turns)] and len(turns) >= 38


def test_a_shaft_that_reverses_after_many_turns_is_watched_by_turns() -> None:
    """Sixty turns ahead, a stop, and sixty back."""
    plan = Plan([(0.0, 0.0), (1.0, 16.0), (23.0, 16.0), (24.0, 0.0), (25.0, 0.0), (26.0, -16.0), (49.0, -16.0)], 0.4)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mill_recordings, "steady", lambda *_: plan)
        case = healthy("tufting", 72, run_up=False, duration_s=48.0)
        made = record(case)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    trend = monitor_recording(readings, configured_machine(case), WatchSettings(learn_turns=20))
    assert trend.alarms == ()
    turns, speeds = trend.columns["turn"], trend.columns["speed_rad_s"]
    back = int(np.argmax(speeds < 0.0))
    assert set(np.diff(turns[:back])) == {1} and set(np.diff(turns[back:])) == {-1}
    assert np.all(speeds[:back] > 0.0) and np.all(speeds[back:] < 0.0) and min(back, turns.size - back) > 50


def test_uncertain_accelerations_are_no_gaps_of_the_angle() -> None:
    """States are left out around each reversal, and readings are missing for half a second from 10 s on."""
    time = 0.005 * np.arange(4000)
    unsure, missing = np.abs(np.mod(time, 1.0) - 0.25) < 0.06, (time > 10.0) & (time < 10.5)
    kept = time[~unsure & ~missing]
    flat = np.zeros(kept.size)
    track = ShaftTrack(kept, flat, flat, flat, 0.025, unsure_s=time[unsure & ~missing])
    without_angle, uncertain = track.gaps
    assert track.time_s[:-1][without_angle] == pytest.approx([10.0], abs=1e-9)
    assert np.count_nonzero(uncertain) == 19


def press_readings(folder: Path, direction: int = 1, sign: int = 1) -> tuple[Readings, Machine]:
    """Record the press while it goes 1.43 turns to and fro."""
    (folder / "press.yaml").write_text(PRESS)
    press = ttc.load_machine(folder / "press.yaml")
    assert isinstance(press, Machine)
    fast = 2.0 * math.pi**2 * 1.43 / 3.4
    plan = Plan([(1.7 * k, fast * (-1.0) ** k) for k in range(11)], 0.7)
    time = np.arange(0.0, 16.0, 0.002)
    theta, omega, alpha = plan.at(time)
    noise = 0.08 * np.random.default_rng(3).standard_normal(time.size)
    step = 2.0 * math.pi / 2**14
    stamps, angle = np.rint(time * 1e9).astype(np.int64), np.rint(theta / step) * step
    torque = np.round(sign * (press_torque(theta, omega, alpha) + noise), 3)
    return Readings(stamps, direction * angle, stamps, torque), press


@pytest.mark.parametrize(("direction", "sign"), [(1, 1), (-1, 1), (1, -1)])
def test_direction_and_sign_are_not_distinguished_on_a_press_that_is_its_own_mirror_image(
    direction: int, sign: int, tmp_path: Path
) -> None:
    verdict = assess(*press_readings(tmp_path, direction, sign)).verdict
    if direction == sign:
        assert verdict == ()
    else:
        (cause,) = verdict
        other = {"encoder_direction": "sensors.torque.gain", "torque_sign": "sensors.encoder.direction"}
        assert cause.equivalents == (other[cause.cause],)
        assert "mirror image" in cause.text


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_a_torque_sensor_that_stops_is_said_and_left_out(share: float, tmp_path: Path) -> None:
    readings, press = press_readings(tmp_path)
    torque = readings.torque.copy()
    stopped = round((1.0 - share) * torque.size)
    torque[stopped:] = torque[stopped]
    found = assess(replace(readings, torque=torque), press)
    assert found.verdict == ()
    seconds = share * 16.0
    assert any(f"stays at {torque[stopped]:.4g} N m for {seconds:.1f} s" in note for note in found.notes)


def test_coarse_readings_and_a_shaft_that_stands_show_no_sensor_that_stopped() -> None:
    torque = np.round(np.sin(0.05 * np.arange(4000)), 6)
    torque[1000:2000] = torque[1000]
    path = 0.03 * np.arange(4000)
    assert np.flatnonzero(stuck_readings(torque, path)).tolist() == list(range(1000, 2000))
    assert not stuck_readings(torque, np.where(path > path[1000], path[1000], path)).any()
    assert not stuck_readings(np.round(torque, 1), path).any()
