"""A loom's six-bar beat-up of two RRR dyads in Pinocchio and pylinkage.

The second dyad hangs on an arm of the first rocker, so that no pin joins three links.
"""

from __future__ import annotations

import cmath
import math

import numpy as np
import pylinkage

import textile_twin_core as ttc
from tests.engine_peers.meeting import meeting
from tests.engine_peers.pinocchio_planar import Floats, PlanarTree
from textile_twin_core.dynamics import Body
from textile_twin_core.mechanism import Crank, RigidArm, RRRDyad

CRANK, COUPLER, ROCKER, ARM, LINK, SLEY = 0.055, 0.210, 0.190, 0.160, 0.240, 0.280
C, G = complex(0.230, -0.060), complex(0.330, -0.310)
BEND = math.radians(-35.0)
BODIES = {
    "l1": (0.35, 2.1e-4, 0.4, 0.0),
    "l2": (0.52, 2.4e-3, 0.5, 0.03),
    "l3": (0.61, 2.9e-3, 0.55, -0.05),
    "l4": (0.44, 1.3e-3, 0.5, 0.0),
    "l5": (0.49, 3.0e-3, 0.48, 0.0),
    "l6": (2.80, 2.3e-2, 0.83, 0.10),
}
LENGTHS = dict(zip(BODIES, (CRANK, COUPLER, ROCKER, ARM, LINK, SLEY), strict=True))


def loom() -> ttc.Machine:
    return ttc.Machine(
        name="six_bar_loom",
        points={"O": (0.0, 0.0), "C": (C.real, C.imag), "G": (G.real, G.imag)},
        groups=(
            Crank("l1", at="O", end="A", length_m=CRANK),
            RRRDyad("l2", "l3", from_point="A", ground="C", end="B", lengths_m=(COUPLER, ROCKER)),
            RigidArm("l4", on="l3", end="D", length_m=ARM, angle_rad=BEND),
            RRRDyad("l5", "l6", from_point="D", ground="G", end="E", lengths_m=(LINK, SLEY)),
        ),
        bodies=tuple(Body(name, m, j, (s, t)) for name, (m, j, s, t) in BODIES.items()),
    )


def tree() -> PlanarTree:
    """The same linkage, cut at B and E."""
    peer = PlanarTree()
    crank = peer.turning("O", 0, (0.0, 0.0))
    coupler = peer.turning("A", crank, (CRANK, 0.0))
    rocker = peer.turning("C", 0, (C.real, C.imag))
    arm = cmath.rect(1.0, BEND)
    link = peer.turning("D", rocker, ((ARM * arm).real, (ARM * arm).imag))
    sley = peer.turning("G", 0, (G.real, G.imag))
    carriers = {"l1": crank, "l2": coupler, "l3": rocker, "l4": rocker, "l5": link, "l6": sley}
    for name, (mass, inertia, along, across) in BODIES.items():
        centroid = LENGTHS[name] * complex(along, across) * (arm if name == "l4" else 1.0)
        peer.body(carriers[name], mass, inertia, (centroid.real, centroid.imag))
    peer.close("B", rocker, (ROCKER, 0.0), coupler, (COUPLER, 0.0))
    peer.close("E", sley, (SLEY, 0.0), link, (LINK, 0.0))
    return peer


def points(theta: float) -> tuple[complex, complex, complex, complex]:
    """A, B, D, E."""
    a = cmath.rect(CRANK, theta)
    b = meeting(a, C, COUPLER, ROCKER, left=True)
    d = C + cmath.rect(ARM, cmath.phase(b - C) + BEND)
    return a, b, d, meeting(d, G, LINK, SLEY, left=True)


def guess(theta: float) -> Floats:
    a, b, d, e = points(theta)
    rocker = cmath.phase(b - C)
    return np.array([theta, cmath.phase(b - a) - theta, rocker, cmath.phase(e - d) - rocker, cmath.phase(e - G)])


def test_torque_and_reactions_as_in_pinocchio() -> None:
    outputs = ["balancing_torque_Nm", *(f"reaction_{p}_{axis}_N" for p in "OABCDEG" for axis in "xy")]
    rng = np.random.default_rng(9)
    theta = np.concatenate([np.linspace(0.0, 2.0 * math.pi, 61), rng.uniform(-9.0, 9.0, 60)])
    omega = np.concatenate([np.full(61, 22.0), rng.uniform(-30.0, 30.0, 60)])
    alpha = np.concatenate([np.zeros(61), rng.uniform(-400.0, 400.0, 60)])
    ours = ttc.compile(loom(), outputs=outputs, method="exact").evaluate(theta, omega, alpha)
    peer = tree()
    theirs = {name: np.empty(theta.size) for name in outputs}
    for k, motion in enumerate(zip(theta.tolist(), omega.tolist(), alpha.tolist(), strict=True)):
        theirs["balancing_torque_Nm"][k], reactions, _ = peer.solve(motion, guess(motion[0]))
        for p in "OABCDEG":
            theirs[f"reaction_{p}_x_N"][k], theirs[f"reaction_{p}_y_N"][k] = reactions[p]
    for name in outputs:
        assert np.abs(ours[name] - theirs[name]).max() < 3e-14 * np.abs(theirs[name]).max(), name


def test_positions_as_in_pylinkage() -> None:
    """A full turn in steps of one degree, so that pylinkage's choice of the nearer branch is ours too."""
    _, b, _, e = points(0.0)
    origin, centre, pivot = (pylinkage.Ground(p.real, p.imag) for p in (0j, C, G))
    crank = pylinkage.Crank(origin, CRANK, math.radians(1.0), 0.0)
    joint = pylinkage.RRRDyad(crank.output, centre, COUPLER, ROCKER, x=b.real, y=b.imag)
    elbow = pylinkage.FixedDyad(centre, joint, ARM, BEND)
    sley = pylinkage.RRRDyad(elbow, pivot, LINK, SLEY, x=e.real, y=e.imag)
    linkage = pylinkage.Linkage([origin, centre, pivot, crank, joint, elbow, sley])
    theirs = np.array([positions[-4:] for positions in linkage.step(360)])
    outputs = [f"point_{p}_{axis}_m" for p in "ABDE" for axis in "xy"]
    theta = np.radians(np.arange(1.0, 361.0))
    ours = ttc.compile(loom(), outputs=outputs, method="exact").evaluate(theta, 0.0, 0.0)
    for column, p in enumerate("ABDE"):
        for row, axis in enumerate("xy"):
            assert np.abs(ours[f"point_{p}_{axis}_m"] - theirs[:, column, row]).max() < 1e-13
