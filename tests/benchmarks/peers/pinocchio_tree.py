"""Pinocchio: kinematics, Jacobians and recursive Newton-Euler algorithm of the tree, one sample at a time from Python.

Timed: all steps of `closed_loop`. Pinocchio has no inverse dynamics over arrays, so the batch is a Python loop.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from textile_twin_core.arrays import FloatArray
from textile_twin_core.bench.scenes import Workload
from textile_twin_core.bench.timing import Candidate

from .closed_loop import TORQUE, ClosedLoop, one_by_one, projected
from .planar_tree import GROUND, PlanarTree, Point, planar_tree


class PinocchioTree:
    """Tree as a Pinocchio model, with frames on both sides of every cut and at the needle tip."""

    def __init__(self, tree: PlanarTree) -> None:
        self.model = model = pin.Model()
        model.gravity = pin.Motion(np.array([*tree.gravity, 0.0]), np.zeros(3))
        for j in tree.joints:
            kind = pin.JointModelRZ() if j.axis is None else pin.JointModelPrismaticUnaligned(np.array([*j.axis, 0.0]))
            joint = model.addJoint(j.parent + 1, kind, _at(j.at), f"{j.name}{len(model.names)}")
            inertia = pin.Inertia(j.mass_kg, np.array([*j.centroid_m, 0.0]), np.diag([0.0, 0.0, j.inertia_kgm2]))
            model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
        self._cuts = [
            (self._frame(f"{c.name} later", c.later, c.at_later), self._frame(c.name, c.earlier, c.at_earlier))
            for c in tree.cuts
        ]
        self._tip = self._frame("tip", tree.needle.body, tree.needle.at) if tree.needle else 0
        self.data = model.createData()
        self._zero = np.zeros(model.nv)

    def _frame(self, name: str, joint: int, at: Point) -> int:
        return int(self.model.addFrame(pin.Frame(name, joint + 1, 0, _at(at), pin.FrameType.OP_FRAME)))

    def place(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return gaps and Jacobian at the cut pins."""
        model, data = self.model, self.data
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        gaps = np.empty(2 * len(self._cuts))
        jacobian = np.empty((gaps.size, model.nv))
        for k, (later, earlier) in enumerate(self._cuts):
            gaps[2 * k : 2 * k + 2] = (data.oMf[later].translation - data.oMf[earlier].translation)[:2]
            moved = pin.getFrameJacobian(model, data, later, pin.LOCAL_WORLD_ALIGNED)
            rest = pin.getFrameJacobian(model, data, earlier, pin.LOCAL_WORLD_ALIGNED)
            jacobian[2 * k : 2 * k + 2] = moved[:2] - rest[:2]
        return gaps, jacobian

    def drift(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Acceleration of the gaps while the joints do not accelerate."""
        model, data = self.model, self.data
        pin.forwardKinematics(model, data, q, v, self._zero)
        drift = np.empty(2 * len(self._cuts))
        for k, (later, earlier) in enumerate(self._cuts):
            moved = pin.getFrameClassicalAcceleration(model, data, later, pin.LOCAL_WORLD_ALIGNED).linear
            rest = pin.getFrameClassicalAcceleration(model, data, earlier, pin.LOCAL_WORLD_ALIGNED).linear
            drift[2 * k : 2 * k + 2] = (moved - rest)[:2]
        return drift

    def inverse(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Recursive Newton-Euler algorithm."""
        forces: FloatArray = pin.rnea(self.model, self.data, q, v, a)
        return forces

    def tip(self) -> FloatArray:
        """Position of the needle's tip."""
        position: FloatArray = self.data.oMf[self._tip].translation
        return position


def _at(point: Point) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([*point, 0.0]))


