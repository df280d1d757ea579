"""Planar linkages in Pinocchio: a tree of joints, loops closed by pins, torque and reactions by inverse dynamics.

Pinocchio gives forward kinematics, Jacobians and the recursive Newton-Euler algorithm of the tree; the loops are closed
here by Newton's method on its kinematics, and the forces in the cut pins follow from the joints that have no motor.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from tests.benchmarks.peers.planar_tree import Cut, Point

Floats = npt.NDArray[np.float64]


@dataclass
class PlanarTree:
    """Bodies in a vertical plane; the first joint added is the driven one.

    `guess` holds joint positions near the wanted assembly [rad, m]; names of joints name their reactions.
    """

    gravity: Point = (0.0, -9.81)
    model: Any = field(default_factory=pin.Model)
    cuts: list[Cut] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.model.gravity = pin.Motion(np.array([*self.gravity, 0.0]), np.zeros(3))

    def turning(self, name: str, parent: int, at: Point) -> int:
        """A body that turns about a pin at `at` on its parent (0 is the ground)."""
        return self._joint(pin.JointModelRZ(), name, parent, at)

    def sliding_along_y(self, name: str, parent: int, at: Point) -> int:
        """A body that slides along the parent's y axis through `at`."""
        return self._joint(pin.JointModelPY(), name, parent, at)

    def _joint(self, joint: Any, name: str, parent: int, at: Point) -> int:
        placement = pin.SE3(np.eye(3), np.array([*at, 0.0]))
        return int(self.model.addJoint(parent, joint, placement, name))

    def body(self, joint: int, mass_kg: float, inertia_kgm2: float, centroid: Point) -> None:
        """A rigid body on the link behind a joint; `centroid` in the link's frame, inertia about it."""
        spread = np.diag([0.0, 0.0, inertia_kgm2])
        inertia = pin.Inertia(mass_kg, np.array([*centroid, 0.0]), spread)
        self.model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())

    def close(self, name: str, later: int, at_later: Point, earlier: int, at_earlier: Point) -> None:
        """Close a loop by a pin; its reaction is what the earlier body exerts on the later one."""
        self.cuts.append(Cut(name, later, at_later, earlier, at_earlier))

    def solve(
        self,
        motion: tuple[float, float, float],
        guess: Floats,
        force: tuple[int, Point] | None = None,
    ) -> tuple[float, dict[str, Floats], Any]:
        """Torque of the driven joint [N m], reaction at each pin [N] and Pinocchio's data, for (theta, omega, alpha).

        `force` acts on a body at the origin of its frame, in the machine's axes [N].
        """
        theta, omega, alpha = motion
        data = self.model.createData()
        q = self._assemble(data, theta, np.array(guess, dtype=float))
        zero = np.zeros(self.model.nv)
        pin.forwardKinematics(self.model, data, q, zero, zero)
        jacobian, right = self._system(data, q), np.zeros(self.model.nv)
        right[-1] = omega
        v = np.linalg.solve(jacobian, right)
        pin.forwardKinematics(self.model, data, q, v, zero)
        right = np.concatenate([-self._drift(data), [alpha]])
        a = np.linalg.solve(jacobian, right)

        outside = [np.zeros(3) for _ in range(self.model.njoints)]
        if force is not None:
            outside[force[0]] += (*force[1], 0.0)
        tau = pin.rnea(self.model, data, q, v, a, self._wrenches(data, outside))
        solved = np.linalg.solve(jacobian.T, tau)
        reactions: dict[str, Floats] = {}
        for index, cut in enumerate(self.cuts):
            x, y = solved[2 * index : 2 * index + 2]
            reactions[cut.name] = np.array([x, y])
            outside[cut.later] += self._force_at(data, cut.later, cut.at_later, x, y)
            outside[cut.earlier] += self._force_at(data, cut.earlier, cut.at_earlier, -x, -y)
        tau = pin.rnea(self.model, data, q, v, a, self._wrenches(data, outside))
        assert np.abs(tau[1:]).max() < 1e-9 * (1.0 + np.abs(solved).max())
        for joint in range(1, self.model.njoints):
            reactions[self.model.names[joint]] = (data.oMi[joint].rotation @ data.f[joint].linear)[:2]
        return float(solved[-1]), reactions, data

    def position(self, data: Any, joint: int, at: Point) -> Floats:
        """A body-fixed point in the machine's frame [m]."""
        place: Floats = data.oMi[joint].act(np.array([*at, 0.0]))[:2]
        return place

    def _assemble(self, data: Any, theta: float, q: Floats) -> Floats:
        """Newton's method on the cut pins, the driven joint fixed at theta."""
        q[0] = theta
        for _ in range(50):
            pin.forwardKinematics(self.model, data, q)
            gaps = [
                self.position(data, c.later, c.at_later) - self.position(data, c.earlier, c.at_earlier)
                for c in self.cuts
            ]
            residual = np.concatenate([*gaps, [0.0]])
            step = np.linalg.solve(self._system(data, q), residual)
            q = q - step
            if np.abs(step).max() < 1e-14 * (1.0 + np.abs(q).max()):
                break
        return q

    def _system(self, data: Any, q: Floats) -> Floats:
        """Velocities of the cut pins, later minus earlier, and of the driven joint, by the joints' velocities."""
        pin.computeJointJacobians(self.model, data, q)
        rows = []
        for cut in self.cuts:
            later = self._point_jacobian(data, cut.later, cut.at_later)
            rows.append(later - self._point_jacobian(data, cut.earlier, cut.at_earlier))
        drive = np.zeros((1, self.model.nv))
        drive[0, 0] = 1.0
        return np.vstack([*rows, drive])

    def _point_jacobian(self, data: Any, joint: int, at: Point) -> Floats:
        jacobian = pin.getJointJacobian(self.model, data, joint, pin.LOCAL_WORLD_ALIGNED)
        arm = data.oMi[joint].rotation @ np.array([*at, 0.0])
        moved: Floats = jacobian[:2] + np.outer([-arm[1], arm[0]], jacobian[5])
        return moved

    def _drift(self, data: Any) -> Floats:
        """Acceleration of the cut pins, later minus earlier, while the joints do not accelerate."""
        gaps = []
        for cut in self.cuts:
            later = self._point_acceleration(data, cut.later, cut.at_later)
            gaps.append(later - self._point_acceleration(data, cut.earlier, cut.at_earlier))
        return np.concatenate(gaps)

    def _point_acceleration(self, data: Any, joint: int, at: Point) -> Floats:
        acceleration = pin.getClassicalAcceleration(self.model, data, joint, pin.LOCAL_WORLD_ALIGNED)
        speed = pin.getVelocity(self.model, data, joint, pin.LOCAL_WORLD_ALIGNED).angular[2]
        arm = data.oMi[joint].rotation @ np.array([*at, 0.0])
        turning = acceleration.angular[2] * np.array([-arm[1], arm[0]])
        total: Floats = acceleration.linear[:2] + turning - speed**2 * arm[:2]
        return total

    def _force_at(self, data: Any, joint: int, at: Point, x: float, y: float) -> Floats:
        """A force at a body-fixed point as force and moment about the origin of the body's frame, machine's axes."""
        arm = data.oMi[joint].rotation @ np.array([*at, 0.0])
        return np.array([x, y, arm[0] * y - arm[1] * x])

    def _wrenches(self, data: Any, outside: list[Floats]) -> Any:
        """Forces and moments in the machine's axes as Pinocchio wants them: in each body's own frame."""
        forces = pin.StdVec_Force()
        for joint, (x, y, moment) in enumerate(outside):
            local = data.oMi[joint].rotation.T @ np.array([x, y, 0.0])
            forces.append(pin.Force(local, np.array([0.0, 0.0, moment])))
        return forces
