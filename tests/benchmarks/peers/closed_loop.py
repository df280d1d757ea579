"""Inverse dynamics of a closed linkage by an engine for trees: the loop is closed on the engine's kinematics.

Timed, per sample: joint positions from a table accurate to 1e-5, two steps of Newton's method on the engine's gaps and
Jacobians at the cut pins, joint velocities and accelerations that satisfy the pins, the engine's inverse
dynamics of the
tree, and its projection onto the shaft (principle of virtual work). Friction of the backing is added by a test of the
needle position that the engine gives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.bench.scenes import Workload
from textile_twin_core.bench.timing import Candidate

from .planar_tree import PlanarTree, planar_tree

TORQUE = "balancing_torque_Nm"
SAMPLES = 500
_CLOSED_M = 1e-15
_STEPS = 20


class TreeEngine(Protocol):
    """Functions of an engine for a tree; joints are in the order of the tree."""

    def place(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Move to joint positions; return the gaps of the cut pins, later minus earlier, x then y [m], and their
        Jacobian.
        """
        ...

    def drift(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return the acceleration of the gaps at joint velocities with zero joint accelerations [m/s^2]."""
        ...

    def inverse(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return the generalised forces of the tree for a motion, gravity included [N m, N]."""
        ...

    def tip(self) -> FloatArray:
        """Return the position of the needle tip at the present joint positions [m]."""
        ...


class Solved(NamedTuple):
    """One sample: torque [N m], travel [m], friction torque [N m], and intermediate results.

    These are the joint motion, its derivative by theta, the inverse of the passive joints' Jacobian, the tree's forces.
    """

    torque: float
    travel: float
    friction: float
    q: FloatArray
    v: FloatArray
    a: FloatArray
    slope: FloatArray
    inverse: FloatArray
    forces: FloatArray


class ClosedLoop:
    """Tree with closed cut pins."""

    def __init__(self, tree: PlanarTree, engine: TreeEngine) -> None:
        self.tree = tree
        self.engine = engine

    def assemble(self, theta: float) -> tuple[FloatArray, FloatArray]:
        """Return joint positions at theta by Newton's method, and the Jacobian of the gaps there."""
        q = self.tree.near(theta)
        for _ in range(_STEPS):
            gaps, jacobian = self.engine.place(q)
            if max(map(abs, gaps.tolist())) < _CLOSED_M:
                return q, jacobian
            q[1:] -= np.linalg.solve(jacobian[:, 1:], gaps)
        raise ArithmeticError(f"the loop does not close at {theta!r} rad")

    def travel(self) -> float:
        """Return the travel of the needle at the present joint positions [m]."""
        needle = self.tree.needle
        if needle is None:
            return 0.0
        x, y = (float(v) for v in self.engine.tip()[:2])
        return (x - needle.origin[0]) * needle.direction[0] + (y - needle.origin[1]) * needle.direction[1]

    def position(self, theta: float, omega: float, alpha: float) -> float:
        """Return the travel of the needle at theta [m]."""
        self.assemble(theta)
        return self.travel()

    def solve(self, theta: float, omega: float, alpha: float) -> Solved:
        """Return torque [N m] and travel [m] with the intermediate results."""
        q, jacobian = self.assemble(theta)
        inverse = np.asarray(np.linalg.inv(jacobian[:, 1:]), dtype=np.float64)
        slope = np.empty(q.size)
        slope[0], slope[1:] = 1.0, -(inverse @ jacobian[:, 0])
        v = slope * omega
        a = slope * alpha
        a[1:] -= inverse @ self.engine.drift(q, v)
        forces = self.engine.inverse(q, v, a)
        travel, needle, friction = self.travel(), self.tree.needle, 0.0
        if needle is not None:
            friction = needle.friction(travel, needle.sense * float(slope[needle.body]), omega)
        torque = float(slope @ forces) + friction
        return Solved(torque, travel, friction, q, v, a, slope, inverse, forces)


def projected(scene: Workload, library: str, engine: Callable[[PlanarTree], TreeEngine]) -> Iterator[Candidate]:
    """Build the engine for the scene's machine, if it has pins and sliders only and the outputs are torque and
    travel.
    """
    tree = planar_tree(scene.machine)
    if tree is None:
        return
    travel = tree.needle.output if tree.needle else ""
    if not set(scene.outputs) <= {TORQUE, travel}:
        return
    loop = ClosedLoop(tree, engine(tree))
    if TORQUE in scene.outputs:

        def sample(theta: float, omega: float, alpha: float) -> tuple[float, ...]:
            solved = loop.solve(theta, omega, alpha)
            return tuple(solved.torque if name == TORQUE else solved.travel for name in scene.outputs)
    else:

        def sample(theta: float, omega: float, alpha: float) -> tuple[float, ...]:
            return (loop.position(theta, omega, alpha),)

    yield one_by_one(scene, library, "projection", sample)


def one_by_one(
    scene: Workload,
    library: str,
    method: str,
    sample: Callable[[float, float, float], tuple[float, ...]],
    outputs: Sequence[str] | None = None,
    note: str = "",
) -> Candidate:
    """Build a candidate without a batch mode: the first samples in a Python loop.

    `sample` returns the outputs of the scene, or the named ones.
    """
    names = scene.outputs if outputs is None else outputs
    samples = min(SAMPLES, scene.samples)
    motion = [tuple(row) for row in np.column_stack([x[:samples] for x in scene.motion]).tolist()]
    found = np.empty((samples, len(names)))

    def batch() -> None:
        for k, state in enumerate(motion):
            found[k] = sample(*state)

    return Candidate(
        method,
        library,
        batch=batch,
        samples=samples,
        single=lambda: sample(*motion[0]),
        result=lambda: dict(zip(names, found.T, strict=True)),
        note=note,
    )
