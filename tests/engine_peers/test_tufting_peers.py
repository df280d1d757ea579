"""The tufting machine in Pinocchio and pylinkage."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pylinkage

import textile_twin_core as ttc
from tests.engine_peers.meeting import meeting
from tests.engine_peers.pinocchio_planar import PlanarTree

BETA = math.radians(168.0)
C = complex(0.070, 0.155)
PINS = "OABCDE"
RNG = np.random.default_rng(801)
THETA = np.concatenate([np.linspace(0.0, 2.0 * math.pi, 73), RNG.uniform(-6.0, 12.0, 60)])
OMEGA = np.concatenate([np.full(73, 16.0 * math.pi / 3.0), RNG.uniform(-25.0, 25.0, 60)])
ALPHA = np.concatenate([np.zeros(73), RNG.uniform(-300.0, 300.0, 60)])


def tufting_tree() -> PlanarTree:
    """Xu et al. 2016, Table 1, cut at B and E."""
    tree = PlanarTree()
    crank = tree.turning("O", 0, (0.0, 0.0))
    coupler = tree.turning("A", crank, (0.015, 0.0))
    rocker = tree.turning("C", 0, (0.070, 0.155))
    elbow = (0.125 * math.cos(BETA), 0.125 * math.sin(BETA))
    rod = tree.turning("D", rocker, elbow)
    slider = tree.sliding_along_y("guide", 0, (0.170, 0.0))
    tree.body(crank, 3.07, 4.34e-3, (0.0075, 0.0))
    tree.body(coupler, 3.79, 26.99e-3, (0.069, 0.0))
    tree.body(rocker, 2.96, 10.77e-3, (0.0575, 0.0))
    tree.body(rocker, 1.74, 6.69e-3, (elbow[0] / 2.0, elbow[1] / 2.0))
    tree.body(rod, 0.36, 0.91e-3, (0.060, 0.0))
    tree.body(slider, 1.47, 19.15e-3, (0.0, -0.220))
    tree.close("B", rocker, (0.115, 0.0), coupler, (0.138, 0.0))
    tree.close("E", slider, (0.0, 0.0), rod, (0.120, 0.0))
    return tree


def guess(theta: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Joint positions near the assembly that the paper shows."""
    crank = cmath.rect(0.015, theta)
    joint = meeting(crank, C, 0.138, 0.115, left=True)
    rocker = cmath.phase(joint - C) % (2.0 * math.pi)
    elbow = C + cmath.rect(0.125, rocker + BETA)
    rod = 2.0 * math.pi - math.acos((0.170 - elbow.real) / 0.120)
    height = elbow.imag + 0.120 * math.sin(rod)
    return np.array([theta, cmath.phase(joint - crank) - theta, rocker, rod - rocker, height])


def backing(theta: float, omega: float) -> float:
    """Force of the backing on the needle bar, upwards [N]: 1000 N against the motion below 557.84 mm under C."""
    height, climb = guess(theta)[4], (guess(theta + 1e-6)[4] - guess(theta - 1e-6)[4]) * omega
    return 1000.0 * -float(np.sign(climb)) if C.imag - (height - 0.440) >= 0.55784 else 0.0


def test_torque_and_reactions_as_in_pinocchio() -> None:
    outputs = ["balancing_torque_Nm", "reaction_guide_N"]
    outputs += [f"reaction_{p}_{axis}_N" for p in PINS for axis in "xy"]
    ours = ttc.compile(ttc.machines.tufting(), outputs=outputs, method="exact").evaluate(THETA, OMEGA, ALPHA)
    tree = tufting_tree()
    theirs = {name: np.empty(THETA.size) for name in outputs}
    for k, motion in enumerate(zip(THETA.tolist(), OMEGA.tolist(), ALPHA.tolist(), strict=True)):
        force = (0.0, backing(motion[0], motion[1]))
        torque, reactions, _ = tree.solve(motion, guess(motion[0]), force=(5, force))
        theirs["balancing_torque_Nm"][k] = torque
        theirs["reaction_guide_N"][k] = reactions["guide"][0]
        for p in PINS:
            theirs[f"reaction_{p}_x_N"][k], theirs[f"reaction_{p}_y_N"][k] = reactions[p]
    for name in outputs:
        assert np.abs(ours[name] - theirs[name]).max() < 3e-14 * np.abs(theirs[name]).max(), name


def test_positions_as_in_pylinkage() -> None:
    """A full turn in steps of one degree, so that pylinkage's choice of the nearer branch is ours too."""
    centre, top, bottom = (pylinkage.Ground(x, y) for x, y in ((C.real, C.imag), (0.170, 1.0), (0.170, -1.0)))
    crank = pylinkage.Crank(pylinkage.Ground(0.0, 0.0), 0.015, math.radians(1.0), 0.0)
    b = meeting(0.015, C, 0.138, 0.115, left=True)
    joint = pylinkage.RRRDyad(crank.output, centre, 0.138, 0.115, x=b.real, y=b.imag)
    elbow = pylinkage.FixedDyad(centre, joint, 0.125, BETA)
    slider = pylinkage.RRPDyad(elbow, top, bottom, 0.120, x=0.170, y=0.04)
    linkage = pylinkage.Linkage([crank.anchor, centre, top, bottom, crank, joint, elbow, slider])
    theirs = np.array([positions[-4:] for positions in linkage.step(360)])
    theta = np.radians(np.arange(1.0, 361.0))
    outputs = [f"point_{p}_{axis}_m" for p in "ABDE" for axis in "xy"]
    ours = ttc.compile(ttc.machines.tufting(), outputs=outputs, method="exact").evaluate(theta, 0.0, 0.0)
    for column, p in enumerate("ABDE"):
        for row, axis in enumerate("xy"):
            assert np.abs(ours[f"point_{p}_{axis}_m"] - theirs[:, column, row]).max() < 1e-13
