"""A hundred random four-bars, cranks that turn fully with rockers or second cranks, in Pinocchio and pylinkage."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pylinkage
import pytest

import textile_twin_core as ttc
from tests.engine_peers.meeting import meeting
from tests.engine_peers.pinocchio_planar import Floats, PlanarTree
from textile_twin_core.dynamics import Body
from textile_twin_core.mechanism import Crank, RRRDyad

COUNT = 100
SAMPLES = 12
LEAST_TRANSMISSION_RAD = math.radians(5.0)
OUTPUTS = ["balancing_torque_Nm", *(f"reaction_{p}_{axis}_N" for p in "OABC" for axis in "xy")]


@dataclass(frozen=True)
class FourBar:
    """Lengths, pivots, branch, bodies as (mass, inertia, centroid along and across as fractions), gravity."""

    crank: float
    coupler: float
    rocker: float
    origin: complex
    pivot: complex
    left: bool
    bodies: tuple[tuple[float, float, float, float], ...]
    gravity: tuple[float, float]

    def machine(self) -> ttc.Machine:
        names = ("l1", "l2", "l3")
        branch: Literal["left", "right"] = "left" if self.left else "right"
        lengths = (self.coupler, self.rocker)
        return ttc.Machine(
            name="four_bar",
            points={
                "O": (self.origin.real, self.origin.imag),
                "C": (self.pivot.real, self.pivot.imag),
            },
            groups=(
                Crank("l1", at="O", end="A", length_m=self.crank),
                RRRDyad("l2", "l3", from_point="A", ground="C", end="B", lengths_m=lengths, branch=branch),
            ),
            bodies=tuple(Body(n, m, j, (s, t)) for n, (m, j, s, t) in zip(names, self.bodies, strict=True)),
            gravity_m_s2=self.gravity,
        )

    def tree(self) -> PlanarTree:
        tree = PlanarTree(gravity=self.gravity)
        crank = tree.turning("O", 0, (self.origin.real, self.origin.imag))
        coupler = tree.turning("A", crank, (self.crank, 0.0))
        rocker = tree.turning("C", 0, (self.pivot.real, self.pivot.imag))
        links = ((crank, self.crank), (coupler, self.coupler), (rocker, self.rocker))
        for (joint, length), (mass, inertia, along, across) in zip(links, self.bodies, strict=True):
            tree.body(joint, mass, inertia, (along * length, across * length))
        tree.close("B", rocker, (self.rocker, 0.0), coupler, (self.coupler, 0.0))
        return tree

    def coupler_point(self, theta: float) -> tuple[complex, complex]:
        """A and B."""
        a = self.origin + cmath.rect(self.crank, theta)
        return a, meeting(a, self.pivot, self.coupler, self.rocker, self.left)

    def guess(self, theta: float) -> Floats:
        a, b = self.coupler_point(theta)
        return np.array([theta, cmath.phase(b - a) - theta, cmath.phase(b - self.pivot)])


def random_four_bar(rng: np.random.Generator) -> FourBar:
    """A four-bar whose crank turns fully and whose transmission angle keeps off 0 and 180 degrees."""
    while True:
        crank, coupler, rocker, ground = rng.uniform(0.03, 0.5, 4)
        cosines = [
            (coupler**2 + rocker**2 - (ground + side * crank) ** 2) / (2.0 * coupler * rocker) for side in (-1.0, 1.0)
        ]
        if max(abs(c) for c in cosines) < math.cos(LEAST_TRANSMISSION_RAD):
            break
    origin = complex(*rng.uniform(-0.3, 0.3, 2))
    return FourBar(
        crank=float(crank),
        coupler=float(coupler),
        rocker=float(rocker),
        origin=origin,
        pivot=origin + cmath.rect(float(ground), float(rng.uniform(-math.pi, math.pi))),
        left=bool(rng.integers(2)),
        bodies=tuple(
            (float(m), float(j), float(s), float(t))
            for m, j, s, t in zip(
                rng.uniform(0.1, 5.0, 3),
                rng.uniform(1e-4, 3e-2, 3),
                rng.uniform(-0.3, 1.3, 3),
                rng.uniform(-0.5, 0.5, 3),
                strict=True,
            )
        ),
        gravity=(float(rng.uniform(-9.81, 9.81)), float(rng.uniform(-9.81, 9.81))),
    )


@pytest.fixture(scope="module")
def four_bars() -> list[FourBar]:
    rng = np.random.default_rng(20260614)
    return [random_four_bar(rng) for _ in range(COUNT)]


@pytest.mark.slow
def test_torque_and_reactions_as_in_pinocchio(four_bars: list[FourBar]) -> None:
    rng = np.random.default_rng(3)
    for number, bar in enumerate(four_bars):
        theta = rng.uniform(-math.pi, 3.0 * math.pi, SAMPLES)
        omega, alpha = rng.uniform(-30.0, 30.0, SAMPLES), rng.uniform(-500.0, 500.0, SAMPLES)
        ours = ttc.compile(bar.machine(), outputs=OUTPUTS, method="exact").evaluate(theta, omega, alpha)
        tree = bar.tree()
        theirs = {name: np.empty(SAMPLES) for name in OUTPUTS}
        for k, motion in enumerate(zip(theta.tolist(), omega.tolist(), alpha.tolist(), strict=True)):
            theirs["balancing_torque_Nm"][k], reactions, _ = tree.solve(motion, bar.guess(motion[0]))
            for p in "OABC":
                theirs[f"reaction_{p}_x_N"][k], theirs[f"reaction_{p}_y_N"][k] = reactions[p]
        force = max(float(np.abs(theirs[name]).max()) for name in OUTPUTS[1:])
        for name in OUTPUTS:
            scale = np.abs(theirs[name]).max() if name.endswith("Nm") else force
            assert np.abs(ours[name] - theirs[name]).max() < 5e-13 * scale, (number, name)


def test_positions_as_in_pylinkage(four_bars: list[FourBar]) -> None:
    """A full turn in steps of two degrees, so that pylinkage's choice of the nearer branch is ours too."""
    theta = np.radians(np.arange(2.0, 361.0, 2.0))
    for number, bar in enumerate(four_bars):
        _, b = bar.coupler_point(0.0)
        ground = pylinkage.Ground(bar.origin.real, bar.origin.imag)
        pivot = pylinkage.Ground(bar.pivot.real, bar.pivot.imag)
        crank = pylinkage.Crank(ground, bar.crank, math.radians(2.0), 0.0)
        joint = pylinkage.RRRDyad(crank.output, pivot, bar.coupler, bar.rocker, x=b.real, y=b.imag)
        linkage = pylinkage.Linkage([ground, pivot, crank, joint])
        theirs = np.array([positions[-1] for positions in linkage.step(theta.size)])
        twin = ttc.compile(bar.machine(), outputs=["point_B_x_m", "point_B_y_m"], method="exact")
        ours = twin.evaluate(theta, 0.0, 0.0)
        gap = np.hypot(ours["point_B_x_m"] - theirs[:, 0], ours["point_B_y_m"] - theirs[:, 1])
        assert gap.max() < 2e-13, number
