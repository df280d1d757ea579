"""Events where they are hard to see: a needle that grazes the backing, and machines of a part of the turn."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.dynamics import Body
from textile_twin_core.machine import ShaftPlace
from textile_twin_core.mechanism import Arc, Crank, RRRDyad, Travel

RANGE = (0.32, 0.55)


@pytest.mark.parametrize("depth_m", [1e-7, 1e-9, 1e-11, 1e-13])
def test_a_grazing_needle_enters_and_leaves(depth_m: float) -> None:
    kinematics = ttc.compile(ttc.machines.tufting(), ["needle_position_m", "needle_acceleration_m_s2"], "exact")
    turn = next(e.angle_rad for e in ttc.machines.tufting().events() if e.name == "needle_largest")
    lowest = kinematics.evaluate(turn, 1.0, 0.0)
    plane = lowest["needle_position_m"] - depth_m
    machine = ttc.machines.tufting(entry_plane_m=plane, exit_plane_m=plane)
    enters, leaves = (e.angle_rad for e in machine.events() if "backing" in e.name)
    half_width = math.sqrt(2.0 * depth_m / -lowest["needle_acceleration_m_s2"])
    assert (leaves - enters) / 2.0 == pytest.approx(half_width, rel=1e-3 if depth_m > 1e-12 else 0.02)
    theta = turn + np.linspace(-3.0, 3.0, 601) * half_width
    exact, table = (
        ttc.compile(machine, ["balancing_torque_Nm"], m).evaluate(theta, 16.0)["balancing_torque_Nm"]
        for m in ("exact", "table")
    )
    away = np.abs(np.abs(theta - turn) - half_width) > 0.05 * half_width
    assert np.abs(exact - table)[away].max() < 2e-12


def part_of_a_turn(**declared: Any) -> ttc.Machine:
    groups = (Crank("l1", "O", "A", 0.3), RRRDyad("l2", "l3", "A", "C", "B", (0.1, 0.2)))
    bodies = (Body("l2", 1.0, 0.01), Body("l3", 1.0, 0.01))
    return ttc.Machine("lever", {"O": (0.0, 0.0), "C": (0.35, 0.0)}, groups, bodies, range_rad=RANGE, **declared)


def test_a_part_of_the_turn_gives_every_output() -> None:
    machine = part_of_a_turn(measures=(Arc("lever", "l3", 0.2), Travel("tip", "B", "O", (1.0, 0.0))))
    theta = np.linspace(*RANGE, 2001)
    found = ttc.compile(machine, machine.outputs, "exact").evaluate(theta, 1.0, 0.5)
    assert [name for name, values in found.items() if not np.isfinite(values).all()] == []
    for link, start, end in (("2", "A", "B"), ("3", "C", "B")):
        x, y = (found[f"point_{end}_{k}_m"] - found[f"point_{start}_{k}_m"] for k in "xy")
        assert np.allclose(found[f"theta_{link}_rad"], np.unwrap(np.arctan2(y, x)), atol=1e-13)
    arc = 0.2 * (found["theta_3_rad"] - found["theta_3_rad"].min())
    assert np.allclose(found["lever_position_m"], arc, atol=1e-8)
    assert all(RANGE[0] <= event.angle_rad <= RANGE[1] for event in machine.events())
    largest = next(e.angle_rad for e in machine.events() if e.name == "tip_largest")
    assert abs(largest - theta[np.argmax(found["tip_position_m"])]) < 2e-4


def test_a_part_of_the_turn_has_no_table() -> None:
    machine = part_of_a_turn()
    with pytest.raises(ttc.SceneError, match="declared for a part of the turn"):
        ttc.compile(machine, ["balancing_torque_Nm"], "table")
    theta = np.full(200_001, 0.4)
    auto = ttc.compile(machine, ["balancing_torque_Nm", "theta_1_rad"], "auto")
    assert np.isfinite(auto.evaluate(theta, 1.0)["balancing_torque_Nm"]).all()
    samples = auto.session().step(np.arange(10) * 1e-3, np.full(10, 0.4))
    assert np.allclose(samples["theta_1_rad"], 0.4, atol=1e-9)


def test_every_linkage_on_the_shaft_must_close_over_the_part_of_the_turn() -> None:
    assert part_of_a_turn(linkages=(ShaftPlace(0.0), ShaftPlace(-0.01))).closeness
    with pytest.raises(ttc.MachineError, match="cannot close"):
        part_of_a_turn(linkages=(ShaftPlace(0.0), ShaftPlace(1.0)))
