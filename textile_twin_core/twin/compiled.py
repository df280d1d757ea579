"""compile(machine, outputs, method, tolerance) -> Twin: only what is asked for is computed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import MotionError, SceneError
from textile_twin_core.machines.machine import Machine
from textile_twin_core.twin.exact import ExactEvaluator

if TYPE_CHECKING:
    from textile_twin_core.twin.session import Session

METHODS = ("exact", "auto")


class Twin:
    """A machine compiled for a scene."""

    def __init__(self, machine: Machine, outputs: tuple[str, ...], method: str, tolerance: float) -> None:
        self.machine, self.outputs, self.method, self.tolerance = machine, outputs, method, tolerance
        self._evaluator = ExactEvaluator({name: machine.model.output(name) for name in outputs})

    def evaluate(
        self,
        theta: float | FloatArray,
        omega: float | FloatArray = 0.0,
        alpha: float | FloatArray = 0.0,
        out: Mapping[str, FloatArray] | None = None,
    ) -> dict[str, Any]:
        """The outputs by name, for shaft angle [rad], speed [rad/s] and acceleration [rad/s^2].

        Floats give floats. Arrays are broadcast against each other and give arrays of the common
        shape; `out` may hold arrays of that shape, float64 and contiguous, to write into.
        NaN in gives NaN out. Raises MotionError for shapes that do not fit or an infinite float.
        """
        if type(theta) is float and type(omega) is float and type(alpha) is float and out is None:
            try:
                return self._evaluator.scalar(theta, omega, alpha)
            except ValueError:
                raise self._cannot_close(theta) from None
        arrays = [np.asarray(a, dtype=np.float64) for a in (theta, omega, alpha)]
        if all(a.ndim == 0 for a in arrays) and out is None:
            return self.evaluate(float(arrays[0]), float(arrays[1]), float(arrays[2]))
        try:
            shape = np.broadcast_shapes(*(a.shape for a in arrays))
        except ValueError:
            shapes = ", ".join(
                f"{n} {a.shape}" for n, a in zip(("theta", "omega", "alpha"), arrays, strict=True)
            )
            raise MotionError(
                f"the motion's arrays do not fit each other: {shapes}; give equal shapes"
            ) from None
        result = self._prepare(shape, out)
        flat = [
            np.broadcast_to(a, shape).reshape(-1) if a.ndim else np.broadcast_to(a, math.prod(shape))
            for a in arrays
        ]
        self._evaluator.fill((flat[0], flat[1], flat[2]), {name: a.reshape(-1) for name, a in result.items()})
        return result

    def _prepare(self, shape: tuple[int, ...], out: Mapping[str, FloatArray] | None) -> dict[str, FloatArray]:
        if out is None:
            return {name: np.empty(shape) for name in self.outputs}
        for name in self.outputs:
            a = out.get(name)
            if a is None or a.shape != shape or a.dtype != np.float64 or not a.flags.c_contiguous:
                raise MotionError(f"out['{name}'] must be a contiguous float64 array of shape {shape}")
        return {name: out[name] for name in self.outputs}

    def _cannot_close(self, theta: float) -> MotionError:
        if not math.isfinite(theta):
            return MotionError(f"the shaft angle is {theta}; give a finite angle in radians")
        return MotionError(
            f"machine '{self.machine.name}' cannot close at a shaft angle of {math.degrees(theta):.4f} deg, "
            "outside the range that it was declared for"
        )

    def session(self, shaft: str = "causal", **settings: Any) -> Session:
        """A session: angle samples in, predictions out, state kept between blocks.

        `shaft` is the estimator: causal, lag or smooth; its settings follow by keyword.
        Raises SceneError for an unknown estimator or setting.
        """
        from textile_twin_core.twin.session import Session

        return Session(self, shaft, **settings)


def compile_machine(
    machine: Machine,
    outputs: Sequence[str] | None = None,
    method: str = "auto",
    tolerance: float = 1e-12,
) -> Twin:
    """Compile a machine for the outputs asked; None takes those of the machine's scene.

    Raises SceneError for an unknown output or method, MachineError where the machine lacks what one needs.
    """
    if isinstance(outputs, str):
        raise SceneError(f"outputs must be a list of names, such as ['{outputs}']")
    names = tuple(dict.fromkeys(machine.scene.outputs if outputs is None else outputs))
    if not names:
        raise SceneError("no outputs are asked for; name at least one, for example balancing_torque_Nm")
    if method not in METHODS:
        raise SceneError(f"there is no method '{method}'; choose one of {', '.join(METHODS)}")
    if not (math.isfinite(tolerance) and tolerance > 0.0):
        raise SceneError(f"tolerance must be a positive number, not {tolerance!r}")
    return Twin(machine, names, method, tolerance)
