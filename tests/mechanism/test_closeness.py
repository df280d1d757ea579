"""Closeness to change points and toggles, transmission angles and Grashof's class; impossible linkages."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mpmath as mp
import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.dynamics import Body
from textile_twin_core.expression import cos
from textile_twin_core.machine import Machine
from textile_twin_core.mechanism import THETA as ANGLE
from textile_twin_core.mechanism import Arc, Crank, RigidArm, RRPDyad, RRRDyad, Travel
from textile_twin_core.mechanism.extremes import smallest_value

THETA = np.linspace(0.0, 2.0 * math.pi, 20001)


def four_bar(
    l1: float, l2: float, l3: float, g: float, branch: Any = "left", angle: float = 0.0, **more: Any
) -> Machine:
    ground = (g * math.cos(angle), g * math.sin(angle))
    groups = (Crank("l1", at="O", end="A", length_m=l1), RRRDyad("l2", "l3", "A", "C", "B", (l2, l3), branch))
    return Machine("four-bar", {"O": (0.0, 0.0), "C": ground}, groups, (Body("l2", 1.0, 0.1),), **more)


def slider(crank: float, rod: float, offset: float, **more: Any) -> Machine:
    dyad = RRPDyad("rod", "slider", "A", "B", "T", (rod, 0.1), (0.0, offset), (1.0, 0.0))
    return Machine("slider", {"O": (0.0, 0.0)}, (Crank("l1", at="O", end="A", length_m=crank), dyad), **more)


@pytest.mark.parametrize(
    ("lengths", "grashof"),
    [
        ((0.3, 1.1, 0.9, 1.2), "crank-rocker"),
        ((1.1, 0.9, 1.2, 0.3), "double-crank"),
        ((1.0, 2.0, 2.0, 3.0), "change point"),
        ((0.1 + 0.2, 0.7, 0.6, 0.4), "change point"),
        ((1.0, 2.0, 1.0, 2.0), "change point"),
    ],
)
def test_grashof_of_full_turns(lengths: tuple[float, ...], grashof: str) -> None:
    assert four_bar(*lengths).closeness[0].grashof == grashof


@pytest.mark.parametrize(
    ("lengths", "range_rad", "grashof"),
    [
        ((0.9, 1.1, 0.3, 1.2), (0.8, 1.4), "rocker-crank"),
        ((1.1, 0.3, 1.2, 0.9), (1.0, 1.6), "double-rocker"),
        ((2.0, 2.0, 1.5, 3.0), (0.7, 1.4), "triple-rocker"),
    ],
)
def test_grashof_of_part_turns(lengths: tuple[float, ...], range_rad: tuple[float, float], grashof: str) -> None:
    assert four_bar(*lengths, range_rad=range_rad).closeness[0].grashof == grashof


@pytest.mark.parametrize(
    ("lengths", "angle"), [((0.3, 1.1, 0.9, 1.2), 0.4), ((1.1, 0.9, 1.2, 0.3), -2.0), ((0.2, 0.6, 0.6, 0.7), 3.0)]
)
def test_transmission_angles_and_distance_against_a_fine_grid(lengths: tuple[float, ...], angle: float) -> None:
    machine = four_bar(*lengths, angle=angle)
    names = ["theta_2_rad", "theta_3_rad", "point_A_x_m", "point_A_y_m"]
    v = ttc.compile(machine, names, method="exact").evaluate(THETA)
    l2, l3 = lengths[1:3]
    mu = np.arccos(np.cos(v["theta_3_rad"] - v["theta_2_rad"]))
    (c,) = machine.closeness
    assert c.transmission_range_rad == pytest.approx((mu.min(), mu.max()), abs=1e-6)
    assert c.transmission_angle_rad == pytest.approx(min(mu.min(), math.pi - mu.max()), abs=1e-6)
    x, y = machine.points["C"]
    apart = np.hypot(v["point_A_x_m"] - x, v["point_A_y_m"] - y)
    distance = np.minimum(l2 + l3 - apart, apart - abs(l2 - l3))
    assert c.distance_m == pytest.approx(distance.min(), abs=1e-7)
    assert c.margin > 0.0


def test_the_published_crank_rocker() -> None:
    """Topalbekiroglu and Celik 2010: the chosen design's transmission angle is at least 67.25 deg."""
    (c,) = ttc.machines.handloom_beatup().closeness
    at_extremes = [
        math.acos((0.2007**2 + 0.23082**2 - (0.3 + s * 0.0597) ** 2) / (2 * 0.2007 * 0.23082)) for s in (-1, 1)
    ]
    assert c.transmission_range_rad == pytest.approx(tuple(at_extremes), abs=1e-12)
    assert math.degrees(c.transmission_angle_rad) == pytest.approx(67.25, abs=0.01)


