"""Benchmark of impacts: its stored reference against 30 digits, and the methods against the reference."""

from __future__ import annotations

import mpmath as mp
import pytest

from tests.benchmarks.impact_methods import TransferEquations
from tests.benchmarks.impact_table import EVENT_DRIVEN, PENALTY, REFERENCE, TOLERANCES, WITH_EVENTS, impact_table
from tests.benchmarks.tables import impact_lines
from tests.contact.needle_reference import Stroke
from textile_twin_core.machines.needle_transfer import needle_transfer


def test_the_reference_has_been_calculated_with_30_digits() -> None:
    duration = str(needle_transfer().parameters["forward_duration_s"])
    with mp.workdps(30):
        events = Stroke("0.0719", "0.0949", "modified_sine", "0.0326", duration, contacts=1).run("0.0195").events
    first = {name: at for at, name in reversed(events)}
    for stored, name in zip(REFERENCE, ("pad touched", "F-G"), strict=True):
        assert abs(stored - first[name]) < 4e-18


def test_solve_ivp_at_its_tightest_comes_to_the_reference() -> None:
    found = TransferEquations(needle_transfer()).with_events("DOP853", 1e-13)
    assert found == pytest.approx(REFERENCE, rel=0.0, abs=5e-14)


def test_the_table() -> None:
    heard: list[tuple[int, int]] = []
    rows = impact_table(1, lambda done, total: heard.append((done, total)))
    assert heard == [(1, 1)]
    methods = [EVENT_DRIVEN, *map(WITH_EVENTS.format, TOLERANCES), PENALTY]
    assert list(dict.fromkeys(row.method for row in rows)) == methods
    assert all(row.ms_per_run > 0.0 and len(row.ms_per_round) == 1 for row in rows)
    by_method = {method: [row.error_s for row in rows if row.method == method] for method in methods}
    assert by_method[EVENT_DRIVEN][-1] < 2e-15
    for method, errors in by_method.items():
        if method != EVENT_DRIVEN:  # ours reaches rounding error two settings before its last
            assert errors == sorted(errors, reverse=True)
    assert 1e-7 < by_method[PENALTY][-1] < 1e-5
    table = impact_lines(rows)
    assert all(row.method in table and row.setting in table for row in rows)
