"""Levels of the diagnostics: from shares of samples that do not serve, interruptions, publishers and residuals."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("rclpy")

from textile_twin_core.shaft import SampleReport
from textile_twin_ros import inputs
from textile_twin_ros.diagnostics import ERROR, OK, STALE, WARN, Status
from textile_twin_ros.health import (
    CountWindow,
    MeasuredTorque,
    burst_findings,
    joint_findings,
    late_findings,
    publisher_findings,
    residual_findings,
    sample_counts,
    sample_findings,
    stalled_findings,
    stamp_findings,
    state_level,
    unit_findings,
    with_findings,
)
from textile_twin_ros.inputs import SampleInput


def level(growth: dict[str, float]) -> bytes:
    return with_findings(Status("angle", OK, "500 Hz"), sample_findings(growth, "messages")).level


@pytest.mark.parametrize(
    ("counts", "expected"),
    [
        ({}, OK),
        ({"rejected_not_finite": 9}, OK),
        ({"rejected_not_finite": 11}, WARN),
        ({"rejected_older_stamp": 6, "rejected_duplicate_stamp": 6}, WARN),
        ({"outliers": 300, "unreadable": 250}, ERROR),
        ({"rejected_not_finite": 1000}, ERROR),
        ({"gaps": 1}, WARN),
        ({"jumps": 1}, WARN),
        ({"set_back": 1}, WARN),
        ({"reversals": 40, "knocks": 12, "standstills": 3}, OK),
        ({"repeats": 800}, OK),
    ],
)
def test_levels_of_a_thousand_samples(counts: dict[str, float], expected: bytes) -> None:
    assert level({"received": 1000.0, **counts}) == expected


def test_readings_that_a_sensor_says_again_are_counted() -> None:
    assert sample_counts(SampleReport(received=5, accepted=5, repeats=4), set_back=0)["repeats"] == 4


def test_nothing_received_is_no_share() -> None:
    assert level({"received": 0.0, "rejected_not_finite": 0.0}) == OK


def test_what_is_over_is_forgotten_after_the_window() -> None:
    recent = CountWindow(window_s=5.0)
    states = []
    for second in range(20):
        bad = 50.0 * min(second, 3)  # from second 1 to 3
        growth = recent.growth({"received": 500.0 * second, "outliers": bad}, now=100.0 + second)
        states.append(level(growth) != OK)
    assert states == [False] + [True] * 7 + [False] * 12


def test_counts_that_restart_are_no_growth_of_what_was() -> None:
    recent = CountWindow(window_s=5.0)
    recent.growth({"received": 1000.0, "gaps": 3.0}, now=0.0)
    recent.growth({"received": 1500.0, "gaps": 3.0}, now=6.0)
    assert recent.growth({"received": 20.0, "gaps": 1.0}, now=7.0) == {"received": 520.0, "gaps": 1.0}


def test_a_unit_other_than_radians_is_reported_with_the_parameter_that_mends_it() -> None:
    angle = np.mod(0.05 * np.arange(1000), 2.0 * np.pi)
    assert not unit_findings(np.empty(0), 1.0) and not unit_findings(angle, 1.0)
    (finding,) = unit_findings(np.rint(angle * 4096 / (2.0 * np.pi)) % 4096, 1.0)
    assert finding.level == WARN and "looks like counts" in finding.text and "0.001533980788" in finding.text


def test_stamps_in_bursts_are_named_with_their_numbers() -> None:
    number = np.arange(512)
    stamps = (number // 8 + 1) * 16_000_000 + (number % 8) * 71_429
    (finding,) = burst_findings(stamps, 0.03 * number, angles=True)
    assert finding.level == WARN
    assert burst_findings(stamps, 1e-9 * stamps, angles=True) == []  # taken in bursts
    assert len(burst_findings(stamps, np.sin(number), angles=False)) == 1
    assert burst_findings(number * 2_000_000, 0.03 * number, angles=True) == []
    assert burst_findings(number[:0], np.zeros(0), angles=True) == []


def test_publishers_stamps_and_states() -> None:
    assert not publisher_findings(["/drive"], "/main_shaft/angle")
    assert publisher_findings(["/drive", "/rollers"], "/main_shaft/angle", of_other_joints=1) == []
    assert publisher_findings(["/drive", "/drive_2", "/rollers"], "/main_shaft/angle", of_other_joints=1)
    (finding,) = publisher_findings(["/replay_node", "/drive"], "/main_shaft/angle")
    assert finding.level == WARN and "2 publishers" in finding.text and "/drive, /replay_node" in finding.text
    for stamped, words in ((True, "header.stamp"), (False, "use_sim_time")):
        assert not stamp_findings(None, stamped) and not stamp_findings(1, stamped)
        assert stamp_findings(0, stamped)[0].level == ERROR and words in stamp_findings(0, stamped)[0].text
    levels = [state_level(state) for state in ("running", "standstill", "settling", "starting", "lost")]
    assert levels == [OK, OK, WARN, WARN, ERROR]


def test_residual_against_its_limit_or_the_measured_torque() -> None:
    measured = MeasuredTorque()
    assert math.isnan(measured.rms_Nm())
    measured.take([3.0, -3.0, math.nan, 3.0])
    assert measured.rms_Nm() == 3.0
    assert not residual_findings(math.nan, 3.0, 0.0)
    assert not residual_findings(2.9, 3.0, 0.0) and residual_findings(3.1, 3.0, 0.0)
    assert not residual_findings(3.1, 3.0, 3.2) and residual_findings(0.3, 3.0, 0.2)


def test_torques_that_all_go_without_a_residual_are_reported() -> None:
    assert not stalled_findings({"given": 0.0}, 0.02)
    assert not stalled_findings({"given": 1.0, "load jumps there": 20.0}, 3600.0)
    (finding,) = stalled_findings({"given": 0.0, "not finite": 0.0, "stamp not after the one before": 2500.0}, math.nan)
    assert finding.level == WARN and "2500 stamp not after the one before" in finding.text


def test_the_worst_level_stays_and_all_texts_are_reported() -> None:
    stale = Status("angle", STALE, "no data", {"age_s": 3.0})
    both = with_findings(stale, sample_findings({"received": 10.0, "outliers": 10.0, "gaps": 1.0}, "messages"))
    assert both.level == STALE and both.log.keys() == {"unfit", "gaps"} and both.values == stale.values
    assert both.message.count("; ") == 2
    assert with_findings(stale, []) is stale


@pytest.mark.parametrize(
    ("others", "silent_s", "words"),
    [
        (None, 9.0, ""),
        (["feed_roller"], 0.2, ""),
        (["take_up", "feed_roller"], 2.0, "no message has joint 'main_shaft', there are feed_roller, take_up: set"),
        ([], 2.0, "there are none at all"),
        (["main_shaft"], 2.0, "messages name joint 'main_shaft' and have no value of it"),
    ],
)
def test_a_joint_that_no_message_has_is_named(others: list[str] | None, silent_s: float, words: str) -> None:
    findings = joint_findings("main_shaft", others, silent_s)
    assert len(findings) == bool(words)
    assert all(finding.level == ERROR and words in finding.text for finding in findings)


@pytest.mark.parametrize(("received_ns", "is_late"), [(0, False), (1, True)])
def test_only_a_stated_time_of_reception_makes_a_node_late(
    received_ns: int, is_late: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cyclone DDS states none, which is 0; any other time is of long ago."""
    source = SampleInput.__new__(SampleInput)
    source._subscription = source._message_class = None  # type: ignore[assignment]
    taken = (b"raw", {"received_timestamp": received_ns, "source_timestamp": 5})
    monkeypatch.setattr(inputs, "take_next", lambda *_: taken)
    assert source._next() == b"raw"
    assert bool(late_findings(source._late_s)) == is_late
