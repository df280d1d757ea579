"""MuJoCo: kinematics, Jacobians and recursive Newton-Euler algorithm of the tree, one sample at a time from Python.

Timed: all steps of `closed_loop`. A second candidate uses MuJoCo's soft constraints at the cut pins; two calls of its
forward dynamics give the torque for the requested acceleration at a closed position. MuJoCo's batch mode (rollout) has
no inverse dynamics, so the batch is a Python loop.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.bench.scenes import Workload
from textile_twin_core.bench.timing import Candidate

from .closed_loop import TORQUE, ClosedLoop, one_by_one, projected
from .planar_tree import GROUND, PlanarTree, planar_tree


class MuJoCoTree:
    """Tree as a MuJoCo model, with sites on both sides of every cut and at the needle tip.

    With `soft`, MuJoCo's equality constraints of this impedance (0 to 1) also close the cuts.
    """

    def __init__(self, tree: PlanarTree, soft: float | None = None) -> None:
        spec = mujoco.MjSpec()
        spec.option.gravity = [*tree.gravity, 0.0]
        bodies: list[Any] = []
        for k, j in enumerate(tree.joints):
            parent = spec.worldbody if j.parent == GROUND else bodies[j.parent]
            body = parent.add_body(name=f"body{k}", pos=[*j.at, 0.0])
            body.explicitinertial = True
            body.mass, body.ipos = j.mass_kg, [*j.centroid_m, 0.0]
            body.inertia = [j.inertia_kgm2] * 3
            if j.axis is None:
                body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 0.0, 1.0])
            else:
                body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[*j.axis, 0.0])
            bodies.append(body)
        for k, c in enumerate(tree.cuts):
            bodies[c.later].add_site(name=f"later{k}", pos=[*c.at_later, 0.0])
            bodies[c.earlier].add_site(name=f"earlier{k}", pos=[*c.at_earlier, 0.0])
            if soft is not None:
                pin = spec.add_equality(type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_SITE)
                pin.name1, pin.name2 = f"later{k}", f"earlier{k}"
                pin.solimp = [soft, soft, 1.0, 0.5, 2.0]
        if tree.needle is not None:
            bodies[tree.needle.body].add_site(name="tip", pos=[*tree.needle.at, 0.0])
        self.model = model = spec.compile()
        self.data = mujoco.MjData(model)
        self._bodies = [model.body(f"body{k}").id for k in range(len(tree.joints))]
        self._cuts = [
            (self._site(f"later{k}"), self._site(f"earlier{k}"), self._bodies[c.later], self._bodies[c.earlier])
            for k, c in enumerate(tree.cuts)
        ]
        self._tip = self._site("tip") if tree.needle else 0
        # MuJoCo numbers joints depth first, the tree numbers them in the order of its groups
        self.order = np.array([model.body(b).dofadr[0] for b in self._bodies])
        self._jacobians = np.zeros((2, 3, model.nv))
        self._forces = np.zeros(model.nv)

    def _site(self, name: str) -> int:
        return int(self.model.site(name).id)

    def place(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return gaps and Jacobian at the cut pins."""
        model, data, (moved, rest) = self.model, self.data, self._jacobians
        data.qpos[self.order] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        gaps = np.empty(2 * len(self._cuts))
        jacobian = np.empty((gaps.size, model.nv))
        for k, (later, earlier, _, _) in enumerate(self._cuts):
            gaps[2 * k : 2 * k + 2] = (data.site_xpos[later] - data.site_xpos[earlier])[:2]
            mujoco.mj_jacSite(model, data, moved, None, later)
            mujoco.mj_jacSite(model, data, rest, None, earlier)
            jacobian[2 * k : 2 * k + 2] = (moved[:2] - rest[:2])[:, self.order]
        return gaps, jacobian

    def drift(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return the acceleration of the gaps with zero joint accelerations."""
        model, data, (moved, rest) = self.model, self.data, self._jacobians
        data.qvel[self.order] = v
        mujoco.mj_comVel(model, data)
        drift = np.empty(2 * len(self._cuts))
        for k, (later, earlier, body, other) in enumerate(self._cuts):
            mujoco.mj_jacDot(model, data, moved, None, data.site_xpos[later], body)
            mujoco.mj_jacDot(model, data, rest, None, data.site_xpos[earlier], other)
            drift[2 * k : 2 * k + 2] = (moved[:2] - rest[:2]) @ data.qvel
        return drift

    def inverse(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Run the recursive Newton-Euler algorithm."""
        self.data.qacc[self.order] = a
        mujoco.mj_rne(self.model, self.data, 1, self._forces)
        forces: FloatArray = self._forces[self.order]
        return forces

    def tip(self) -> FloatArray:
        """Return the position of the needle tip."""
        position: FloatArray = self.data.site_xpos[self._tip]
        return position


class SoftLoop:
    """Loop closed by MuJoCo's equality constraints of finite stiffness at the cuts.

    The forward dynamics is linear in the applied torque, so two calls give the torque for an acceleration.
    """

    def __init__(self, tree: PlanarTree, impedance: float) -> None:
        self.tree = tree
        self.engine = MuJoCoTree(tree, impedance)
        self.loop = ClosedLoop(tree, self.engine)

    def torque(self, theta: float, omega: float, alpha: float) -> tuple[float]:
        """Return the balancing torque [N m] as a tuple of one."""
        model, data, crank, needle = self.engine.model, self.engine.data, self.engine.order[0], self.tree.needle
        _, jacobian = self.loop.assemble(theta)
        slope = np.concatenate([[1.0], -np.linalg.solve(jacobian[:, 1:], jacobian[:, 0])])
        data.qvel[self.engine.order] = slope * omega
        reached = []
        for torque in (0.0, 100.0):
            data.qfrc_applied[crank] = torque
            mujoco.mj_forward(model, data)
            reached.append(data.qacc[crank])
        torque = 100.0 * (alpha - reached[0]) / (reached[1] - reached[0])
        if needle is not None:
            torque += needle.friction(self.loop.travel(), needle.sense * slope[needle.body], omega)
        return (float(torque),)


def candidates(scene: Workload) -> Iterator[Candidate]:
    """Build torque and travel by projection, and the torque by soft constraints at their default and at full
    stiffness.
    """
    yield from projected(scene, "mujoco", MuJoCoTree)
    tree = planar_tree(scene.machine)
    if tree is not None and scene.outputs == (TORQUE,):
        for name, impedance in (("soft loop", 0.9), ("soft loop, tight", 0.9999)):
            yield one_by_one(scene, "mujoco", name, SoftLoop(tree, impedance).torque)
