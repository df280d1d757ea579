"""The machine files that users start from: they load, run on the command line, and give what was worked out apart."""

from __future__ import annotations

import cmath
import csv
import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.engine_peers.meeting import meeting
from textile_twin_core.cli.main import main
from textile_twin_core.files import load_machine_file, save_machine_file

EXAMPLES = Path(__file__).parents[2] / "examples"
FILES = sorted(EXAMPLES.glob("*.yaml"))


def simulated(path: Path, out: Path, rpm: float) -> dict[str, np.ndarray]:
    assert main(["simulate", str(path), "--rpm", str(rpm), "--samples", "360", "--out", str(out)]) == 0
    with out.open(newline="") as file:
        names, *rows = csv.reader(file)
    return dict(zip(names, np.array(rows, dtype=float).T, strict=True))


def test_there_are_examples() -> None:
    assert {path.name for path in FILES} >= {"six_bar_loom.yaml", "tufting_two_linkages.yaml"}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_example_runs_and_goes_through_a_file(path: Path, tmp_path: Path) -> None:
    table = simulated(path, tmp_path / "f.csv", 200.0)
    machine = load_machine_file(path)
    assert list(table) == ["theta_rad", "omega_rad_s", "alpha_rad_s2", *machine.scene.outputs]
    assert all(np.isfinite(column).all() for column in table.values())
    save_machine_file(machine, tmp_path / "again.yaml")
    again = load_machine_file(tmp_path / "again.yaml")
    assert dataclasses.replace(again, parameters=machine.parameters) == machine


def test_six_bar_loom_by_circles_and_by_newton_and_euler(tmp_path: Path) -> None:
    table = simulated(EXAMPLES / "six_bar_loom.yaml", tmp_path / "f.csv", 200.0)
    angles = []
    c, g = 0.230 - 0.060j, 0.330 - 0.310j
    for theta in table["theta_rad"].tolist():
        a = cmath.rect(0.055, theta)
        b = meeting(a, c, 0.210, 0.190, left=True)
        d = c + cmath.rect(0.160, cmath.phase(b - c) - math.radians(35.0))
        e = meeting(d, g, 0.240, 0.280, left=True)
        angles.append(cmath.phase(e - g))
    arc = 0.280 * np.unwrap(angles)
    position = table["sley_position_m"]
    assert np.abs((position - position[0]) - (arc - arc[0])).max() < 1e-14
    assert position.min() == pytest.approx(0.0, abs=1e-5)

    machine = load_machine_file(EXAMPLES / "six_bar_loom.yaml")
    routes = ["balancing_torque_Nm", "balancing_torque_newton_euler_Nm", "torque_load_Nm", "omega_6_rad_s"]
    values = ttc.compile(machine, routes).evaluate(table["theta_rad"], table["omega_rad_s"], 0.0)
    peak = np.abs(table["balancing_torque_Nm"]).max()
    for route in routes[:2]:
        assert np.abs(values[route] - table["balancing_torque_Nm"]).max() < 1e-12 * peak
    # over a turn the spring gives back what it takes: the loads cost the friction's work
    omega = 200.0 * math.pi / 30.0
    friction = 0.2 + 0.01 * omega + 0.15 * np.abs(values["omega_6_rad_s"]) / omega
    assert values["torque_load_Nm"].mean() == pytest.approx(friction.mean(), rel=1e-4)


def test_two_linkages_half_a_turn_apart(tmp_path: Path) -> None:
    table = simulated(EXAMPLES / "tufting_two_linkages.yaml", tmp_path / "f.csv", 160.0)
    machine = load_machine_file(EXAMPLES / "tufting_two_linkages.yaml")
    alone = ttc.compile(dataclasses.replace(machine, linkages=(ttc.machines.ShaftPlace(),)), ["balancing_torque_Nm"])
    single = alone.evaluate(table["theta_rad"], table["omega_rad_s"], 0.0)["balancing_torque_Nm"]
    both = single + np.roll(single, -180)
    assert np.abs(table["balancing_torque_Nm"] - both).max() < 1e-11


def test_a_loom_runs_up_under_its_motor() -> None:
    """A motor of 6 N m that gives out at 25 rad/s."""
    machine = load_machine_file(EXAMPLES / "six_bar_loom.yaml")
    run = ttc.drive(machine, lambda t, theta, omega: 6.0 * (1.0 - omega / 25.0), 0.0, 0.0, 2.0)
    assert 20.0 < run.omega_rad_s[-100:].mean() < 25.0
    assert np.ptp(run.omega_rad_s[-500:]) > 0.5
    assert np.abs(run.energy_error_J).max() < 1e-8 * run.kinetic_energy_J.max()
