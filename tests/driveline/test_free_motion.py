"""drive with an elastic shaft: energy, an independent integrator, standstill under dry friction, and the command."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.driveline.test_chain import DAMPING, DISCS, PHASES, STATIONS, STIFFNESS, machine, smooth_force, wide
from tests.generators import elastic_truth
from textile_twin_core.arrays import FloatArray
from textile_twin_core.cli.main import main
from textile_twin_core.driveline.free_motion import ElasticDriveResult
from textile_twin_core.dynamics import Backing
from textile_twin_core.dynamics.loads import ForceCurve, ShaftFriction
from textile_twin_core.errors import MotionError
from textile_twin_core.machine import Machine


def undamped(damped: Machine) -> Machine:
    assert damped.shaft is not None
    pieces = tuple(replace(piece, damping_Nms_rad=0.0) for piece in damped.shaft.pieces)
    return replace(damped, shaft=replace(damped.shaft, pieces=pieces))


def energy_error(found: ElasticDriveResult) -> float:
    largest = (found.kinetic_energy_J + found.potential_energy_J).max()
    return float(np.abs(found.energy_error_J).max() / largest)


def run(driven: Machine, torque: float, omega: float, t: FloatArray) -> ElasticDriveResult:
    found = ttc.drive(driven, torque, 0.3, omega, t)
    assert isinstance(found, ElasticDriveResult)
    return found


@pytest.mark.parametrize("load", ["gravity alone", "needles in a backing", "backlash"])
def test_energy_is_constant_without_damping(load: str) -> None:
    play = np.array([0.0, 0.004, 0.0]) if load == "backlash" else np.zeros(3)
    plain = replace(undamped(machine(np.ones(3), play)), loads=())
    if load == "needles in a backing":
        plain = replace(plain, loads=(Backing("needle", 1000.0, 0.55784, 0.55784),))
    found = run(plain, 5.0, 20.0, np.linspace(0.0, 0.4, 101))
    assert energy_error(found) < 1e-9
    assert np.abs(found.load_work_J["damping"]).max() == 0.0
    assert (found.load_work_J["loads"][-1] < -10.0) == (load == "needles in a backing")
    if play.any():
        twist = found.motion.twist_rad[:, 1]
        assert (twist > 0.002).any() and (twist < -0.002).any()


def truth(gears: FloatArray, play: FloatArray, torque: float, backing_N: float) -> elastic_truth.Chain:
    return elastic_truth.Chain(
        DISCS,
        STIFFNESS,
        DAMPING,
        np.array([False, True, True, True]),
        np.array([0.0, *PHASES]),
        gears,
        play,
        viscous=0.0 if backing_N else 0.05,
        force=None if backing_N else smooth_force,
        backing_N=backing_N,
        torque=lambda t, theta, omega: torque,
    )


@pytest.mark.parametrize(
    ("ratio", "play", "backing_N", "torque"),
    [(1.0, 0.0, 0.0, -1500.0), (3.0, 0.002, 0.0, 30.0), (1.0, 0.0, 1000.0, 30.0)],
    ids=["smooth loads and a reversal", "gears and backlash", "needles in a backing"],
)
def test_a_free_chain_agrees_with_an_independent_integrator(
    ratio: float, play: float, backing_N: float, torque: float
) -> None:
    gears, backlash = np.array([ratio, 1.0, 1.0]), np.array([0.0, play, 0.0])
    t = 1e-3 * np.arange(61)
    driven = machine(gears, backlash)
    if backing_N:
        driven = replace(driven, loads=(Backing("needle", backing_N, 0.55784, 0.55784),))
    speeds = np.concatenate([[1.0], 1.0 / np.cumprod(gears)])
    found = run(driven, torque, 20.0, t)
    dense = truth(gears, backlash, torque, backing_N)
    # the same beginning: the twist with which the engine begins
    start = np.concatenate([found.motion.theta_rad[0], 20.0 * ratio * speeds])
    theta, omega = dense.run(start, t, 1e-11)
    pieces = np.array([dense.piece_torques(a, w) for a, w in zip(theta, omega, strict=True)])
    np.testing.assert_allclose(found.motion.theta_rad, theta, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(found.motion.piece_torque_Nm, pieces, rtol=0.0, atol=1e-6 * np.abs(pieces).max())
    assert (omega[-1, 0] < -5.0) == (torque < 0.0)


def test_a_force_over_the_depth_bends_at_its_knots_as_by_an_independent_integrator() -> None:
    knots, down, up = np.array([0.5562, 0.5575, 0.559, 0.575]), [0.0, 1100.0, 600.0, 800.0], [0.0, 200.0, 300.0, 350.0]
    curve = ForceCurve("backing", "needle_position_m", tuple(knots.tolist()), tuple(down), tuple(up))
    ones, t = np.ones(3), 1e-3 * np.arange(61)
    driven = replace(machine(ones, np.zeros(3)), loads=(curve,))
    found = run(driven, 30.0, 20.0, t)
    dense = truth(ones, np.zeros(3), 30.0, 0.0)
    dense.force, dense.viscous = None, 0.0
    dense.law = lambda place, goes_down: np.where(
        goes_down, np.interp(place, knots, down, left=0.0), np.interp(place, knots, up, left=0.0)
    )
    theta, omega = dense.run(np.concatenate([found.motion.theta_rad[0], np.full(4, 20.0)]), t, 1e-11)
    np.testing.assert_allclose(found.motion.theta_rad, theta, rtol=0.0, atol=2e-8)
    np.testing.assert_allclose(found.motion.omega_rad_s, omega, rtol=0.0, atol=2e-5)
    assert found.load_work_J["loads"][-1] < -5.0


def test_dry_friction_holds_and_lets_go() -> None:
    """A shaft at standstill moves only once the torque passes its friction."""
    still = replace(machine(np.ones(3), np.zeros(3)), loads=(ShaftFriction(coulomb_Nm=10.0),), gravity_m_s2=(0.0, 0.0))
    ramp = ttc.TorqueOverTime((0.0, 1.0), (0.0, 40.0))
    t = np.linspace(0.0, 0.6, 301)
    found = ttc.drive(still, ramp, 0.3, 0.0, t)
    assert isinstance(found, ElasticDriveResult)
    held = t < 0.2  # the drive's disc turns against the shaft until 10 N m come through the first piece
    assert np.abs(found.motion.omega_rad_s[held, 1]).max() == 0.0
    assert found.motion.omega_rad_s[-1, 1] > 0.5
    assert energy_error(found) < 1e-9
    wound = found.motion.twist_rad[held, 0] * STIFFNESS[0]
    assert wound[-1] == pytest.approx(40.0 * t[held][-1], rel=0.2)


def test_a_shaft_coasts_down_to_a_standstill_that_lasts() -> None:
    found = run(wide(), 0.0, 6.0, np.linspace(0.0, 1.0, 201))
    assert np.abs(found.motion.omega_rad_s[-1]).max() < 1e-4
    assert np.abs(found.motion.omega_rad_s[-1, 9:]).max() == 0.0
    assert np.abs(found.energy_error_J).max() < 1e-8 * found.kinetic_energy_J[0]


def test_a_rigid_machine_is_driven_as_before() -> None:
    rigid = ttc.machines.tufting()
    found = ttc.drive(rigid, 3.0, 0.3, 20.0, [0.0, 0.1])
    assert not isinstance(found, ElasticDriveResult)
    with pytest.raises(MotionError, match="the motion runs away"):
        ttc.drive(wide(backing_force_N=0.0), 1e5, 0.0, 10.0, [0.0, 0.5], fastest_rad_s=30.0)
    with pytest.raises(MotionError, match="drive_torque must be a number or a function"):
        ttc.drive(wide(), "much", 0.0, 10.0, [0.0, 0.5])  # type: ignore[arg-type]


def test_the_command_writes_every_station_and_piece(tmp_path: Path) -> None:
    path = tmp_path / "wide.yaml"
    path.write_text(
        "machine: tufting\nshaft: {diameter_m: 0.06, length_m: 1, stations: 2, damping_Nms_rad: 1.25,"
        " drive: {inertia_kgm2: 1.0}}\n"
    )
    out = tmp_path / "out.csv"
    arguments = [
        "drive",
        str(path),
        "--torque",
        "10",
        "--rpm",
        "160",
        "--time",
        "0.05",
        "--samples",
        "6",
        "--out",
        str(out),
    ]
    assert main(arguments) == 0
    with out.open() as file:
        rows = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
    names = [f"station_s{k}_theta_rad" for k in range(3)]
    assert {*names, "station_s2_omega_rad_s", "torque_s0_s1_Nm", "torque_s1_s2_Nm"} <= rows[0].keys()
    assert rows[-1]["theta_rad"] == rows[-1]["station_s0_theta_rad"]
    assert all(abs(row["station_s2_theta_rad"] - row["theta_rad"]) < 0.01 * math.pi for row in rows)


def test_the_chain_has_as_many_stations_as_declared() -> None:
    assert run(machine(np.ones(3), np.zeros(3)), 0.0, 1.0, np.array([0.0, 0.01])).motion.theta_rad.shape == (
        2,
        STATIONS,
    )
