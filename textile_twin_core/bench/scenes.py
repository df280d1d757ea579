"""Scenes of the benchmark: a machine, a set of outputs, and a motion with its exact answer."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.expression import interpret
from textile_twin_core.expression.loop import Numpy
from textile_twin_core.machine import Machine

Motion = tuple[FloatArray, FloatArray, FloatArray]
_CHECKED = 20_000


@dataclass(frozen=True)
class Workload:
    """Outputs of a machine over random angles at nominal speed with a few percent of ripple."""

    machine: Machine
    name: str
    outputs: tuple[str, ...]
    samples: int = 100_000

    @cached_property
    def motion(self) -> Motion:
        """Angle [rad], speed [rad/s], acceleration [rad/s^2]; the angles in random order."""
        rng = np.random.default_rng(20_110_222)
        speed = self.machine.nominal_speed_rad_s
        theta = rng.uniform(0.0, 2.0 * np.pi, self.samples)
        omega = speed * (1.0 + 0.03 * rng.uniform(-1.0, 1.0, self.samples))
        alpha = 0.05 * speed**2 * rng.uniform(-1.0, 1.0, self.samples)
        return theta, omega, alpha

    @cached_property
    def exact(self) -> dict[str, FloatArray]:
        """Outputs in extended precision at the first samples (see `checked`)."""
        names = ("theta", "omega", "alpha")
        inputs = {n: a[: self.checked].astype(np.longdouble) for n, a in zip(names, self.motion, strict=True)}
        expressions = [self.machine.model.output(name) for name in self.outputs]
        values = interpret(expressions, inputs, Numpy)
        return {name: np.asarray(v) + np.zeros(self.checked) for name, v in zip(self.outputs, values, strict=True)}

    @property
    def checked(self) -> int:
        """Number of samples compared with the exact answer."""
        return min(self.samples, _CHECKED)

    def error(self, found: dict[str, FloatArray]) -> float:
        """Return the largest error over the peak of its output; NaN if any output is NaN."""
        worst = [0.0]
        for name, values in found.items():
            n = min(values.shape[0], self.checked)
            peak = float(np.abs(self.exact[name]).max())
            if peak > 0.0:
                worst.append(float(np.abs(values[:n] - self.exact[name][:n]).max()) / peak)
        return float(np.max(worst))


def scenes(machine: Machine, samples: int = 100_000) -> tuple[Workload, ...]:
    """Build the scenes: torque alone, torque with the measures if any, and everything with the reactions."""
    torque = "balancing_torque_Nm"
    measures = tuple(f"{m.name}_position_m" for m in machine.measures)
    reactions = tuple(name for name in machine.outputs if name.startswith("reaction_"))
    kinematics = tuple(name for m in machine.measures for name in machine.outputs if name.startswith(f"{m.name}_"))
    links = tuple(name for name in machine.outputs if name.startswith(("omega_", "alpha_")))
    chosen = {
        "torque": (torque,),
        "position": measures[:1],
        "torque and position": (torque, *measures) if measures else (),
        "everything": (torque, *kinematics, *machine.transmitted, *links, *reactions),
    }
    return tuple(Workload(machine, name, outputs, samples) for name, outputs in chosen.items() if outputs)
