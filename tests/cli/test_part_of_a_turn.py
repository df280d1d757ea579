"""Machines declared for a part of the turn: every command stays within it, or reports the excess."""

from __future__ import annotations

import json
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest

import textile_twin_core as ttc
from tests.generators.planar_truth import four_bar
from textile_twin_core.cli.main import main
from textile_twin_core.comparison.monitor import Monitor
from textile_twin_core.recordings import BagWriter, open_bag

LOW, HIGH, SPEED = 0.6, 1.5, 0.25
MACHINE = """
name: double_rocker
points: {O: [0, 0], C: [0.1, 0.0]}
range_rad: [0.6, 1.5]
groups:
  - {type: crank, name: l1, at: O, end: A, length_m: 0.12}
  - {type: rrr_dyad, coupler: l2, rocker: l3, from: A, ground: C, end: B, lengths_m: [0.05, 0.11], branch: right}
bodies:
  l1: {mass_kg: 1, inertia_kgm2: 1e-3}
  l2: {mass_kg: 0.5, inertia_kgm2: 1e-4}
  l3: {mass_kg: 1, inertia_kgm2: 1e-3}
loads: [{type: torque_table, angle_rad: [0, 1.5707963267948966, 3.141592653589793, 4.71238898038469],
         torque_Nm: [0, 0.1, 0, -0.1], harmonics: 1}]
measures: [{type: arc, name: sley, link: l3, radius_m: 0.3}]
"""


def true_torque(theta: float, omega: float) -> float:
    """Compute the torque from inertia, weight and load by virtual work at constant speed [N m], to fifty digits."""
    t = four_bar(0.12, 0.05, 0.11, 0.1, theta, left=False)
    crank = 0.12 * mp.expj(theta)
    links = [(0, 0, 0, 0.12, theta, 1, 0, 1.0, 1e-3)]
    links.append((crank, 1j * crank, -crank, 0.05, t["th2"], t["p2"], t["q2"], 0.5, 1e-4))
    links.append((0.1, 0, 0, 0.11, t["th3"], t["p3"], t["q3"], 1.0, 1e-3))
    total = -0.1 * mp.sin(theta)
    for _, first, second, length, angle, p, q, mass, inertia in links:
        arm = 0.5 * length * mp.expj(angle)
        way, bend = first + 1j * p * arm, second + (1j * q - p * p) * arm
        total += omega**2 * (mass * mp.re(mp.conj(way) * bend) + inertia * p * q) + 9.81 * mass * mp.im(way)
    return float(total)


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("machine") / "double_rocker.yaml"
    path.write_text(MACHINE)
    return str(path)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Write a recording of a steady shaft within the range, with the true torque."""
    path = tmp_path_factory.mktemp("bag") / "steady"
    time = np.arange(320) / 100.0
    theta = LOW + 0.05 + SPEED * time
    stamps = 10**18 + np.rint(time * 1e9).astype(np.int64)
    with BagWriter(path) as out:
        out.write_joint_states("main_shaft/angle", stamps, ["main_shaft"], theta)
        out.write_wrenches(
            "balancing_torque/measured", stamps, np.array([true_torque(t, SPEED) for t in theta.tolist()])
        )
    return str(path)


def test_compare_and_replay_agree_with_the_truth(machine: str, bag: str, tmp_path: Path) -> None:
    assert main(["compare", bag, "--machine", machine, "--json", str(tmp_path / "c.json")]) == 0
    found = json.loads((tmp_path / "c.json").read_text())["torque"]
    assert found["rms_error_Nm"] < 1e-6 * found["peak_Nm"]
    assert main(["replay", bag, "--machine", machine, "--out", str(tmp_path / "out")]) == 0
    residual = open_bag(tmp_path / "out").read_torques("balancing_torque/residual").torque_Nm
    assert residual.size > 300
    assert np.abs(residual[50:]).max() < 1e-6 * found["peak_Nm"]


def test_samples_beyond_the_part_are_reported(machine: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Check a linkage that closes where the end of its crank is 0.06 to 0.16 m from C: at 45, 90, 270 and 315
    degrees.
    """
    out = tmp_path / "turn.csv"
    assert main(["simulate", machine, "--rpm", "60", "--samples", "8", "--out", str(out)]) == 0
    rows = np.genfromtxt(out, delimiter=",", names=True)
    away = np.abs(0.12 * np.exp(1j * rows["theta_rad"]) - 0.1)
    beyond = (away < 0.06) | (away > 0.16)
    np.testing.assert_array_equal(np.isnan(rows["balancing_torque_Nm"]), beyond)
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{np.count_nonzero(beyond)} of 8 samples are nan, the first at a shaft angle of 0.0000 deg" in line
    motion = tmp_path / "motion.csv"
    motion.write_text("theta_rad,omega_rad_s,alpha_rad_s2\n0.7,1,0\n1.4,1,0\n")
    assert main(["simulate", machine, "--input", str(motion), "--out", str(out)]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.campaign
def test_pictures_are_of_the_part_that_is_declared(machine: str, bag: str, tmp_path: Path) -> None:
    assert main(["simulate", machine, "--rpm", "60", "--png", str(tmp_path / "machine.png")]) == 0
    assert main(["compare", bag, "--machine", machine, "--png", str(tmp_path / "compared.png")]) == 0
    assert (tmp_path / "machine.png").stat().st_size > 20_000
    assert (tmp_path / "compared.png").stat().st_size > 20_000


@pytest.mark.parametrize(("command", "said"), [("calibrate", "less than a turn"), ("monitor", "whole turns")])
def test_what_needs_whole_turns_says_so(
    machine: str, bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str, said: str
) -> None:
    out = {"calibrate": ["--out", str(tmp_path / "mine.yaml")]}
    assert main([command, bag, "--machine", machine, *out.get(command, [])]) == 2
    assert said in capsys.readouterr().err


def test_torque_that_a_watch_measures_by_is_that_within_the_range(machine: str) -> None:
    declared = ttc.load_machine(machine)
    assert isinstance(declared, ttc.Machine)
    theta = np.linspace(LOW, HIGH, 1441)[1::2]
    largest = max(abs(true_torque(t, declared.nominal_speed_rad_s)) for t in theta.tolist())
    assert Monitor(declared).watch.torque_Nm == pytest.approx(largest, rel=1e-9)