def test_slider_cranks() -> None:
    machine = slider(0.05, 0.2, 0.12)
    (c,) = machine.closeness
    offset = 0.05 * np.sin(THETA) - 0.12
    mu = np.arccos(-offset / 0.2)
    assert c.transmission_range_rad == pytest.approx((mu.min(), mu.max()), abs=1e-12)
    assert c.distance_m == pytest.approx(0.03, abs=1e-15)
    assert c.theta_rad == pytest.approx(1.5 * math.pi, abs=1e-6)
    assert c.grashof is None


def test_a_change_point_is_reported_with_its_angle() -> None:
    (c,) = four_bar(1.0, 2.5, 1.5, 3.0, angle=0.5).closeness
    assert c.distance_m < 1e-12
    assert c.theta_rad == pytest.approx(math.pi + 0.5, abs=1e-5)
    assert c.transmission_range_rad[1] == pytest.approx(math.pi, abs=1e-5)
    (near,) = four_bar(1.0, 2.5, 1.5, 3.0 - 1e-9).closeness
    assert near.distance_m == pytest.approx(1e-9, rel=1e-6)


def opening(l1: float, l2: float, l3: float, g: float) -> float:
    """Crank angle at which coupler and rocker are stretched, in degrees."""
    return math.degrees(math.acos((l1**2 + g**2 - (l2 + l3) ** 2) / (2 * l1 * g)))


