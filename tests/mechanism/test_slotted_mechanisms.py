"""Whitworth, shaper, oscillating cylinder, Scotch yoke and geared five-bar by equations of their own, and by energy.

The energy is Pinocchio's, of the robot description at the joint positions and speeds that the twin gives: at a constant
speed of the shaft the torque is its derivative by the angle, taken by Fourier's series.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pinocchio
import pytest

import textile_twin_core as ttc
from tests.engine_peers.meeting import meeting
from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics import Body
from textile_twin_core.machine import Machine
from textile_twin_core.mechanism import Crank, GearPair, Guide, PRPDyad, RPPDyad, RPRDyad, RRPDyad, RRRDyad

COUNT, OMEGA = 256, 8.0
THETA = 2.0 * math.pi * np.arange(COUNT) / COUNT
CRANK = Crank("crank", "O", "A", 0.11)
BODIES = {
    "crank": Body("crank", 1.2, 1.5e-3, (0.4, 0.1)),
    "slider": Body("slider", 0.4, 3e-4, (0.2, -0.3)),
    "lever": Body("lever", 2.4, 0.03, (0.45, 0.05)),
    "rod": Body("rod", 0.7, 2e-3),
    "ram": Body("ram", 5.0, 0.02, (0.3, 0.2)),
    "gear": Body("gear", 0.5, 4e-4, (0.3, 0.1)),
    "coupler": Body("coupler", 0.4, 9e-4),
    "rocker": Body("rocker", 0.35, 8e-4, (0.5, 0.2)),
}


def machine(name: str, points: dict[str, tuple[float, float]], *groups: object) -> Machine:
    bare = Machine(name, {"O": (0.0, 0.0), **points}, groups)  # type: ignore[arg-type]
    return dataclasses.replace(bare, bodies=tuple(BODIES[link] for link in bare.linkage.solved.links))


WHITWORTH = machine(
    "whitworth", {"C": (0.0, -0.04)}, CRANK, RPRDyad("slider", "lever", "A", "C", "B", "T", (0.03, 0.2))
)
"""The crank is longer than the distance of the axes, so the lever turns fully."""
SHAPER = machine(
    "shaper",
    {"C": (0.0, -0.25)},
    CRANK,
    RPRDyad("slider", "lever", "A", "C", "B", "T", (0.03, 0.5), offset_m=0.02),
    RRPDyad("rod", "ram", "B", "D", "E", (0.2, 0.3), (0.0, 0.22), (1.0, 0.0)),
)
BLOCK_SHAPER = machine(
    "block shaper",
    {"C": (0.0, -0.25)},
    CRANK,
    RPRDyad("slider", "lever", "A", "C", "B", "T", (0.03, 0.5)),
    PRPDyad(("rod", "ram"), "D", ("S", "E"), (0.05, 0.3), (Guide("lever"), Guide(None, (0.0, 0.22)))),
)
CYLINDER = machine("cylinder", {"C": (0.4, 0.05)}, CRANK, RPRDyad("slider", "lever", "C", "A", "B", "T", (0.1, 0.15)))
YOKE = machine("yoke", {}, CRANK, RPPDyad("slider", "ram", "A", "Q", ("S", "T"), (0.04, 0.3), (0.0, 0.02), (1.0, 0.0)))
FIVE_BAR = machine(
    "five-bar",
    {"C": (0.3, 0.0)},
    CRANK,
    GearPair("gear", "O", "C", "D", 0.06, (40, 20), "crank", phase_rad=0.7),
    RRRDyad("coupler", "rocker", "A", "D", "B", (0.33, 0.27), "left"),
)
ALL = (WHITWORTH, SHAPER, BLOCK_SHAPER, CYLINDER, YOKE, FIVE_BAR)


def values(of: Machine, *names: str) -> list[FloatArray]:
    found = ttc.compile(of, list(names), method="exact").evaluate(THETA, OMEGA, 0.0)
    return [np.broadcast_to(found[name], THETA.shape) for name in names]


def point(of: Machine, name: str) -> FloatArray:
    x, y = values(of, f"point_{name}_x_m", f"point_{name}_y_m")
    return np.asarray(x + 1j * y)


PIN = 0.11 * np.exp(1j * THETA)


def test_whitworth() -> None:
    """The lever points from its pivot to the pin; its cutting half turn takes more than half a turn of the crank."""
    angle, speed, way = values(WHITWORTH, "theta_lever_rad", "omega_lever_rad_s", "joint_slider_position")
    wanted = np.unwrap(np.arctan2(PIN.imag + 0.04, PIN.real))
    assert np.abs(np.exp(1j * angle) - np.exp(1j * wanted)).max() < 1e-14
    assert np.abs(np.diff(angle) - np.diff(wanted)).max() < 1e-14
    assert np.abs(way - np.abs(PIN + 0.04j)).max() < 1e-15
    rate = 0.11 * (0.11 + 0.04 * np.sin(THETA)) / np.abs(PIN + 0.04j) ** 2  # law of cosines, differentiated
    assert np.abs(speed - OMEGA * rate).max() < 1e-13 * OMEGA
    slow = (math.pi + 2.0 * math.asin(0.04 / 0.11)) / (2.0 * math.pi)  # share of the turn with the lever upwards
    assert np.mean(np.sin(angle) >= 0.0) == pytest.approx(slow, abs=1.0 / COUNT)


def test_shaper() -> None:
    """The angle follows from the tangent from the pivot to the circle of the offset, the link from Pythagoras."""
    reach = PIN + 0.25j
    lever = reach / (np.sqrt(np.abs(reach) ** 2 - 0.02**2) + 0.02j)
    assert np.abs(np.abs(lever) - 1.0).max() < 1e-14
    end = -0.25j + 0.5 * lever
    ram = end.real + np.sqrt(0.2**2 - (end.imag - 0.22) ** 2)
    assert np.abs(point(SHAPER, "D") - (ram + 0.22j)).max() < 1e-12
    assert np.abs(point(SHAPER, "B") - end).max() < 1e-12


def test_shaper_with_a_block() -> None:
    """The lever's line cuts the ram's: similar triangles."""
    reach = PIN + 0.25j
    assert np.abs(point(BLOCK_SHAPER, "D") - (reach.real / reach.imag * 0.47 + 0.22j)).max() < 1e-12


def test_oscillating_cylinder() -> None:
    """The piston rod points from the crank's pin to the cylinder's trunnion."""
    way = 0.4 + 0.05j - PIN
    (stroke,) = values(CYLINDER, "joint_slider_position")
    assert np.abs(stroke - np.abs(way)).max() < 1e-12
    assert np.abs(point(CYLINDER, "B") - (PIN + 0.15 * way / np.abs(way))).max() < 1e-12


def test_scotch_yoke() -> None:
    """The yoke follows the pin's cosine, without harmonics."""
    assert np.abs(point(YOKE, "Q") - (0.11 * np.cos(THETA) + 0.02j)).max() < 1e-12
    (way, force) = values(YOKE, "joint_slider_position", "reaction_A_x_N")
    assert np.abs(way - (0.11 * np.sin(THETA) - 0.02)).max() < 1e-12
    carried = 5.4 * 0.11 * OMEGA**2 * np.cos(THETA)  # slider and ram go along x as the pin does
    assert np.abs(force + carried).max() < 1e-12 * np.abs(carried).max()


