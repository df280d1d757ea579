"""Shafts that rock: a press in pendulum mode, a loom that is inched. Truth by equations of their own."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest

from tests.generators import mill_recordings
from tests.generators.configured_machine import configured_machine
from tests.generators.mill_recordings import Case, MillRecording, healthy, record
from tests.generators.planned_motion import Plan
from textile_twin_core.comparison import Readings, assess, calibrate
from textile_twin_core.comparison.assessment import Assessment
from textile_twin_core.comparison.shaft_track import ShaftTrack


def rocking(turns: float, period_s: float, monkeypatch: pytest.MonkeyPatch) -> tuple[Case, MillRecording]:
    """Record a loom whose shaft goes a number of turns forward and back again; file and sensors are right."""
    fast = 2.0 * math.pi**2 * turns / period_s
    points = [(0.5 * period_s * k, fast * (-1.0) ** k) for k in range(math.ceil(50.0 / period_s) + 2)]
    monkeypatch.setattr(mill_recordings, "steady", lambda *_: Plan(points, 0.7))
    case = healthy("loom", 71, run_up=False, duration_s=12.0)
    return case, record(case)


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
