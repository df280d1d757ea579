"""Four-bars through points and along curves, checked on the machines built from them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from textile_twin_core.errors import SceneError
from textile_twin_core.synthesis import FourBarDesign, fit_curve, through_points
from textile_twin_core.synthesis.turn import over_turn

POINTS = [(0.0, 0.0), (0.1, 0.02), (0.15, 0.1), (0.1, 0.16), (0.02, 0.12)]
KNOWN = FourBarDesign((0.0, 0.0), (0.3, 0.05), 0.08, 0.25, 0.22, (0.15, 0.1), "left")


def machine_curve(design: FourBarDesign, theta: np.ndarray) -> np.ndarray:
    """The coupler point by the exact mechanism, which shares no code with the synthesis."""
    model = design.machine().model
    x, y = over_turn([model.output("point_P_x_m"), model.output("point_P_y_m")], theta)
    return x + 1j * y


@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_machine_passes_the_points_in_their_order(count: int) -> None:
    found = through_points(POINTS[:count], seed=3)
    assert found and [d.four_bar.mu_min_rad for d in found] == sorted(
        (d.four_bar.mu_min_rad for d in found), reverse=True
    )
    for design in found:
        machine = design.four_bar.machine()
        (close,) = machine.closeness
        assert close.grashof == "crank-rocker"
        assert close.transmission_angle_rad == pytest.approx(design.four_bar.mu_min_rad, abs=1e-9)
        passed = machine_curve(design.four_bar, np.array(design.angles_rad))
        assert np.abs(passed - [complex(*p) for p in POINTS[:count]]).max() < 1e-12
        assert design.miss_m < 1e-12
        steps = np.mod(np.diff([*design.angles_rad, design.angles_rad[0]]), 2.0 * math.pi)
        turns = min(steps.sum(), (2.0 * math.pi * count - steps.sum())) / (2.0 * math.pi)
        assert turns == pytest.approx(1.0, abs=1e-9)


def test_same_seed_gives_the_same_designs() -> None:
    assert through_points(POINTS, seed=5) == through_points(POINTS, seed=5)
    assert through_points(POINTS, seed=5)[0] != through_points(POINTS, seed=6)[0]


def test_points_of_a_known_linkage_and_far_from_the_origin() -> None:
    passed = KNOWN.points(np.array([0.3, 1.2, 2.6, 3.9, 5.0])) + (40.0 - 30.0j)
    best = through_points([(z.real, z.imag) for z in passed], seed=1)[0]
    assert best.miss_m < 1e-10


def test_limit_of_the_transmission_angle_holds() -> None:
    found = through_points(POINTS[:3], seed=0, smallest_mu_rad=math.radians(45.0))
    assert all(design.four_bar.mu_min_rad >= math.radians(45.0) for design in found)


@pytest.mark.slow
def test_curve_of_a_known_linkage_is_found_again() -> None:
    """The curve agrees to half a percent of its size; lengths are not compared, since similar curves exist."""
    targets = KNOWN.points(np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False) + 0.01)
    seen: list[float] = []
    found = fit_curve(
        [(z.real, z.imag) for z in targets], seed=0, generations=200, progress=lambda share: bool(seen.append(share))
    )
    size = np.abs(targets - targets.mean()).max()
    assert found.rms_m < 0.01 * size and not found.stopped
    assert seen[-1] <= 1.0 and seen == sorted(seen)
    fine = machine_curve(found.four_bar, np.linspace(0.0, 2.0 * math.pi, 7201))
    away = np.abs(fine[None, :] - targets[:, None]).min(axis=1)
    assert math.sqrt((away**2).mean()) == pytest.approx(found.rms_m, rel=1e-6)


def test_search_stops_on_request() -> None:
    found = fit_curve(POINTS + [(0.0, 0.06)], progress=lambda share: True)
    assert found.stopped and found.designs < 3000
    assert found.four_bar.machine().closeness[0].grashof == "crank-rocker"


@pytest.mark.parametrize(
    ("points", "says"),
    [
        ([(0.0, 0.0)], "2 to 5 points, not 1"),
        ([(0.0, float(k)) for k in range(6)], "for more fit a curve"),
        ([(1.0, 1.0), (1.0, 1.0)], "one and the same"),
        ([(1.0, 1.0), (math.nan, 1.0)], "finite"),
    ],
)
def test_points_that_cannot_be_passed(points: list[tuple[float, float]], says: str) -> None:
    with pytest.raises(SceneError, match=says):
        through_points(points)


def test_curves_that_cannot_be_fitted() -> None:
    for points, says in (([(0.0, 0.0)] * 5, "6 to 500"), ([(1.0, 2.0)] * 7, "one and the same")):
        with pytest.raises(SceneError, match=says):
            fit_curve(points)


def test_limit_of_the_transmission_angle_holds_or_refused() -> None:
    points = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.5, 0.5), (0.2, 0.3)]
    found = fit_curve(points, smallest_mu_rad=math.radians(60.0), generations=10)
    assert found.four_bar.mu_min_rad >= math.radians(60.0)
    with pytest.raises(SceneError, match="at least 91 deg was found"):
        fit_curve(points, smallest_mu_rad=math.radians(91.0), generations=10)
