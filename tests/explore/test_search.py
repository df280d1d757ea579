"""Search for designs: from a poor start beyond the paper's loom, and reproducible with the same seed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.campaign import more
from textile_twin_core import machines
from textile_twin_core.errors import SceneError
from textile_twin_core.explore.analysis import analyse
from textile_twin_core.explore.design import Design
from textile_twin_core.explore.packing import failing_text
from textile_twin_core.explore.search import Goal, SearchProgress, Task, search
from textile_twin_core.synthesis.tolerance import Limit

RANGES = {
    "axis_ratio": (0.75, 1.0),
    "crank_m": (0.03, 0.05),
    "coupler_m": (0.08, 0.13),
    "rocker_m": (0.16, 0.20),
    "ground_m": (0.18, 0.22),
    "past_largest_ratio_rad": (-0.5, 0.5),
}
GOALS = (Goal("sley_dwell_rad", True), Goal("sley_largest_acceleration_m_s2", False))
LIMITS = (
    Limit("smallest_transmission_angle_rad", True, math.radians(50.0)),
    Limit("sley_stroke_m", True, 0.0849),
    Limit("sley_stroke_m", False, 0.0851),
)
POOR = {"axis_ratio": 0.95, "crank_m": 0.035, "coupler_m": 0.115, "past_largest_ratio_rad": math.radians(20.0)}


@pytest.mark.parametrize("seed", [3, *more(11)])
def test_poor_start_leads_beyond_the_paper_s_loom(seed: int) -> None:
    paper = analyse(Design.of(machines.elliptic_gear_beatup())).numbers
    start = Design.of(machines.elliptic_gear_beatup(**POOR))
    assert analyse(start).numbers["sley_dwell_rad"] < math.radians(135.0)
    found = search(start, Task(RANGES, GOALS, LIMITS, seed), seconds=math.inf, generations=120)
    better = [
        one
        for one in found.front
        if one.numbers["sley_dwell_rad"] >= paper["sley_dwell_rad"]
        and one.numbers["sley_largest_acceleration_m_s2"] <= paper["sley_largest_acceleration_m_s2"]
    ]
    assert better
    exact = analyse(start.changed(better[0].values)).numbers
    for name, value in better[0].numbers.items():
        assert exact[name] == pytest.approx(value, rel=1e-6)
    for one in found.front:
        assert 0.0848 < one.numbers["sley_stroke_m"] < 0.0852


def test_no_design_of_the_front_is_better_than_another_in_both_goals() -> None:
    found = search(
        Design.of(machines.elliptic_gear_beatup()), Task(RANGES, GOALS, (), 1), seconds=math.inf, generations=25
    )
    dwell, fast = (np.array([one.numbers[g.number] for one in found.front]) for g in GOALS)
    order = np.argsort(dwell)
    assert dwell.size > 20 and (np.diff(fast[order]) > -0.02 * fast[order][1:]).all()


def test_same_seed_gives_the_same_front() -> None:
    design = Design.of(machines.handloom_beatup())
    ranges = {"crank_m": (0.04, 0.08), "coupler_m": (0.15, 0.25), "rocker_m": (0.2, 0.26)}
    goals = (Goal("beater_largest_acceleration_m_s2", True), Goal("peak_torque_Nm", False))
    first, again, other = (
        search(design, Task(ranges, goals, (), seed), seconds=math.inf, generations=12).front for seed in (5, 5, 6)
    )
    assert first == again and first != other
    assert search(design, Task(ranges, goals, (), 5), seconds=math.inf, generations=2).complete


def test_progress_is_reported_and_stop_is_obeyed() -> None:
    seen: list[SearchProgress] = []
    early: list[SearchProgress] = []  # a slow computer reports three generations, too
    asked = 0

    def stopped() -> bool:
        nonlocal asked
        asked += 1
        return asked == 3

    design, goals = Design.of(machines.handloom_beatup()), (Goal("beater_stroke_m", True),)
    task = Task({"crank_m": (0.04, 0.08)}, goals, (Limit("peak_torque_Nm", False, 9.0),))
    found = search(design, task, early.append, stopped)
    assert found.designs == 480 and found.share == 1.0 and not found.complete
    search(design, task, seen.append, lambda: len(seen) > 2, 120.0)
    assert 0 < seen[0].designs < seen[1].designs < seen[2].designs
    assert seen[2].designs_per_second > 0.0 and 0.0 < seen[0].share < 1.0
    for progress in (*early, *seen, found):
        assert all(set(one.numbers) == {"beater_stroke_m", "peak_torque_Nm"} for one in progress.front)


def test_machine_with_a_history_is_searched_one_by_one() -> None:
    design = Design.of(machines.needle_transfer())
    goals = (Goal("element_2_largest_deceleration_m_s2", False),)
    found = search(design, Task({"stroke_m": (0.031, 0.033)}, goals), seconds=math.inf, generations=1)
    assert found.designs == 24 and found.front


@pytest.mark.parametrize(
    ("task", "says"),
    [
        (Task({"crank_m": (0.03, 0.05)}, ()), "no goal"),
        (Task({}, GOALS), "no parameter is free"),
        (Task({"beauty": (0.0, 1.0)}, GOALS), "no parameter 'beauty'"),
        (Task({"crank_m": (0.05, 0.03)}, GOALS), "two rising numbers"),
        (Task({"crank_m": (0.03, math.nan)}, GOALS), "two rising numbers"),
        (Task({"crank_m": (0.03, 0.05)}, (Goal("beauty", True),)), "no such number"),
        (Task({"crank_m": (0.03, 0.05)}, (Goal("peak_torque_Nm", True),)), "no such number"),
    ],
)
def test_invalid_tasks_are_refused(task: Task, says: str) -> None:
    with pytest.raises(SceneError, match=says):
        search(Design.of(machines.elliptic_gear_beatup()), task)


def test_the_limit_that_no_design_keeps_is_named() -> None:
    design = Design.of(machines.elliptic_gear_beatup())
    far = Limit("sley_stroke_m", True, 0.5)
    near = Limit("smallest_transmission_angle_rad", True, math.radians(10.0))
    found = search(design, Task(RANGES, GOALS, (near, far), 2), seconds=math.inf, generations=10)
    assert not found.front
    tallies = {one.limit: one for one in found.tallies}
    assert tallies[near].designs > 0 and tallies[far].designs == 0
    # The longest stroke with a crank of 50 mm, as an arc at the radius of the sley, is far below half a metre.
    assert 0.085 < tallies[far].nearest < 0.5
    text = failing_text(found.tallies)
    assert text == f"none has sley stroke at least 500 mm (the nearest has {1e3 * tallies[far].nearest:.4g})"
    # Each limit can be met, but not both.
    narrow = (Limit("sley_stroke_m", True, 0.09), Limit("sley_stroke_m", False, 0.08))
    found = search(design, Task(RANGES, GOALS, narrow, 2), seconds=math.inf, generations=10)
    assert not found.front and all(one.designs for one in found.tallies)
    fewest = min(found.tallies, key=lambda one: one.designs)
    assert failing_text(found.tallies).startswith(f"{fewest.designs} have sley stroke at ")