class Reactions:
    """Torque, motion of links and needle, and the forces in all joints, by a second pass with the cut pins' forces."""

    def __init__(self, tree: PlanarTree) -> None:
        self.tree = tree
        self.engine = PinocchioTree(tree)
        self.loop = ClosedLoop(tree, self.engine)

    def names(self) -> list[str]:
        """Names of the values of `sample`, in its order."""
        links = [link.removeprefix("l") for link in self.tree.links]
        pins = [j.name for j in self.tree.joints if j.axis is None] + [cut.name for cut in self.tree.cuts]
        needle = self.tree.needle
        travel = [needle.output] if needle else []
        travel += [travel[0].replace("position_m", rate) for rate in ("velocity_m_s", "acceleration_m_s2") if needle]
        rates = [f"{what}_{link}_rad_{unit}" for link in links for what, unit in (("omega", "s"), ("alpha", "s2"))]
        guides = [f"reaction_{j.name}_N" for j in self.tree.joints if j.axis is not None]
        return [TORQUE, *travel, *rates, *(f"reaction_{pin}_{axis}_N" for pin in pins for axis in "xy"), *guides]

    def sample(self, theta: float, omega: float, alpha: float) -> tuple[float, ...]:
        """One sample of all of them."""
        tree, model, data = self.tree, self.engine.model, self.engine.data
        solved = self.loop.solve(theta, omega, alpha)
        found, missing = [solved.torque], solved.forces.copy()
        outside = np.zeros((model.njoints, 3))  # force and moment about the frame's origin, in the machine's axes
        if tree.needle is not None:
            body, sense = tree.needle.body, tree.needle.sense
            found += [solved.travel, sense * solved.v[body], sense * solved.a[body]]
            along, slope = tree.joints[body].axis, solved.slope[body]
            if along is not None and slope != 0.0:
                missing[body] += solved.friction / slope
                outside[body + 1, :2] -= solved.friction / slope * np.array(along)
        pulls = (missing[1:] @ solved.inverse).reshape(-1, 2)
        for cut, pull in zip(tree.cuts, pulls, strict=True):
            for body, at, force in ((cut.later, cut.at_later, pull), (cut.earlier, cut.at_earlier, -pull)):
                x, y = data.oMi[body + 1].rotation[:2, :2] @ at
                outside[body + 1] += (*force, x * force[1] - y * force[0])
        forces = pin.StdVec_Force()
        for placement, (x, y, moment) in zip(data.oMi, outside, strict=True):
            forces.append(pin.Force(placement.rotation.T @ (x, y, 0.0), np.array([0.0, 0.0, moment])))
        pin.rnea(model, data, solved.q, solved.v, solved.a, forces)
        turning: list[tuple[float, float]] = []
        for j, v, a in zip(tree.joints, solved.v, solved.a, strict=True):
            before = (0.0, 0.0) if j.parent == GROUND else turning[j.parent]
            turning.append((before[0] + v, before[1] + a) if j.axis is None else before)
        found += [rate for body in tree.links.values() for rate in turning[body]]
        held = [(data.oMi[k].rotation @ data.f[k].linear)[:2] for k in range(1, model.njoints)]
        axes = [j.axis for j in tree.joints]
        found += [x for force, axis in zip(held, axes, strict=True) if axis is None for x in force]
        found += pulls.ravel().tolist()
        across = [force[1] * axis[0] - force[0] * axis[1] for force, axis in zip(held, axes, strict=True) if axis]
        return (*found, *across)


def candidates(scene: Workload) -> Iterator[Candidate]:
    """Torque and travel by projection; where reactions are asked for, all that a second pass gives."""
    yield from projected(scene, "pinocchio", PinocchioTree)
    tree = planar_tree(scene.machine)
    if tree is None or not any(name.startswith("reaction_") for name in scene.outputs):
        return
    reactions = Reactions(tree)
    names = reactions.names()
    left_out = ", ".join(name for name in scene.outputs if name not in names)
    note = f"without {left_out}" if left_out else ""
    if set(names) <= set(scene.outputs):
        yield one_by_one(scene, "pinocchio", "projection, two passes", reactions.sample, outputs=names, note=note)
