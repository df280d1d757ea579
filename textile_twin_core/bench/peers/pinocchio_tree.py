"""Pinocchio: kinematics, Jacobians and recursive Newton-Euler algorithm of the tree, one sample at a time from Python.

Timed: all of `closed_loop`. Pinocchio has no inverse dynamics over arrays, so its batch is a loop of Python.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from textile_twin_core.arrays import FloatArray
from textile_twin_core.bench.peers.closed_loop import projected
from textile_twin_core.bench.peers.planar_tree import PlanarTree, Point
from textile_twin_core.bench.scenes import Scene
from textile_twin_core.bench.timing import Candidate


class PinocchioTree:
    """The tree as a Pinocchio model; a frame at either side of every cut and one at the needle's tip."""

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
        """Gaps and Jacobian at the cut pins."""
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


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Torque and travel by projection."""
    yield from projected(scene, "pinocchio", PinocchioTree)
