"""Timing of the benchmark: one core throughout, every round stored, ratios independent of slow rounds."""

from __future__ import annotations

import os

import pytest

from tests.benchmarks.impact_table import EVENT_DRIVEN, ImpactRow
from tests.benchmarks.tables import impact_ratios
from textile_twin_core.bench.ratios import ratio, ratios
from textile_twin_core.bench.run import Row
from textile_twin_core.bench.text import heading, ratio_lines
from textile_twin_core.bench.timing import PINS, Candidate, bench_core, one_core, take_turns

pins = pytest.mark.skipif(not PINS, reason="this system holds no process to a core")


@pins
def test_one_core_while_it_lasts() -> None:
    before = os.sched_getaffinity(0)
    core = bench_core()
    with one_core():
        assert os.sched_getaffinity(0) == {core}
        assert bench_core() == core
    assert os.sched_getaffinity(0) == before


@pins
def test_all_cores_again_after_a_failure() -> None:
    before = os.sched_getaffinity(0)
    with pytest.raises(ZeroDivisionError), one_core():
        _ = 1 / 0
    assert os.sched_getaffinity(0) == before


def test_a_system_that_pins_nothing_is_timed_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("textile_twin_core.bench.timing.PINS", False)
    assert bench_core() is None
    with one_core():
        pass
    assert heading(bench_core(), 3).startswith("wall time on any core")


def test_every_round_is_stored_and_candidates_take_turns() -> None:
    calls: list[str] = []
    ways = [Candidate(name, None, lambda name=name: calls.append(name), samples=2) for name in "ab"]  # type: ignore[misc]
    heard: list[int] = []
    take_turns(ways, 3, heard.append)
    assert calls == ["a", "b"] + ["a", "a", "b", "b"] * 3  # once before the rounds, once before it is timed
    assert heard == [1, 1, 1]
    assert [len(way.batch_times) for way in ways] == [3, 3]
    ways[0].batch_times[:] = [4.0, 1.0, 2.0]
    assert ways[0].ns_per_sample == 1e9


def test_a_ratio_is_taken_round_by_round() -> None:
    """Make the computer ten times slower in the second round: the ratio of the medians would be 30/2."""
    found = ratio("a", "b", [3.0, 30.0, 33.0], [1.0, 10.0, 2.0])
    assert (found.quartile_1, found.median, found.quartile_3) == (3.0, 3.0, 9.75)


def _row(method: str, peer: str | None, times: tuple[float, ...], outputs: str = "torque") -> Row:
    return Row(method, peer, outputs, "tufting", 100, 1e-15, times[0], None, "", times)


def test_the_ratios_that_hold_on_any_computer() -> None:
    rows = [
        _row("vectorised", "C", (10.0, 20.0)),
        _row("exact", None, (100.0, 200.0)),
        _row("table 1e-06", None, (40.0, 80.0)),
        _row("table 1e-13", None, (50.0, 100.0)),
        _row("projection", "pinocchio", (2e5, 4e5)),
        _row("njit", "numba", (80.0, 160.0)),
        _row("generated C", "casadi", (200.0, 400.0)),
        _row("exact", None, (40.0, 80.0), "position"),
        _row("njit", "numba", (1.0, 2.0), "position"),
    ]
    assert {(found.above, found.below): found.median for found in ratios(rows)} == {
        ("exact", "C, vectorised"): 10.0,
        ("table 1e-13", "C, vectorised"): 5.0,
        ("exact", "numba, njit"): 1.25,
        ("exact", "casadi, generated C"): 0.5,
        ("pinocchio, projection", "exact"): 2000.0,
        ("exact, position", "exact"): 0.4,
    }
    assert "pinocchio, projection / exact" in ratio_lines(ratios(rows))
    assert ratios(rows[:1]) == [] and ratio_lines([]) == ""


def test_impacts_are_compared_at_the_tightest_settings() -> None:
    def run(method: str, setting: str, ms: float) -> ImpactRow:
        return ImpactRow(method, setting, 1e-9, ms, (ms, ms))

    rows = [run(EVENT_DRIVEN, "1e-4", 1.0), run(EVENT_DRIVEN, "1e-13", 2.0), run("a", "1", 3.0), run("a", "2", 8.0)]
    (found,) = impact_ratios(rows)
    assert (found.above, found.below, found.median) == ("a, 2", f"{EVENT_DRIVEN}, 1e-13", 4.0)