REFUSED: dict[str, tuple[Callable[[], object], str]] = {
    "opens": (
        lambda: four_bar(2.0, 2.0, 1.5, 3.0),
        rf"'l2-l3' cannot close: it opens at a shaft angle of {opening(2.0, 2.0, 1.5, 3.0):.4f} deg",
    ),
    "opens between two samples": (
        lambda: four_bar(1.0, 3.0, 3.0, 5.0 + 1e-9, angle=0.5),
        rf"it opens at a shaft angle of {opening(1.0, 3.0, 3.0, 5.0 + 1e-9) + math.degrees(0.5):.4f} deg",
    ),
    "never closes": (lambda: four_bar(0.1, 0.2, 0.2, 3.0), "cannot close at any shaft angle: .* too short"),
    "folded": (lambda: four_bar(0.1, 3.0, 0.5, 1.0), "folded and differ too much"),
    "slider too far": (
        lambda: slider(0.1, 0.2, 0.15),
        r"opens at a shaft angle of \d+\.\d{4} deg where rod 'rod'",
    ),
    "opens within the range": (lambda: four_bar(2.0, 2.0, 1.5, 3.0, range_rad=(0.7, 1.6)), r"opens at .* 86\.41"),
    "zero length": (lambda: four_bar(0.0, 1.0, 1.0, 1.0), "'l1': length_m must be a positive length"),
    "rocker on the crank's axis": (
        lambda: four_bar(0.3, 1.1, 0.9, 0.0),
        r"dyad 'l2-l3': the axis about which from 'A' turns and ground 'C' coincide at \(0, 0\) m",
    ),
    "one point twice": (
        lambda: ttc.Machine("m", {"O": (0.0, 0.0)}, (Crank("l1", "O", "A", 0.1), RRRDyad(*"bcAAB", (0.2, 0.2)))),
        "dyad 'b-c': from and ground are one point, 'A'",
    ),
    "two points in one place": (
        lambda: ttc.Machine("m", {"C": (1.0, 2.0), "D": (1.0, 2.0)}, (RRRDyad(*"bcCDB", (0.2, 0.2)),)),
        r"dyad 'b-c': from 'C' and ground 'D' coincide at \(1, 2\) m",
    ),
    "negative length": (lambda: four_bar(0.3, -1.0, 1.0, 1.0), "length of 'l2' must be a positive length"),
    "no number": (lambda: four_bar(0.3, math.nan, 1.0, 1.0), "length of 'l2' must be a positive length"),
    "infinite point": (lambda: four_bar(0.3, 1.0, 1.0, math.inf), "point 'C': x must be a finite number"),
    "negative mass": (lambda: Body("l1", -1.0), "mass_kg must be zero or positive"),
    "no such branch": (lambda: four_bar(0.3, 1.1, 0.9, 1.2, branch="up"), "branch must be one of left, right"),
    "no change point to pass": (
        lambda: four_bar(0.3, 1.1, 0.9, 1.2, branch="left_passing"),
        "crank, coupler, rocker and ground are 0.3, 1.1, 0.9 and 1.2 m: choose 'left' or 'right'",
    ),
    "one change point a turn": (
        lambda: four_bar(1.0, 2.5, 1.5, 3.0, branch="left_passing"),
        "links that come into one line twice a turn",
    ),
    "a kite that stands still": (lambda: four_bar(1.0, 1.0, 2.0, 2.0, branch="right_passing"), "rocker stands still"),
    "no crank to pass with": (
        lambda: Machine(
            "m",
            {"O": (0.0, 0.0), "C": (1.2, 0.0), "D": (2.0, 0.0)},
            (
                Crank("l1", at="O", end="A", length_m=0.3),
                RRRDyad("l2", "l3", "A", "C", "B", (1.1, 0.9), "left"),
                RRRDyad("l4", "l5", "B", "D", "E", (0.9, 0.9), "left_passing"),
            ),
        ),
        "needs a crank at 'B'",
    ),
    "unknown point": (
        lambda: Machine("m", {"O": (0.0, 0.0)}, (Crank("l1", at="P", end="A", length_m=0.3),)),
        "no point 'P' is known before it; known points: O",
    ),
    "unknown link": (
        lambda: Machine(
            "m",
            {"O": (0.0, 0.0)},
            (Crank("l1", at="O", end="A", length_m=0.3), RigidArm("arm", on="l2", end="B", length_m=0.1)),
        ),
        "no link 'l2' is known before it; known links: l1",
    ),
    "unknown shaft": (
        lambda: Machine("m", {"O": (0.0, 0.0)}, (Crank("l1", at="O", end="A", length_m=0.3, driven_by="gear"),)),
        "no shaft 'gear'; known shafts: main_shaft",
    ),
    "a point twice": (
        lambda: Machine("m", {"O": (0.0, 0.0), "A": (1.0, 0.0)}, (Crank("l1", at="O", end="A", length_m=0.3),)),
        "point 'A' exists already",
    ),
    "a crank on a moving point": (
        lambda: Machine(
            "m",
            {"O": (0.0, 0.0)},
            (Crank("l1", at="O", end="A", length_m=0.3), Crank("l2", at="A", end="B", length_m=0.3)),
        ),
        "point 'A' must be fixed to the ground",
    ),
    "no groups": (lambda: Machine("m", {"O": (0.0, 0.0)}, ()), "at least one group"),
    "no linkage": (lambda: four_bar(0.3, 1.1, 0.9, 1.2, linkages=()), "at least one linkage"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_bad_geometry_is_refused_when_the_machine_is_made(name: str) -> None:
    make, message = REFUSED[name]
    with pytest.raises(ttc.MachineError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


UNKNOWN: dict[str, tuple[dict[str, Any], str]] = {
    "body": ({"bodies": (Body("l7", 1.0),)}, "no such link; links: l1, l2, l3"),
    "measure of a point": ({"measures": (Travel("t", "Z", "O", (1.0, 0.0)),)}, "no point 'Z'"),
    "measure of a link": ({"measures": (Arc("a", "l7", 0.1),)}, "no link 'l7'"),
}


@pytest.mark.parametrize("name", UNKNOWN)
def test_unknown_names_outside_the_groups(name: str) -> None:
    changes, message = UNKNOWN[name]
    groups = (Crank("l1", at="O", end="A", length_m=0.3), RRRDyad("l2", "l3", "A", "C", "B", (1.1, 0.9)))
    with pytest.raises(ttc.MachineError, match=message):
        Machine("four-bar", {"O": (0.0, 0.0), "C": (1.2, 0.0)}, groups, **changes)


@pytest.mark.parametrize("shift", np.linspace(0.0, 2.0, 23).tolist())
@pytest.mark.parametrize("difference", [1e-9, 1e-6, -1e-6])
def test_of_minima_that_are_nearly_alike_the_smallest_is_found(shift: float, difference: float) -> None:
    """A grid cannot decide between several minima of a chain that nearly opens several times per turn."""
    _, found = smallest_value(cos(3.0 * ANGLE + shift) + difference * cos(ANGLE + 0.3), (0.0, 2.0 * math.pi))

    def exact(theta: Any) -> Any:
        return mp.cos(3 * theta + shift) + difference * mp.cos(theta + 0.3)

    starts = [((2 * k + 1) * math.pi - shift) / 3.0 for k in range(3)]
    turns = [mp.findroot(lambda t: mp.diff(exact, t), start) for start in starts]
    assert found == pytest.approx(float(min(exact(t) for t in turns)), abs=1e-15)
