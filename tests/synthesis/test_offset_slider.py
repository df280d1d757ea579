"""Slider-cranks from stroke and time ratio, against the motion of their machines."""

from __future__ import annotations

import math

import numpy as np
import pytest

from textile_twin_core.errors import SceneError
from textile_twin_core.synthesis import SliderCrankFamily, offset_slider, rotation_of_time_ratio


@pytest.mark.parametrize("time_ratio", [1.0, 1.1, 0.9, 1.3, 0.7])
@pytest.mark.parametrize("ratio", [None, 0.25, 0.45])
def test_machine_has_the_stroke_and_the_time_ratio(time_ratio: float, ratio: float | None) -> None:
    design = offset_slider(0.05, rotation_of_time_ratio(time_ratio), ratio)
    machine = design.machine()
    dead = {event.name: event.angle_rad for event in machine.events()}
    out_to_in = (dead["slider_smallest"] - dead["slider_largest"]) % (2.0 * math.pi)
    assert out_to_in / (2.0 * math.pi - out_to_in) == pytest.approx(time_ratio, rel=1e-9)
    position = machine.model.output("slider_position_m")
    from textile_twin_core.synthesis.turn import over_turn

    ends = over_turn([position], np.array([dead["slider_largest"], dead["slider_smallest"]]))[0]
    assert ends[0] - ends[1] == pytest.approx(0.05, rel=1e-12)
    assert machine.closeness[0].transmission_angle_rad == pytest.approx(design.mu_min_rad, abs=1e-12)


def test_in_line_is_the_textbook_case() -> None:
    design = offset_slider(0.08, math.pi, 0.4)
    assert design.offset_m == 0.0
    assert design.crank_m == pytest.approx(0.04, rel=1e-15) and design.rod_m == pytest.approx(0.1, rel=1e-15)
    assert design.mu_min_rad == pytest.approx(math.acos(0.4), rel=1e-15)


def test_family_ends_at_its_change_points() -> None:
    family = SliderCrankFamily(1.0, math.radians(20.0))
    low = family.at_ratio(family.smallest_ratio * (1.0 + 1e-9))
    high = family.at_ratio(1.0 - 1e-12)
    assert low.mu_min_rad < 1e-3 and high.mu_min_rad < 1e-3
    best = family.best_transmission()
    assert best is not None
    grid = np.linspace(family.smallest_ratio + 1e-9, 1.0 - 1e-9, 20001)
    assert best.mu_min_rad >= max(family.at_ratio(r).mu_min_rad for r in grid.tolist()) - 1e-12


@pytest.mark.parametrize(
    ("task", "says"),
    [
        ((0.0, math.pi, None), "stroke"),
        ((0.05, math.pi * 1.6, None), "between 90 and 270 deg"),
        ((0.05, math.radians(200.0), 0.01), "crank over rod"),
        ((0.05, math.pi, 1.0), "crank over rod"),
        ((math.nan, math.pi, None), "stroke"),
    ],
)
def test_impossible_tasks_are_refused(task: tuple[float, float, float | None], says: str) -> None:
    with pytest.raises(SceneError, match=says):
        offset_slider(*task)


def test_time_ratio_must_be_positive() -> None:
    for wrong in (0.0, -1.0, math.inf, math.nan):
        with pytest.raises(SceneError, match="time ratio"):
            rotation_of_time_ratio(wrong)
