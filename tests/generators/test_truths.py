"""The exact numbers against independently computed cases and the papers' printed values."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mpmath as mp
import numpy as np
import pytest

from tests.generators.planar_truth import four_bar, slider_crank
from tests.generators.tufting_rig import tufting_multibody
from tests.generators.tufting_truth import truth

CASES: list[dict[str, Any]] = json.loads((Path(__file__).parents[1] / "data" / "hard_cases.json").read_text())
OMEGA = 16.0 * math.pi / 3.0
NAMES = {"tau": "balancing_torque_Nm", "N": "reaction_guide_N", "w3": "omega_3_rad_s", "a3": "alpha_3_rad_s2"}
NAMES |= {"th3": "theta_3_rad"} | {f"{p}{a}": f"reaction_{p}_{a}_N" for p in "OABCDE" for a in "xy"}


@pytest.fixture(autouse=True)
def fifty_digits() -> Iterator[None]:
    with mp.workdps(50):
        yield


def cases(kind: str) -> list[Any]:
    return [pytest.param(case, id=case["name"]) for case in CASES if case["kind"] == kind]


def assert_digits(found: Any, printed: str, digits: int = 28) -> None:
    expected = mp.mpf(printed)
    assert abs(found - expected) <= mp.mpf(10) ** -digits * abs(expected)


@pytest.mark.parametrize("case", cases("fourbar"))
def test_four_bar_cases(case: dict[str, Any]) -> None:
    sizes = [float(case[name]) for name in ("l1", "l2", "l3", "ground", "theta1")]
    found = four_bar(*sizes, ground_angle=float(case["ground_angle"]), left=case["branch"] == "left", digits=70)
    for name, printed in case["expected"].items():
        assert_digits(found[name], printed)


@pytest.mark.parametrize("case", cases("slider_crank"))
def test_slider_crank_cases(case: dict[str, Any]) -> None:
    found = slider_crank(*(float(case[name]) for name in ("r", "l", "e", "theta1")), digits=70)
    for name, printed in case["expected"].items():
        assert_digits(found[name], printed)


@pytest.mark.parametrize("case", cases("tufting"))
def test_tufting_cases(case: dict[str, Any]) -> None:
    found = truth(float(case["theta1"]), float(case["omega"]), float(case["alpha"]))
    expected = dict(case["expected"])
    assert_digits(found["point_E_y_m"], expected.pop("y"))
    assert_digits(-found["needle_velocity_m_s"], expected.pop("v"))
    assert_digits(-found["needle_acceleration_m_s2"], expected.pop("a"))
    friction = abs(found["torque_load_Nm"])
    assert (friction > 0) == (float(expected.pop("Fr")) > 0)
    for name, printed in expected.items():
        assert_digits(found[NAMES[name]], printed)


def test_both_torque_routes_agree() -> None:
    for k in range(24):
        found = truth(k * math.pi / 12.0 + 0.01, OMEGA, 35.0 * math.cos(k))
        gap = found["balancing_torque_Nm"] - found["balancing_torque_newton_euler_Nm"]
        assert abs(gap) < mp.mpf(10) ** -45


def turn(samples: int, reactions: bool) -> dict[str, np.ndarray[Any, Any]]:
    angles = (2.0 * math.pi * k / samples for k in range(samples))
    rows = [truth(angle, OMEGA, 0.0, digits=20, reactions=reactions) for angle in angles]
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def test_printed_ranges_and_magnitudes() -> None:
    """Ranges of the angles, stroke and magnitudes of the torque over a turn at 160 rpm."""
    found = turn(720, reactions=False)
    degrees = {k: np.degrees(found[f"theta_{k}_rad"]) for k in (2, 3, 4, 5)}
    ranges = {2: (101.7089, 114.2518), 3: (184.3222, 199.3870), 4: (-7.6778, 7.3870), 5: (257.9753, 258.5218)}
    for k, (low, high) in ranges.items():
        assert degrees[k].min() == pytest.approx(low, abs=2e-4)
        assert degrees[k].max() == pytest.approx(high, abs=2e-4)
    assert np.ptp(found["needle_position_m"]) == pytest.approx(0.0327884, abs=2e-7)
    limits = {
        "equivalent_inertia_kgm2": (5.0444e-3, 6.5168e-3),
        "torque_inertial_Nm": (-0.234, 0.211),
        "torque_gravity_Nm": (-0.559, 0.553),
        "balancing_torque_Nm": (-0.601, 17.2786),
    }
    for name, (low, high) in limits.items():
        assert found[name].min() == pytest.approx(low, rel=2e-3)
        assert found[name].max() == pytest.approx(high, rel=2e-3)


@pytest.mark.slow
def test_largest_forces() -> None:
    """Torque on the driven shaft and bearing forces, largest at entry or near the lowest point."""
    found = turn(180, reactions=True)
    assert np.abs(found["driven_shaft_torque_Nm"]).max() == pytest.approx(132.4, abs=0.1)
    assert np.hypot(found["reaction_C_x_N"], found["reaction_C_y_N"]).max() == pytest.approx(2197.0, abs=1.0)
    assert np.hypot(found["reaction_O_x_N"], found["reaction_O_y_N"]).max() == pytest.approx(1167.0, abs=1.0)


@pytest.mark.parametrize(
    ("angle", "name", "level"),
    [
        (0.38312100023839724, "needle_position_m", "0.55784"),
        (3.3846508836082833, "needle_position_m", "0.55784"),
        (1.8670926893606904, "needle_velocity_m_s", "0"),
        (5.0305703445016116, "needle_velocity_m_s", "0"),
    ],
)
def test_events(angle: float, name: str, level: str) -> None:
    """Entry, exit and turning points of the needle lie within one unit in the last place of the doubles."""
    step = math.ulp(angle)
    before, after = (truth(angle + sign * step, OMEGA, 0.0, reactions=False)[name] for sign in (-1, 1))
    assert (before - mp.mpf(level)) * (after - mp.mpf(level)) < 0


def test_multibody_of_the_recordings_agrees() -> None:
    """Redundant coordinates, behind the recordings, give the inertia, weight and needle of the loops."""
    system = tufting_multibody()
    angles = np.linspace(0.0, 6.2, 11)
    state = system.turn(angles)
    inertia, half_slope = system.inertia(state)
    gravity = system.gravity_torque(state)
    for k, angle in enumerate(angles):
        found = truth(float(angle), 1.0, 0.0, digits=30, reactions=False)
        assert inertia[k] == pytest.approx(float(found["equivalent_inertia_kgm2"]), rel=1e-12)
        assert half_slope[k] == pytest.approx(float(found["torque_inertial_Nm"]), abs=1e-14)
        assert gravity[k] == pytest.approx(float(found["torque_gravity_Nm"]), abs=1e-12)
        assert state.q[k, 16] - 0.220 == pytest.approx(float(found["point_F_y_m"]), abs=1e-13)