def test_geared_five_bar() -> None:
    """The second crank turns twice in the opposite direction; two circles give the joint."""
    second = 0.3 + 0.06 * np.exp(1j * (0.7 - 2.0 * THETA))
    assert np.abs(point(FIVE_BAR, "D") - second).max() < 1e-12
    wanted = [meeting(a, d, 0.33, 0.27, left=True) for a, d in zip(PIN.tolist(), second.tolist(), strict=True)]
    assert np.abs(point(FIVE_BAR, "B") - np.array(wanted)).max() < 1e-12


@pytest.mark.parametrize("of", ALL, ids=lambda of: of.name)
def test_torque_by_both_routes_and_by_the_energy_of_pinocchio(of: Machine) -> None:
    names = ["balancing_torque_Nm", "balancing_torque_newton_euler_Nm", "kinetic_energy_J", "potential_energy_J"]
    torque, joints, kinetic, potential = values(of, *names)
    peak = np.abs(torque).max()
    assert np.abs(torque - joints).max() < 1e-12 * peak
    theirs = energies(of)
    assert np.abs(theirs[0] - kinetic).max() < 1e-12 * kinetic.max()
    assert np.abs(np.diff(theirs[1] - potential)).max() < 1e-12 * np.ptp(potential)
    spectrum = np.fft.fft(theirs[0] + theirs[1])
    slope = np.fft.ifft(1j * np.fft.fftfreq(COUNT, 1.0 / COUNT) * spectrum).real
    assert np.abs(slope - torque).max() < 1e-8 * peak


def energies(of: Machine) -> tuple[FloatArray, FloatArray]:
    """Compute kinetic and potential energy [J] of the robot description by Pinocchio."""
    model = pinocchio.buildModelFromXML(of.urdf())
    data = model.createData()
    moved = {name: values(of, *outputs) for name, outputs in of.joint_outputs.items()}
    kinetic, potential = np.empty(COUNT), np.empty(COUNT)
    for k in range(COUNT):
        q, v = pinocchio.neutral(model), np.zeros(model.nv)
        for name, (position, velocity) in moved.items():
            joint = model.joints[model.getJointId(name)]
            place = position[k]
            q[joint.idx_q : joint.idx_q + joint.nq] = place if joint.nq == 1 else (math.cos(place), math.sin(place))
            v[joint.idx_v] = velocity[k]
        kinetic[k] = pinocchio.computeKineticEnergy(model, data, q, v)
        potential[k] = pinocchio.computePotentialEnergy(model, data, q)
    return kinetic, potential
