"""Linkages near change points, toggles and extreme proportions, against 60 digits from the same doubles."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import mpmath as mp
import numpy as np
import pytest

from tests.compile_at_once import compile_at_once
from tests.generators.planar_truth import four_bar
from tests.mechanism.planar_cases import FourBarCase, SliderCase, by_every_back_end
from textile_twin_core.expression import substitute, variable
from textile_twin_core.expression.loop import Loop
from textile_twin_core.mechanism import THETA, Crank, EllipticGearPair, Linkage, RRRDyad, check_assembly

CASES = json.loads((Path(__file__).parents[1] / "data" / "hard_cases.json").read_text())
EPS = 2.0**-53


def given(kind: str) -> list[Any]:
    return [pytest.param(case, id=case["name"]) for case in CASES if case["kind"] == kind]


def declared_four_bar(case: dict[str, Any]) -> FourBarCase:
    assert case["ground_angle"] == "0"
    lengths = (float(case[name]) for name in ("l1", "l2", "l3"))
    return FourBarCase(*lengths, (float(case["ground"]), 0.0), float(case["theta1"]), case["branch"] == "left")


@pytest.mark.parametrize("case", given("fourbar"))
def test_given_four_bars(case: dict[str, Any]) -> None:
    """Change points to 1e-14; at a toggle the reported distance from it explains the error."""
    ours = declared_four_bar(case)
    links = ours.linkage().solved.links
    quantities = {
        "p2": links["l2"].first,
        "p3": links["l3"].first,
        "q2": links["l2"].second,
        "q3": links["l3"].second,
    }
    allowed = 1e-14
    if "toggle" in case["note"]:
        (closeness,) = check_assembly(replace(ours.linkage(), range_rad=(ours.theta - 0.2, ours.theta)))
        assert closeness.grashof == "triple-rocker"
        assert 0.0 < closeness.distance_m < 1e-8
        allowed = 4.0 * EPS * ours.theta * ours.l1 / closeness.distance_m
    for values in by_every_back_end(list(quantities.values()), ours.theta):
        for name, value in zip(quantities, values, strict=True):
            expected = mp.mpf(case["expected"][name])
            assert abs(value - expected) < allowed * abs(expected), name
    for what, error, by_rounding in ours.errors():
        assert error < 1e-14 + 8.0 * by_rounding, what


@pytest.mark.parametrize("case", given("slider_crank"))
def test_given_slider_cranks(case: dict[str, Any]) -> None:
    ours = SliderCase(float(case["r"]), float(case["l"]), (0.0, float(case["e"])), (1.0, 0.0), float(case["theta1"]))
    end = ours.linkage().solved.points["B"]
    for values in by_every_back_end([end.position.x, end.first.x, end.second.x], ours.theta):
        for name, value in zip(("x", "dx", "d2x"), values, strict=True):
            expected = mp.mpf(case["expected"][name])
            by_angle = 0.0 if name == "dx" else 4.0 * EPS * ours.crank  # of x and d2x, which vanish at the toggle
            assert abs(value - expected) < 2e-15 * abs(expected) + by_angle, name


def test_compiled_they_hold_too() -> None:
    """All slider-cranks in one compiled loop, each with an angle of its own."""
    cases = [case for case in CASES if case["kind"] == "slider_crank"]
    sizes = [[float(case[name]) for name in ("r", "l", "e", "theta1")] for case in cases]
    expressions = []
    for k, (r, l, e, theta) in enumerate(sizes):
        end = SliderCase(r, l, (0.0, e), (1.0, 0.0), theta).linkage().solved.points["B"]
        expressions += substitute([end.position.x, end.first.x, end.second.x], {THETA: variable(f"theta{k}")})
    loop, found = Loop(expressions, [f"theta{k}" for k in range(len(cases))]), np.empty((len(expressions), 9))
    compile_at_once(loop)
    loop([np.full(9, theta) for *_, theta in sizes], list(found))
    for k, (case, (r, *_)) in enumerate(zip(cases, sizes, strict=True)):
        for name, value in zip(("x", "dx", "d2x"), found[3 * k :, 4], strict=False):
            expected = mp.mpf(case["expected"][name])
            by_angle = 0.0 if name == "dx" else 4.0 * EPS * r
            assert abs(mp.mpf(float(value)) - expected) < 2e-15 * abs(expected) + by_angle, name


# crank, coupler, rocker, ground
PROPORTIONS = {
    "stretched change point": (1.0, 2.0, 2.0, 3.0),
    "stretched change point, unequal": (1.0, 2.5, 1.5, 3.0),
    "folded change point": (3.0, 1.5, 2.5, 2.0),
    "parallelogram lengths": (1.0, 2.0, 1.0, 2.0),
    "kite on the crank": (1.0, 1.0, 2.0, 2.0),
    "kite on the ground": (1.0, 3.0, 3.0, 1.0),
    "1e-9 from a stretched change point": (1.0, 2.0, 2.0, 3.0 - 1e-9),
    "1e-13 from a stretched change point": (1.0, 2.0, 2.0, 3.0 - 1e-13),
    "1e-10 beyond a parallelogram": (1.0, 2.0, 1.0, 2.0 + 1e-10),
    "1e-7 short of a parallelogram": (1.0, 2.0, 1.0 + 1e-7, 2.0),
    "nearly a kite on the ground": (1.0, 3.0, 3.0 + 1e-6, 1.0 + 1e-5),
    "rhombus": (1.0, 1.0, 1.0, 1.0),
    "tiny crank": (1e-7, 2.0, 1.5, 1.2),
    "long rods": (1.0, 1e6, 1e6, 3.0),
    "long rocker and ground": (1.0, 1.5, 1e6, 1e6),
    "crank-rocker": (0.3, 1.1, 0.9, 1.2),
    "drag-link": (1.1, 0.9, 1.2, 0.3),
    "triple-rocker": (2.0, 2.0, 1.5, 3.0),
}
DISTANCES = [*(sign * 10.0**-k for k in (1, 4, 8, 11) for sign in (1.0, -1.0)), 1.0]


def four_bars(proportions: tuple[float, ...], ground_angle: float, turns: float) -> list[FourBarCase]:
    """Every side, near both ends of the ground line; those that do not close are left out."""
    l1, l2, l3, g = proportions
    ground = (g, 0.0) if ground_angle == 0.0 else (g * math.cos(ground_angle), g * math.sin(ground_angle))
    cases = []
    for end, distance, left in itertools.product((0.0, math.pi), DISTANCES, (True, False)):
        theta = turns + ground_angle + end + distance
        case = FourBarCase(l1, l2, l3, ground, theta, left)
        with mp.workdps(60):
            x, y = (mp.mpf(v) for v in ground)
            reach = abs(mp.mpc(x, y) - l1 * mp.expj(mp.mpf(theta)))
            # within 1e-12 of opening the next double may not close
            if mp.mpf(l2) + l3 > reach * (1 + mp.mpf("1e-24")) and reach > abs(mp.mpf(l2) - l3) * (1 + mp.mpf("1e-24")):
                cases.append(case)
    return cases


@pytest.mark.parametrize("ground_angle", [0.0, 2.3])
@pytest.mark.parametrize("name", PROPORTIONS)
def test_four_bars_of_every_kind(name: str, ground_angle: float) -> None:
    """Errors stay below 1e-14, apart from the effect of rounding the angle by 1.1e-16 rad."""
    cases = four_bars(PROPORTIONS[name], ground_angle, 0.0)
    assert cases
    for case in cases:
        for what, error, by_rounding in case.errors():
            assert error < 1e-14 + 12.0 * by_rounding, (case, what)


@pytest.mark.parametrize("turns", [-1e6, 1e9])
def test_four_bars_after_many_turns(turns: float) -> None:
    for name in ("crank-rocker", "drag-link", "stretched change point"):
        for case in four_bars(PROPORTIONS[name], 0.4, turns):
            for what, error, by_rounding in case.errors():
                assert error < 1e-14 + 12.0 * by_rounding, (case, what)


@pytest.mark.parametrize("ground_angle", [0.0, 0.9])
@pytest.mark.parametrize(
    ("proportions", "branch"),
    [
        ((1.0, 2.0, 1.0, 2.0), "left_passing"),
        ((1.0, 2.0, 1.0, 2.0), "right_passing"),
        ((1.0, 1.0, 2.0, 2.0), "left_passing"),
        ((1.0, 1.0, 1.0, 1.0), "left_passing"),
        ((0.25, 0.75, 0.25, 0.75), "right_passing"),
    ],
)
def test_passing_change_points_keeps_every_digit(
    proportions: tuple[float, ...], branch: str, ground_angle: float
) -> None:
    """The linkage agrees with 60 digits on both sides of a change point, with its side there."""
    l1, l2, l3, g = proportions
    for end, distance in itertools.product((0.0, math.pi, 2.0 * math.pi, -math.pi), DISTANCES):
        theta = end + distance
        above = math.sin(theta) > 0.0
        left = above == branch.startswith("left")
        case = FourBarCase(l1, l2, l3, (g, 0.0), theta, left)
        truth = case.truth()
        ground = (g * math.cos(ground_angle), g * math.sin(ground_angle))
        turned = FourBarCase(l1, l2, l3, ground, theta + ground_angle, left)
        links = turned.linkage(branch).solved.links
        for p2, p3, q2, q3 in by_every_back_end(
            [links["l2"].first, links["l3"].first, links["l2"].second, links["l3"].second], turned.theta
        ):
            assert abs(p2 - truth["p2"]) + abs(p3 - truth["p3"]) < 4e-15 * 3.0
            assert abs(q2 - truth["q2"]) + abs(q3 - truth["q3"]) < 1e-14 * 3.0


def test_a_passing_branch_is_smooth_at_the_change_point_itself() -> None:
    for branch, speed in (("left_passing", 1.0), ("right_passing", -3.0)):
        links = FourBarCase(1.0, 2.0, 1.0, (2.0, 0.0), 0.0, True).linkage(branch).solved.links
        for p3, q3 in by_every_back_end([links["l3"].first, links["l3"].second], 0.0):
            assert (p3, q3) == (speed, 0.0)


SLIDERS = {
    "isosceles": (1.0, 1.0, 0.0),
    "isosceles, offset": (1.0, 1.25, 0.25),
    "1e-9 longer than the crank": (1.0, 1.0 + 1e-9, 0.0),
    "long rod": (0.015, 15000.0, 0.0),
    "tiny crank": (1e-6, 0.3, 0.2),
    "offset guide": (0.05, 0.2, -0.12),
    "nearly out of reach": (0.05, 0.2, 0.15 - 1e-10),
}


@pytest.mark.parametrize("direction", [(0.0, -1.0), (3.0, 4.0), (-0.3, 0.2)])
@pytest.mark.parametrize("name", SLIDERS)
def test_sliders_of_every_kind(name: str, direction: tuple[float, float]) -> None:
    crank, rod, offset = SLIDERS[name]
    norm = math.hypot(*direction)
    guide = (-offset * direction[1] / norm + 0.7 * direction[0], offset * direction[0] / norm + 0.7 * direction[1])
    turn = math.atan2(direction[1], direction[0])
    checked = 0
    for quarter, distance in itertools.product(range(4), DISTANCES):
        case = SliderCase(crank, rod, guide, direction, turn + quarter * math.pi / 2 + distance)
        with mp.workdps(60):
            angle = mp.mpf(case.theta) - mp.atan2(*reversed([mp.mpf(v) for v in direction]))
            rise = (direction[0] * mp.mpf(guide[1]) - direction[1] * mp.mpf(guide[0])) / mp.sqrt(
                mp.mpf(direction[0]) ** 2 + mp.mpf(direction[1]) ** 2
            )
            if abs(rise - crank * mp.sin(angle)) >= rod:
                continue
        for what, error, by_rounding in case.errors():
            assert error < 4e-15 * max(1.0, norm) + 12.0 * by_rounding, (case, what)
        checked += 1
    assert checked > 10


def test_cranks_on_gears() -> None:
    """A crank on the driven gear of an elliptic pair, near its change point: chain rule in 60 digits."""
    pair = EllipticGearPair("g1", "g2", "O", "A", ("F", "G"), axis_ratio=0.8, phase_rad=0.3)
    crank = Crank("l1", at="A", end="B", length_m=1.0, phase_rad=0.0, driven_by="g2")
    dyad = RRRDyad("l2", "l3", "B", "D", "E", (2.0, 2.0), "left")
    linkage = Linkage({"O": (0.0, 0.0), "A": (2.0, 0.0), "D": (5.0, 0.0)}, (pair, crank, dyad))
    motion = linkage.solved
    e = mp.sqrt((1 - mp.mpf(0.8)) * (1 + mp.mpf(0.8)))

    def driven(theta: Any) -> Any:
        lead = theta + mp.mpf(0.3)
        return mp.pi - 2 * mp.atan2((1 - e) * mp.sin(lead / 2), (1 + e) * mp.cos(lead / 2))

    expressions = [motion.links["l3"].first, motion.links["l3"].second]
    with mp.workdps(60):
        e = mp.sqrt((1 - mp.mpf(0.8)) * (1 + mp.mpf(0.8)))
        for theta in (0.1, 1.0, 2.0, 2.7, 2.8):
            first, second = mp.diff(driven, theta), mp.diff(driven, theta, 2)
            angle = driven(mp.mpf(theta))
            rates = four_bar(1.0, 2.0, 2.0, 3.0, angle, left=True, digits=60)
            speed = rates["p3"] * first
            bend = rates["q3"] * first**2 + rates["p3"] * second
            for p, q in by_every_back_end(expressions, theta):
                assert abs(p - speed) < 1e-13 * (abs(speed) + 1)
                assert abs(q - bend) < 1e-12 * (abs(bend) + 1)


def test_arrays_across_a_change_point_hold_every_digit() -> None:
    """Ten thousand angles, denser and denser towards the change point, in one call."""
    case = FourBarCase(1.0, 2.5, 1.5, (3.0, 0.0), 0.0, True)
    theta = math.pi - np.logspace(-12, 0.3, 10_000)
    values = np.empty_like(theta)
    loop = Loop([case.linkage().solved.links["l3"].first], ["theta"])
    compile_at_once(loop)
    loop([theta], [values])
    for i in range(0, theta.size, 500):
        exact = FourBarCase(1.0, 2.5, 1.5, (3.0, 0.0), float(theta[i]), True).truth()["p3"]
        assert abs(values[i] - exact) < 1e-14 * abs(exact)
