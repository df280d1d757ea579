"""The tufting machine against the published ranges, the printed events and 50-digit arithmetic."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.generators.tufting_truth import truth

OMEGA_160_RPM = 160.0 * 2.0 * math.pi / 60.0
CASES = [
    c for c in json.loads((Path(__file__).parents[1] / "data/hard_cases.json").read_text()) if c["kind"] == "tufting"
]
NAME_OF = {
    "tau": "balancing_torque_Nm",
    "y": "point_E_y_m",
    "v": "needle_velocity_m_s",
    "a": "needle_acceleration_m_s2",
    "w3": "omega_3_rad_s",
    "a3": "alpha_3_rad_s2",
    "th3": "theta_3_rad",
    "N": "reaction_guide_N",
    **{f"{pin}{axis}": f"reaction_{pin}_{axis}_N" for pin in "OABCDE" for axis in "xy"},
}


@pytest.fixture(scope="module")
def machine() -> ttc.Machine:
    return ttc.machines.tufting()


def over_a_turn(machine: ttc.Machine, outputs: list[str], alpha: float = 0.0, samples: int = 36000):
    theta = np.linspace(0.0, 2.0 * math.pi, samples, endpoint=False)
    return ttc.compile(machine, outputs, method="exact").evaluate(theta, OMEGA_160_RPM, alpha)


# Xu et al. 2016, dynamic characteristic analysis; -7.89 for link 4 is a misprint of -7.68
@pytest.mark.parametrize(
    ("link", "low", "high"), [(2, 101.7, 114.3), (3, 184.3, 199.4), (4, -7.68, 7.39), (5, 257.975, 258.522)]
)
def test_link_ranges_are_those_printed(machine: ttc.Machine, link: int, low: float, high: float) -> None:
    angle = np.degrees(over_a_turn(machine, [f"theta_{link}_rad"])[f"theta_{link}_rad"])
    assert angle.min() == pytest.approx(low, abs=0.06)
    assert angle.max() == pytest.approx(high, abs=0.06)


def test_needle_stroke_and_events(machine: ttc.Machine) -> None:
    needle = over_a_turn(machine, ["needle_position_m"])["needle_position_m"]
    assert np.ptp(needle) * 1e3 == pytest.approx(32.788, abs=5e-4)
    events = {event.name: math.degrees(event.angle_rad) for event in machine.events()}
    assert events["needle_largest"] == pytest.approx(106.9765, abs=5e-5)
    assert events["needle_smallest"] == pytest.approx(288.2305, abs=1e-4)
    assert events["needle_enters_backing"] == pytest.approx(21.9512, abs=5e-5)
    assert events["needle_leaves_backing"] == pytest.approx(193.9262, abs=5e-5)


def test_entry_and_exit_are_exact_to_rounding(machine: ttc.Machine) -> None:
    events = {event.name: event.angle_rad for event in machine.events()}
    assert events["needle_enters_backing"] == pytest.approx(0.38312100023839724, abs=5e-15)
    assert events["needle_leaves_backing"] == pytest.approx(3.3846508836082833, abs=5e-15)


def test_peak_torque(machine: ttc.Machine) -> None:
    torque = over_a_turn(machine, ["balancing_torque_Nm"], samples=360000)["balancing_torque_Nm"]
    assert torque.max() == pytest.approx(17.2786, abs=5e-5)
    assert math.degrees(2.0 * math.pi * torque.argmax() / torque.size) == pytest.approx(24.82, abs=5e-3)


@pytest.mark.parametrize("alpha", [0.0, 40.0, -300.0])
def test_both_torque_routes_agree(machine: ttc.Machine, alpha: float) -> None:
    r = over_a_turn(machine, ["balancing_torque_Nm", "balancing_torque_newton_euler_Nm"], alpha)
    peak = np.abs(r["balancing_torque_Nm"]).max()
    difference = np.abs(r["balancing_torque_Nm"] - r["balancing_torque_newton_euler_Nm"]).max()
    assert difference < 1e-12 * peak


def test_parts_add_up(machine: ttc.Machine) -> None:
    parts = ["torque_inertial_Nm", "torque_gravity_Nm", "torque_load_Nm"]
    r = over_a_turn(machine, ["balancing_torque_Nm", *parts], 25.0)
    assert np.abs(sum(r[p] for p in parts) - r["balancing_torque_Nm"]).max() < 1e-13


def test_driven_shaft_and_bearing_forces(machine: ttc.Machine) -> None:
    pins = [f"reaction_{pin}_{axis}_N" for pin in "CO" for axis in "xy"]
    r = over_a_turn(machine, ["driven_shaft_torque_Nm", *pins])
    assert r["driven_shaft_torque_Nm"].max() == pytest.approx(132.4, abs=0.05)
    assert np.hypot(r["reaction_C_x_N"], r["reaction_C_y_N"]).max() == pytest.approx(2197, abs=0.5)
    assert np.hypot(r["reaction_O_x_N"], r["reaction_O_y_N"]).max() == pytest.approx(1167, abs=0.5)


@pytest.mark.parametrize("case", CASES, ids=lambda c: c["name"])
def test_hard_cases(machine: ttc.Machine, case: dict) -> None:
    state = [float(case[k]) for k in ("theta1", "omega", "alpha")]
    twin = ttc.compile(machine, list(NAME_OF.values()), method="exact")
    single, block = twin.evaluate(*state), twin.evaluate(np.array([state[0]]), state[1], state[2])
    for key, name in NAME_OF.items():
        expected = float(case["expected"][key]) * (-1.0 if key in "va" else 1.0)  # printed upwards
        scale = 2200.0 if key[-1] in "xyN" and key != "y" else max(1.0, abs(expected))
        assert single[name] == pytest.approx(expected, abs=2e-14 * scale), name
        assert block[name][0] == pytest.approx(expected, abs=2e-14 * scale), name


def test_every_output_against_fifty_digits(machine: ttc.Machine) -> None:
    rng = np.random.default_rng(5)
    twin = ttc.compile(machine, machine.outputs, method="exact")
    states = [(rng.uniform(0, 2 * math.pi), rng.uniform(-30, 30), rng.uniform(-200, 200)) for _ in range(12)]
    exact = [truth(*state) for state in states]
    for name in set(machine.outputs) & set(exact[0]):
        column = np.array([float(row[name]) for row in exact])
        found = np.array([twin.evaluate(*state)[name] for state in states])
        assert np.abs(found - column).max() <= 3e-14 * np.abs(column).max() + 1e-30, name


def test_urdf_joints_reach_every_point(machine: ttc.Machine) -> None:
    """Walking the URDF's own tree with the joint outputs must land on the points of the linkage."""
    from xml.etree import ElementTree

    robot = ElementTree.fromstring(machine.urdf())
    r = ttc.compile(machine, machine.outputs, method="exact").evaluate(1.234, 0.0, 0.0)
    frames: dict[str, tuple[complex, complex]] = {"base": (0j, 1 + 0j)}
    for joint in robot.findall("joint"):
        parent, child = joint.find("parent").get("link"), joint.find("child").get("link")
        if parent not in frames:
            continue
        x, y, _ = map(float, joint.find("origin").get("xyz").split())
        yaw = float(joint.find("origin").get("rpy").split()[2])
        at, turn = frames[parent]
        at, turn = at + turn * complex(x, y), turn * np.exp(1j * yaw)
        value = r.get(f"joint_{joint.get('name')}_position", 0.0)
        if joint.get("type") == "prismatic":
            at += turn * value
        else:
            turn *= np.exp(1j * value)
        frames[child] = (at, turn)
    for link in machine.links:
        point = complex(r[f"point_{link.start}_x_m"], r[f"point_{link.start}_y_m"])
        assert abs(frames[link.name][0] - point) < 1e-14, link
