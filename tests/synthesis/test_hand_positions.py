"""The rocker through three positions of the weaver's hand, and the loom by Khare and Dave's equations."""

from __future__ import annotations

import math

import numpy as np
import pytest

from textile_twin_core.errors import SceneError
from textile_twin_core.synthesis import BarSection, Tool, crank_rocker, crank_rocker_machine, rocker_through
from textile_twin_core.synthesis.turn import over_turn, shaft_angles


def on_circle(centre: complex, radius: float, degrees: float) -> tuple[float, float]:
    place = centre + radius * complex(math.cos(math.radians(degrees)), math.sin(math.radians(degrees)))
    return place.real, place.imag


@pytest.mark.parametrize(
    "degrees", [(100.0, 85.0, 70.0), (70.0, 80.0, 100.0), (-170.0, 175.0, 140.0), (10.0, 95.0, 170.0)]
)
def test_circle_through_three_positions(degrees: tuple[float, float, float]) -> None:
    centre, radius = 0.4 - 0.2j, 0.3001
    hand = rocker_through(*(on_circle(centre, radius, d) for d in degrees))
    assert complex(*hand.pivot_m) == pytest.approx(centre, abs=1e-14)
    assert hand.radius_m == pytest.approx(radius, abs=1e-14)
    turned = (math.radians(degrees[2] - degrees[0]) + math.pi) % (2.0 * math.pi) - math.pi
    assert hand.swing_rad == pytest.approx(abs(turned), abs=1e-13)
    assert hand.last_rad - hand.first_rad == pytest.approx(turned, abs=1e-13)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_beater_goes_from_the_first_to_the_last_position(sense: float) -> None:
    places = [on_circle(0.1 + 0.05j, 0.3001, 90.0 + sense * d) for d in (-15.0, 2.0, 15.0)]
    hand = rocker_through(*places)
    assert hand.swing_rad == pytest.approx(math.radians(30.0), abs=1e-13)
    best = crank_rocker(hand.swing_rad, math.pi).best
    assert best is not None and math.degrees(best.beta_rad) == pytest.approx(48.0, abs=1e-9)
    machine = crank_rocker_machine(best.scaled(0.3), tool=Tool(hand.radius_m, 2.5), hand=hand)
    dead = {event.name: event.angle_rad for event in machine.events()}
    at = np.array([dead["beater_smallest"], dead["beater_largest"]])
    x, y = over_turn([machine.model.output(f"point_E_{k}_m") for k in "xy"], at)
    assert [x[0], y[0]] == pytest.approx(places[0], abs=1e-12)
    assert [x[1], y[1]] == pytest.approx(places[2], abs=1e-12)


def test_chosen_design_has_the_masses_that_the_paper_prints() -> None:
    best = crank_rocker(math.radians(30.0), math.pi).best
    assert best is not None
    machine = crank_rocker_machine(best.scaled(0.3), BarSection(7210.0, 0.030, 0.010), Tool(0.3001, 2.5))
    masses = {body.on: body.mass_kg for body in machine.bodies[:3]}
    assert [round(masses[k], 3) for k in ("l1", "l2", "l4")] == [0.129, 0.434, 0.649]
    inertias = [body.inertia_kgm2 for body in machine.bodies[:3]]
    assert inertias == pytest.approx([4.80e-5, 1.5e-3, 4.9e-3], rel=1e-2)
    acceleration = over_turn([machine.model.output("beater_acceleration_m_s2")], shaft_angles(), 15.5)[0]
    assert np.abs(acceleration).max() == pytest.approx(25.43, rel=2e-3)  # printed lengths are rounded to 0.1 mm


@pytest.mark.parametrize(
    ("places", "says"),
    [
        ([(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)], "one line"),
        ([(0.0, 0.0), (0.0, 0.0), (1.0, 2.0)], "one line"),
        ([(1.0, 0.0), (-1.0, 0.01), (0.9, -0.4)], "less than 180"),
        ([(1.0, 0.0), (math.nan, 1.0), (-1.0, 0.0)], "finite"),
    ],
)
def test_positions_without_a_rocker(places: list[tuple[float, float]], says: str) -> None:
    with pytest.raises(SceneError, match=says):
        rocker_through(*places)
