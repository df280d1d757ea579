"""Parts of a machine's torque: mechanism, loads, friction of the shaft."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.comparison.residual import load_steps
from textile_twin_core.dynamics.loads import ShaftFriction
from textile_twin_core.machine import Machine
from textile_twin_core.twin import compile_machine

TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Terms:
    """Parts of the torque at n states [N m], (n,) each.

    mechanism: inertia and weight. load: all declared loads except the shaft's friction. friction: the declared
    friction of the shaft. direction: sign of the speed, 0 at standstill.
    """

    mechanism: FloatArray
    load: FloatArray
    friction: FloatArray
    direction: FloatArray

    @property
    def total(self) -> FloatArray:
        """Predicted torque."""
        return self.mechanism + self.load + self.friction


class TorqueTerms:
    """Evaluation of the parts of one machine's torque, independent of its sensors."""

    def __init__(self, machine: Machine) -> None:
        frictions = [load for load in machine.loads if isinstance(load, ShaftFriction)]
        others = tuple(load for load in machine.loads if not isinstance(load, ShaftFriction))
        self.viscous_Nms = sum(load.viscous_Nms for load in frictions)
        self.coulomb_Nm = sum(load.coulomb_Nm for load in frictions)
        self._twin = compile_machine(
            replace(machine, loads=others), ["torque_inertial_Nm", "torque_gravity_Nm", "torque_load_Nm"]
        )
        jumps = load_steps(compile_machine(machine, ["balancing_torque_Nm"]))
        self._step_angles = np.sort(np.mod(np.asarray(jumps, dtype=np.float64), TURN))

    def at(self, theta: FloatArray, omega: FloatArray, alpha: FloatArray, slow_rad_s: float | FloatArray) -> Terms:
        """Evaluate the parts at states (n,)."""
        out = self._twin.evaluate(theta, omega, alpha)
        direction = np.where(np.abs(omega) > slow_rad_s, np.sign(omega), 0.0)
        friction = self.viscous_Nms * omega + self.coulomb_Nm * direction
        return Terms(out["torque_inertial_Nm"] + out["torque_gravity_Nm"], out["torque_load_Nm"], friction, direction)

    @property
    def step_angles_rad(self) -> list[float]:
        """Angles in a turn at which the load jumps, increasing [rad]."""
        return [float(angle) for angle in self._step_angles]

    def near_step(self, theta: FloatArray, omega: FloatArray, guard_s: float, guard_rad: float = 0.0) -> BoolArray:
        """Return true within `guard_s`, at the present speed, or `guard_rad` of a discontinuity of the load."""
        near = np.zeros(theta.size, dtype=np.bool_)
        within = np.maximum(np.abs(omega) * guard_s, guard_rad)
        for angle in self._step_angles:
            apart = theta - angle
            apart -= TURN * np.rint(apart * (1.0 / TURN))
            near |= np.abs(apart) <= within
        return near
