"""Drake: kinematics, Jacobians and inverse dynamics of a MultibodyPlant, one sample at a time from Python.

Timed: all steps of `closed_loop`. Drake has no inverse dynamics over arrays, so the batch is a Python loop.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    JacobianWrtVariable,
    MultibodyForces,
    PrismaticJoint,
    RevoluteJoint,
    SpatialInertia,
    UnitInertia,
)

from textile_twin_core.arrays import FloatArray
from textile_twin_core.bench.scenes import Workload
from textile_twin_core.bench.timing import Candidate

from .closed_loop import projected
from .planar_tree import GROUND, PlanarTree

_ORIGIN = np.zeros(3)


class DrakeTree:
    """Tree as a MultibodyPlant, with points on both sides of every cut and at the needle tip."""

    def __init__(self, tree: PlanarTree) -> None:
        self.plant = plant = MultibodyPlant(0.0)
        plant.mutable_gravity_field().set_gravity_vector([*tree.gravity, 0.0])
        bodies: list[Any] = []
        joints: list[Any] = []
        for k, j in enumerate(tree.joints):
            centre, turned = np.array([*j.centroid_m, 0.0]), j.inertia_kgm2 / j.mass_kg
            about_centre = UnitInertia(turned, turned, turned)
            inertia = SpatialInertia(j.mass_kg, centre, about_centre.ShiftFromCenterOfMass(centre))
            body = plant.AddRigidBody(f"body{k}", inertia)
            parent = plant.world_frame() if j.parent == GROUND else bodies[j.parent].body_frame()
            seat = plant.AddFrame(FixedOffsetFrame(f"seat{k}", parent, RigidTransform([*j.at, 0.0])))
            if j.axis is None:
                joint = RevoluteJoint(f"joint{k}", seat, body.body_frame(), [0.0, 0.0, 1.0])
            else:
                joint = PrismaticJoint(f"joint{k}", seat, body.body_frame(), [*j.axis, 0.0])
            joints.append(plant.AddJoint(joint))
            bodies.append(body)
        plant.Finalize()
        self.context = plant.CreateDefaultContext()
        self._forces = MultibodyForces(plant)
        self._order = np.array([j.velocity_start() for j in joints])
        self._back = np.argsort(self._order)
        self._world = plant.world_frame()
        frames = [body.body_frame() for body in bodies]
        self._cuts = [
            ((frames[c.later], np.array([*c.at_later, 0.0])), (frames[c.earlier], np.array([*c.at_earlier, 0.0])))
            for c in tree.cuts
        ]
        needle = tree.needle
        self._tip = (frames[needle.body], np.array([*needle.at, 0.0])) if needle else (self._world, _ORIGIN)

    def _position(self, frame: Any, at: FloatArray) -> FloatArray:
        found: FloatArray = self.plant.CalcPointsPositions(self.context, frame, at, self._world)
        return found[:, 0]

    def _jacobian(self, frame: Any, at: FloatArray) -> FloatArray:
        found: FloatArray = self.plant.CalcJacobianTranslationalVelocity(
            self.context, JacobianWrtVariable.kV, frame, at, self._world, self._world
        )
        return found[:2]

    def _bias(self, frame: Any, at: FloatArray) -> FloatArray:
        found: FloatArray = self.plant.CalcBiasTranslationalAcceleration(
            self.context, JacobianWrtVariable.kV, frame, at, self._world, self._world
        )
        return found[:2, 0]

    def place(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return gaps and Jacobian at the cut pins."""
        self.plant.SetPositions(self.context, q[self._back])
        gaps = [(self._position(*later) - self._position(*earlier))[:2] for later, earlier in self._cuts]
        rows = [self._jacobian(*later) - self._jacobian(*earlier) for later, earlier in self._cuts]
        return np.concatenate(gaps), np.concatenate(rows)[:, self._order]

    def drift(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return the acceleration of the gaps with zero joint accelerations."""
        self.plant.SetVelocities(self.context, v[self._back])
        return np.concatenate([self._bias(*later) - self._bias(*earlier) for later, earlier in self._cuts])

    def inverse(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return Drake's inverse dynamics, with gravity."""
        self.plant.CalcForceElementsContribution(self.context, self._forces)
        forces: FloatArray = self.plant.CalcInverseDynamics(self.context, a[self._back], self._forces)
        ordered: FloatArray = forces[self._order]
        return ordered

    def tip(self) -> FloatArray:
        """Return the position of the needle tip."""
        return self._position(*self._tip)


def candidates(scene: Workload) -> Iterator[Candidate]:
    """Build torque and travel by projection."""
    yield from projected(scene, "drake", DrakeTree)
