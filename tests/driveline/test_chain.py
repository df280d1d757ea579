"""The chain against an independent integrator, the rigid engine, and the step load's known error."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.generators import elastic_truth
from textile_twin_core.arrays import FloatArray
from textile_twin_core.driveline import elastic_shaft, follow_motion
from textile_twin_core.dynamics import Body
from textile_twin_core.dynamics.loads import ForceTable, JointDamping, PointDamping, ShaftFriction
from textile_twin_core.errors import MachineError, MotionError
from textile_twin_core.machine import EvenShaft, Machine, MainShaft, ShaftDrive, ShaftPiece, ShaftPlace, Station

STATIONS = 4
DISCS = np.array([1.0, 0.004, 0.004, 0.004])
STIFFNESS, DAMPING = np.full(3, 4.0e4), np.full(3, 2.0)
PHASES = (0.0, 0.3, math.pi)
SPEED = 30.0
Base = Callable[[float], tuple[float, float, float]]


def ripple(t: float) -> tuple[float, float, float]:
    """A speed with ripple."""
    phase = 2.0 * SPEED * t
    return (
        SPEED * t + 0.01 * math.sin(phase),
        SPEED * (1.0 + 0.02 * math.cos(phase)),
        -0.04 * SPEED**2 * math.sin(phase),
    )


def swing(t: float) -> tuple[float, float, float]:
    """A motion that turns back."""
    return 1.5 * math.sin(25.0 * t + 1.0), 37.5 * math.cos(25.0 * t + 1.0), -937.5 * math.sin(25.0 * t + 1.0)


def smooth_force(theta: FloatArray) -> FloatArray:
    """A force on the needle, upwards [N]."""
    return 50.0 + 100.0 * np.sin(theta)


def machine(
    gears: FloatArray, play: FloatArray, stiffness: FloatArray = STIFFNESS, discs: FloatArray = DISCS
) -> Machine:
    """Three tufting linkages behind a drive disc, with damping and a smooth force on the needle."""
    names = [f"s{k}" for k in range(STATIONS)]
    angles = 2.0 * np.pi * np.arange(8) / 8.0
    force = ForceTable("F", (0.0, 1.0), tuple(angles), tuple(smooth_force(angles)), harmonics=1)
    pieces = [
        ShaftPiece(names[k], names[k + 1], stiffness[k], DAMPING[k], gear_ratio=gears[k], backlash_rad=play[k])
        for k in range(STATIONS - 1)
    ]
    return replace(
        ttc.machines.tufting(),
        loads=(JointDamping("l1", 0.05), force),
        shaft=MainShaft(tuple(map(Station, names, discs)), tuple(pieces)),
        linkages=tuple(ShaftPlace(phase, name) for phase, name in zip(PHASES, names[1:], strict=True)),
    )


@pytest.mark.parametrize(
    ("ratio", "play", "base", "samples"),
    [(1.0, 0.0, ripple, 81), (-4.0, 0.0, ripple, 81), (1.0, 0.002, swing, 141)],
    ids=["staggered rows", "gears", "backlash and a reversal"],
)
def test_smooth_loads_agree_with_an_independent_integrator(ratio: float, play: float, base: Base, samples: int) -> None:
    gears, backlash = np.array([ratio, 1.0, 1.0]), np.array([0.0, play, 0.0])
    t = 1e-3 * np.arange(samples)

    def at_the_drive(time: float) -> tuple[float, float, float]:
        angle, speed, acceleration = base(time)
        return ratio * angle, ratio * speed, ratio * acceleration

    speeds = np.concatenate([[1.0], 1.0 / np.cumprod(gears)])
    dense = elastic_truth.Chain(
        DISCS,
        STIFFNESS,
        DAMPING,
        np.array([False, True, True, True]),
        np.array([0.0, *PHASES]),
        gears,
        backlash,
        viscous=0.05,
        force=smooth_force,
        base=at_the_drive,
    )
    driven = np.array([at_the_drive(time) for time in t])
    theta, omega = dense.run(np.concatenate([driven[0, 0] * speeds, driven[0, 1] * speeds]), t)
    torque = np.array([dense.piece_torques(a, w) for a, w in zip(theta, omega, strict=True)])

    motion = [np.array([base(time)[k] for time in t]) for k in range(3)]
    found = follow_motion(elastic_shaft(machine(gears, backlash)), t, *motion, settled=False, tolerance=2e-7)
    assert found.reached_error <= 2e-7
    np.testing.assert_allclose(found.piece_torque_Nm, torque, rtol=0.0, atol=1e-6 * np.abs(torque).max())
    np.testing.assert_allclose(found.theta_rad, theta, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(found.omega_rad_s, omega, rtol=0.0, atol=1e-5)
    if play:
        assert (torque[:, 1] > 1.0).any() and (torque[:, 1] < -1.0).any() and (torque[:, 1] == 0.0).any()
        assert (omega[:, 1] > 1.0).any() and (omega[:, 1] < -1.0).any()


def test_a_stiff_shaft_needs_the_torque_of_the_rigid_engine() -> None:
    """And what is missing falls with the stiffness: to 1e-6 of the peak and below."""
    t = 1e-3 * np.arange(400)
    motion = np.array([ripple(time) for time in t]).T
    errors = []
    for stiffness in (1e7, 1e8, 1e9):
        elastic = machine(np.ones(3), np.zeros(3), np.full(3, stiffness), np.array([1.0, 0.0, 0.0, 0.0]))
        found = follow_motion(elastic_shaft(elastic), t, *motion, substeps=64)
        rigid = ttc.compile(elastic, ["balancing_torque_Nm"]).evaluate(*motion)["balancing_torque_Nm"]
        needed = found.drive_torque_Nm - motion[2]  # the drive's disc of 1 kg m^2
        assert found.torque_between("s0", "s1") == pytest.approx(needed, abs=1e-9 * np.abs(needed).max())
        errors.append(float(np.abs(needed - rigid).max() / np.abs(rigid).max()))
    assert errors[0] < 1e-3
    assert errors[2] < 1e-6, errors


def wide(**changes: float) -> Machine:
    """Sixteen tufting linkages on 4 m of steel of 60 mm, with their step load."""
    even = EvenShaft(0.06, 4.0, 16, damping_Nms_rad=1.25, drive=ShaftDrive(inertia_kgm2=1.0))
    return replace(ttc.machines.tufting(**changes), shaft=even.main_shaft(), linkages=even.places())


def test_more_substeps_follow_the_step_load_better() -> None:
    elastic, t = elastic_shaft(wide()), 1e-3 * np.arange(500)
    omega = 300.0 * 2.0 * math.pi / 60.0
    motion = (omega * t, np.full(t.size, omega), np.zeros(t.size))
    torques = {n: follow_motion(elastic, t, *motion, substeps=n).piece_torque_Nm[:, 0] for n in (2, 4, 8, 16, 256)}
    peak = np.abs(torques[256]).max()
    errors = [float(np.sqrt(((torques[n] - torques[256]) ** 2).mean()) / peak) for n in (2, 4, 8, 16)]
    assert errors[0] < 0.1
    assert all(2.5 < a / b < 6.0 for a, b in pairwise(errors)), errors


def test_dry_friction_holds_a_shaft_that_stops() -> None:
    """A shaft that is braked to standstill keeps still, without chatter: its torque is what friction can hold."""
    braked = replace(wide(backing_force_N=0.0), loads=(ShaftFriction(coulomb_Nm=5.0),), gravity_m_s2=(0.0, 0.0))
    t = 1e-3 * np.arange(400)
    stop = np.minimum(t / 0.2, 1.0)
    omega = 10.0 * (1.0 - stop)
    theta = 10.0 * 0.2 * (stop - 0.5 * stop**2)
    found = follow_motion(elastic_shaft(braked), t, theta, omega, np.where(t < 0.2, -50.0, 0.0), substeps=8)
    end = t > 0.38
    assert np.abs(found.omega_rad_s[end, 1]).max() < 0.02
    assert np.abs(np.diff(found.omega_rad_s[end, 1])).max() < 0.02


def test_friction_of_the_shaft_acts_in_full_at_a_light_station() -> None:
    """A station without a disc of its own carries a linkage and the friction of the main shaft."""
    bare, rough = (
        replace(wide(backing_force_N=0.0), loads=(ShaftFriction(coulomb_Nm=c),), gravity_m_s2=(0.0, 0.0))
        for c in (0.0, 5.0)
    )
    t = 1e-3 * np.arange(100)
    torques = [
        follow_motion(elastic_shaft(each), t, 20.0 * t, np.full(100, 20.0), np.zeros(100), substeps=4).piece_torque_Nm
        for each in (bare, rough)
    ]
    assert np.mean(torques[1][:, 0] - torques[0][:, 0]) == pytest.approx(5.0, abs=0.02)


def test_what_a_chain_cannot_have_is_refused() -> None:
    with pytest.raises(MachineError, match="has a rigid shaft; give it a `shaft`"):
        elastic_shaft(ttc.machines.tufting())
    bare = replace(wide(), shaft=EvenShaft(0.06, 4.0, 16, density_kg_m3=0.0).main_shaft())
    with pytest.raises(MachineError, match="station 's0' has no inertia; give it `inertia_kgm2`"):
        elastic_shaft(bare)
    with pytest.raises(MotionError, match="there is no station 's99'; stations: s0, s1"):
        follow_motion(elastic_shaft(wide()), [0.0, 1.0], [0.0, 0.1], [0.1, 0.1], [0.0, 0.0], substeps=4).number("s99")


def test_damping_of_points_and_friction_of_the_shaft_act_as_in_the_rigid_engine() -> None:
    """Loads by the first power of the speed, dry friction and a flywheel, on a shaft that is all but rigid."""
    loads = (PointDamping("F", 40.0), ShaftFriction(0.3, 2.0))
    shaft = EvenShaft(0.2, 0.1, 2, density_kg_m3=0.0, drive=ShaftDrive(inertia_kgm2=1.0))
    tufting = ttc.machines.tufting()
    bodies = (*tufting.bodies, Body("main_shaft", 5.0, 0.02))
    elastic = replace(tufting, loads=loads, bodies=bodies, shaft=shaft.main_shaft(), linkages=shaft.places())
    t = 1e-3 * np.arange(300)
    motion = np.array([ripple(time) for time in t]).T
    found = follow_motion(elastic_shaft(elastic), t, *motion, substeps=32)
    rigid = ttc.compile(elastic, ["balancing_torque_Nm"]).evaluate(*motion)["balancing_torque_Nm"]
    needed = found.drive_torque_Nm - motion[2]
    np.testing.assert_allclose(needed, rigid, rtol=0.0, atol=2e-5 * np.abs(rigid).max())
