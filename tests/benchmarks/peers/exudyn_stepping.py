"""Exudyn: the linkage as plane bodies, pins and a driven crank, stepped through time at constant speed.

Timed: the solver over a turn and a quarter, and the recording of its sensors; friction of the backing is added
by a test
of the recorded needle position. There is no inverse dynamics, so the torque is the multiplier of the drive constraint.
The initial transient decays in the first quarter turn; the error is that of the turn after it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import exudyn
import numpy as np
from exudyn.itemInterface import (
    CoordinateConstraint,
    LoadMassProportional,
    MarkerBodyMass,
    MarkerBodyRigid,
    MarkerNodeCoordinate,
    NodePointGround,
    NodeRigidBody2D,
    ObjectGround,
    ObjectRigidBody2D,
    PrismaticJoint2D,
    RevoluteJoint2D,
    SensorNode,
    SensorObject,
)

from textile_twin_core.arrays import FloatArray
from textile_twin_core.bench.scenes import Workload
from textile_twin_core.bench.timing import Candidate

from .closed_loop import TORQUE
from .planar_tree import GROUND, ComplexArray, PlanarTree, Point, planar_tree
from .turn import SteadyTurn

_A_TURN = 2000


class Stepping:
    """Tree as an Exudyn system that starts a quarter turn before theta = 0 at `omega` [rad/s]."""

    def __init__(self, tree: PlanarTree, omega: float, a_turn: int) -> None:
        self.tree, self.omega, self.a_turn = tree, omega, a_turn
        self.lead = a_turn // 4
        self.steps = a_turn + self.lead
        self.system = mbs = exudyn.SystemContainer().AddSystem()
        origins, turns = tree.frames()
        begin = 3 * (len(tree.start) - 1) // 4
        self._ground = mbs.AddObject(ObjectGround())
        self._bodies: list[Any] = []
        nodes = []
        for joint, origin, turn in zip(tree.joints, origins, turns, strict=True):
            direction = np.exp(1j * turn)
            centre = origin + direction * complex(*joint.centroid_m)
            rate, speed = (
                (_slope(direction)[begin] / (1j * direction[begin])).real * omega,
                _slope(centre)[begin] * omega,
            )
            node = mbs.AddNode(
                NodeRigidBody2D(
                    referenceCoordinates=[centre[begin].real, centre[begin].imag, turn[begin]],
                    initialVelocities=[speed.real, speed.imag, rate],
                )
            )
            body = mbs.AddObject(ObjectRigidBody2D(mass=joint.mass_kg, inertia=joint.inertia_kgm2, nodeNumber=node))
            mass = mbs.AddMarker(MarkerBodyMass(bodyNumber=body))
            mbs.AddLoad(LoadMassProportional(markerNumber=mass, loadVector=[*tree.gravity, 0.0]))
            nodes.append(node)
            self._bodies.append(body)
        for k, joint in enumerate(tree.joints):
            markers = [self._marker(joint.parent, joint.at), self._marker(k, (0.0, 0.0))]
            if joint.axis is None:
                mbs.AddObject(RevoluteJoint2D(markerNumbers=markers))
            else:
                x, y = joint.axis
                along, across = [x, y, 0.0], [-y, x, 0.0]
                mbs.AddObject(PrismaticJoint2D(markerNumbers=markers, axisMarker0=along, normalMarker1=across))
        for cut in tree.cuts:
            markers = [self._marker(cut.earlier, cut.at_earlier), self._marker(cut.later, cut.at_later)]
            mbs.AddObject(RevoluteJoint2D(markerNumbers=markers))
        fixed = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=mbs.AddNode(NodePointGround()), coordinate=0))
        crank = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=nodes[0], coordinate=2))
        drive = mbs.AddObject(CoordinateConstraint(markerNumbers=[fixed, crank], offset=omega, velocityLevel=True))
        kinds = exudyn.OutputVariableType
        self._torque = mbs.AddSensor(
            SensorObject(objectNumber=drive, storeInternal=True, outputVariableType=kinds.Force)
        )
        if tree.needle is not None:
            self._tip, self._speed = (
                mbs.AddSensor(SensorNode(nodeNumber=nodes[tree.needle.body], storeInternal=True, outputVariableType=k))
                for k in (kinds.Position, kinds.Velocity)
            )
        mbs.Assemble()
        self.settings = exudyn.SimulationSettings()
        self.settings.timeIntegration.numberOfSteps = self.steps
        self.settings.timeIntegration.endTime = self.steps / a_turn * 2.0 * np.pi / omega
        self.settings.timeIntegration.newton.useModifiedNewton = True
        self.settings.solution.file.write = False
        self.settings.solution.sensors.writePeriod = self.settings.timeIntegration.endTime / self.steps

    def _marker(self, body: int, at: Point) -> Any:
        x, y = (0.0, 0.0) if body == GROUND else self.tree.joints[body].centroid_m
        number = self._ground if body == GROUND else self._bodies[body]
        return self.system.AddMarker(MarkerBodyRigid(bodyNumber=number, localPosition=[at[0] - x, at[1] - y, 0.0]))

    def turn(self) -> dict[str, FloatArray]:
        """Return torque [N m] and travel [m] at equally spaced angles of the turn."""
        self.system.SolveDynamic(self.settings)
        torque = -self._last_turn(self._torque)[:, 0]
        needle = self.tree.needle
        if needle is None:
            return {TORQUE: torque}
        from_centroid = np.array(needle.at) - self.tree.joints[needle.body].centroid_m
        tip = self._last_turn(self._tip)[:, :2] + from_centroid
        travel = (tip - needle.origin) @ needle.direction
        slope = self._last_turn(self._speed)[:, :2] @ needle.direction / self.omega
        motion = zip(travel.tolist(), slope.tolist(), strict=True)
        return {TORQUE: torque + [needle.friction(y, s, self.omega) for y, s in motion], needle.output: travel}

    def _last_turn(self, sensor: Any) -> FloatArray:
        """Return the recorded values of the last turn, without their times."""
        found: FloatArray = self.system.GetSensorStoredData(sensor)[-self.a_turn :, 1:]
        return found


def _slope(values: ComplexArray) -> ComplexArray:
    """Differentiate a periodic function given at equally spaced angles of a turn, both ends included."""
    n = len(values) - 1
    orders = np.fft.fftfreq(n, 1.0 / n)
    slope: ComplexArray = np.fft.ifft(1j * orders * np.fft.fft(values[:-1]))
    return slope


def candidates(scene: Workload) -> Iterator[Candidate]:
    """Build torque and travel by time stepping."""
    tree = planar_tree(scene.machine)
    if tree is None or not set(scene.outputs) <= {TORQUE, tree.needle.output if tree.needle else ""}:
        return
    turn = SteadyTurn.of(scene, min(_A_TURN, scene.samples))
    stepping = Stepping(tree, scene.machine.nominal_speed_rad_s, turn.samples)

    def error() -> float:
        found = stepping.turn()
        return turn.error({name: found[name] for name in scene.outputs})

    yield Candidate(
        "time stepping",
        "exudyn",
        batch=stepping.turn,
        samples=stepping.steps,
        error=error,
        note="in order, over its own turn",
    )
