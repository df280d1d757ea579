"""Pareto front of error against time in the plot."""

from __future__ import annotations

from tests.benchmarks.plots.speed import front


def test_what_another_beats_in_both_is_not_on_the_front() -> None:
    exact, fine, coarse, slow = (5.0, 1e-16), (7.0, 1e-14), (3.0, 1e-5), (9.0, 1e-16)
    assert front([coarse, fine, exact, slow]) == [coarse, exact]
