"""Twin of a machine with one degree of freedom, compiled for the requested outputs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import MotionError, SceneError
from textile_twin_core.machine import Machine
from textile_twin_core.machine.sensitivity import TorqueSensitivity
from textile_twin_core.shaft import OneState, ShaftStates
from textile_twin_core.twin.accuracy import reached_errors
from textile_twin_core.twin.exact import ExactEvaluator
from textile_twin_core.twin.motion_arrays import arrays_for, flat_columns
from textile_twin_core.twin.plan import describe
from textile_twin_core.twin.predictor import Prediction, Predictor
from textile_twin_core.twin.sense import negligible_speed, sense_unknown
from textile_twin_core.twin.session import AnyTwin
from textile_twin_core.twin.table import FINEST_TABLE, TableEvaluator

_TABLE_PAYS_FROM = 200_000
"""Number of samples from which building a table pays off."""
_FEW = 80
"""Number of samples up to which single evaluation is faster than arrays."""
_INSIDE = 0.3819
"""Share of the machine's range at which windings are evaluated, away from the usual dead points."""


class Twin(AnyTwin):
    """Machine compiled for a scene; made by `compile`.

    Method `exact` evaluates closed forms. `table` evaluates periodic tables refined to the tolerance. `auto` evaluates
    closed forms, and tables for blocks long enough to pay for them, where tables are cheaper.

    Args:
        machine: The machine.
        outputs: Names of the outputs, which end with their units.
        method: `exact`, `table` or `auto`.
        tolerance: Error of a table over the output's peak.

    Raises:
        SceneError: For a method that this machine does not have.

    Examples:
        >>> import textile_twin_core as ttc
        >>> twin = ttc.compile(ttc.machines.tufting(), ["needle_position_m"])
        >>> found = twin.evaluate(theta=0.5, omega=16.76, alpha=0.0)  # [rad], [rad/s], [rad/s^2]; floats or arrays
        >>> round(found["needle_position_m"], 3)  # [m]
        0.56
    """

    def __init__(self, machine: Machine, outputs: tuple[str, ...], method: str, tolerance: float) -> None:
        self.machine: Machine = machine
        self.outputs, self.method, self.tolerance = outputs, method, tolerance
        self._expressions = {name: machine.model.output(name) for name in outputs}
        self._exact = ExactEvaluator(self._expressions)
        self._evaluator: ExactEvaluator | TableEvaluator = self._table if method == "table" else self._exact

    def __reduce__(self) -> tuple[Any, ...]:
        # Compiled functions belong to their process, so a copy compiles its own.
        return type(self), (self.machine, self.outputs, self.method, self.tolerance)

    @cached_property
    def _table(self) -> TableEvaluator:
        if not self.machine.linkage.solved.turns_fully:
            raise SceneError(
                f"machine '{self.machine.name}' is declared for a part of the turn, and tables are of a whole one; "
                "use method 'exact'"
            )
        return TableEvaluator(self.machine, self._expressions, self.tolerance)

    @cached_property
    def _table_or_exact(self) -> ExactEvaluator | TableEvaluator:
        """Evaluator that `auto` selects for long blocks."""
        if self.tolerance < FINEST_TABLE:
            return self._exact
        try:
            table = self._table
        except SceneError:  # no table is fine enough near a change point
            return self._exact
        return table if table.cost < self._exact.cost else self._exact

    @cached_property
    def reached_errors(self) -> dict[str, float]:
        """Error over peak of each output at nominal speed, with a margin (see `accuracy`)."""
        evaluator = self._table_or_exact if self.method == "auto" else self._evaluator
        if isinstance(evaluator, TableEvaluator):
            evaluator.loop.compile_now()  # without it the closed forms would answer instead of the table
        return reached_errors(self.machine, self._expressions, evaluator)

    @property
    def reached_error(self) -> float:
        """Largest of `reached_errors`."""
        return max(self.reached_errors.values(), default=0.0)

    def describe(self) -> str:
        """Describe the evaluated and the dropped expressions, with the number of operations per sample."""
        return describe(self.machine, self._expressions, self.method, self._exact, self._described_table)

    @property
    def _described_table(self) -> TableEvaluator | None:
        if self.method == "exact":
            return None
        chosen = self._evaluator if self.method == "table" else self._table_or_exact
        return chosen if isinstance(chosen, TableEvaluator) else None

    def evaluate(
        self,
        theta: float | FloatArray,
        omega: float | FloatArray = 0.0,
        alpha: float | FloatArray = 0.0,
        *,
        time: float | FloatArray | None = None,
        out: Mapping[str, FloatArray] | None = None,
        cores: int = 1,
    ) -> dict[str, Any]:
        """Evaluate the outputs at shaft angles, speeds and accelerations.

        Args:
            theta: Shaft angle [rad]. Floats give floats; arrays are broadcast and give arrays of the common shape.
            omega: Shaft speed [rad/s].
            alpha: Shaft acceleration [rad/s^2].
            time: Times of the samples [s]; ignored, as the outputs depend on the present state only.
            out: Arrays to write into, by output: float64, contiguous, of the common shape.
            cores: Number of cores for long blocks.

        Returns:
            The outputs by name. NaN in gives NaN out. In arrays, an angle at which the machine cannot close or
                its motion is not
            determined gives NaN, too.

        Raises:
            MotionError: A float angle is infinite or outside the range of the linkage, shapes do not fit, or
                arrays of `out`
                overlap.
            SceneError: `cores` is below 1.
        """
        if type(theta) is float and type(omega) is float and type(alpha) is float and out is None:
            try:
                return self._evaluator.single(theta, omega, alpha)
            except ValueError:
                raise self._cannot_close(theta) from None
            except ZeroDivisionError:
                raise self._not_determined(theta) from None
        if cores < 1:
            raise SceneError(f"cores must be 1 or more, not {cores}")
        if out is None and all(isinstance(value, (float, int)) for value in (theta, omega, alpha)):
            return self.evaluate(float(theta), float(omega), float(alpha))  # numpy floats and integers
        shape, columns = flat_columns({"theta": theta, "omega": omega, "alpha": alpha})
        if not shape and out is None:
            return self.evaluate(*(float(column[0]) for column in columns))
        result = arrays_for(self.outputs, shape, out, columns)
        size = math.prod(shape)
        if size == 0:
            return result
        evaluator = self._evaluator
        if self.method == "auto" and size >= _TABLE_PAYS_FROM:
            evaluator = self._table_or_exact
        flat = result if len(shape) == 1 else {name: a.reshape(-1) for name, a in result.items()}
        evaluator.fill(columns, flat, cores)
        return result

    def _cannot_close(self, theta: float) -> MotionError:
        if not math.isfinite(theta):
            return MotionError(f"the shaft angle is {theta}; give a finite angle in radians")
        return MotionError(
            f"machine '{self.machine.name}' cannot close at a shaft angle of {math.degrees(theta):.4f} deg, "
            "outside the range that it was declared for"
        )

    def _not_determined(self, theta: float) -> MotionError:
        return MotionError(
            f"machine '{self.machine.name}' is at a change point at a shaft angle of {math.degrees(theta):.4f} deg, "
            "where its motion or its forces are not determined"
        )

    def predictor(self, shaft: str = "causal", before: Predictor | None = None) -> InstantPredictor:
        """Create the predictor of a session; it has no state."""
        return InstantPredictor(self)


class InstantPredictor(Predictor):
    """Predictor that evaluates a twin at shaft states, by phase and turns so that long runs lose no digits.

    Dry friction needs the sense of rotation. Where the state does not determine it (see `sense`), dry friction
    is zero, as at standstill; all other terms of the speed remain.
    """

    def __init__(self, twin: Twin) -> None:
        self._twin = twin
        self._winding = windings(twin)

    @property
    def sensitivity(self) -> TorqueSensitivity | None:
        """Sensitivity of the torque to the state; None for a machine without masses."""
        return self._twin.machine.model.torque_sensitivity

    def predict(self, states: ShaftStates) -> Prediction:
        """Predict the outputs at states."""
        motion = (states.phase_rad, states.omega_rad_s, states.alpha_rad_s2)
        outputs = self._block(motion)
        unknown = np.flatnonzero(sense_unknown(states))
        if unknown.size:
            theta, omega, alpha = (column[unknown] for column in motion)
            standstill = self._block((theta, np.zeros_like(omega), alpha))
            turning = self._block((theta, negligible_speed(omega), alpha))
            for name, values in outputs.items():
                values[unknown] += standstill[name] - turning[name]
        for name, winding in self._winding.items():
            outputs[name] += winding * states.turns
        return Prediction(states, outputs, self.sensitivity)

    def predict_one(self, stamp: int | float, state: OneState, sense_known: bool) -> dict[str, float]:
        """Predict the outputs at one state."""
        *motion, turns = state
        values = self._single(motion)
        if not sense_known:
            theta, omega, alpha = motion
            standstill = self._single((theta, 0.0, alpha))
            turning = self._single((theta, float(negligible_speed(omega)), alpha))
            values = {name: value + (standstill[name] - turning[name]) for name, value in values.items()}
        for name, winding in self._winding.items():
            values[name] += winding * turns
        return values

    def _block(self, motion: Sequence[FloatArray]) -> dict[str, FloatArray]:
        n, twin = len(motion[0]), self._twin
        outputs = {name: np.empty(n) for name in twin.outputs}
        if n > _FEW and outputs:
            twin.evaluate(*motion, out=outputs)
        else:
            for i, row in enumerate(zip(*(a.tolist() for a in motion), strict=True)):
                for name, value in self._single(row).items():
                    outputs[name][i] = value
        return outputs

    def _single(self, state: Sequence[float]) -> dict[str, float]:
        """Evaluate one sample as in a block: NaN where the motion of the machine is not determined."""
        try:
            return self._twin.evaluate(*state)
        except MotionError:
            return dict.fromkeys(self._twin.outputs, math.nan)

    def restart(self) -> None:
        """Do nothing; there is no state."""

    def reset(self) -> None:
        """Do nothing; there is no state."""


def windings(twin: Twin) -> dict[str, float]:
    """Return the growth over one turn of the outputs that wind up with the shaft, such as its angle.

    Closed forms wind up wherever the linkage closes, even if it closes over a part of the turn only.
    """
    low, high = twin.machine.range_rad
    angle = low + _INSIDE * (high - low)
    begin, end = twin.evaluate(angle, 0.0, 0.0), twin.evaluate(angle + 2.0 * math.pi, 0.0, 0.0)
    return {
        name: 2.0 * math.pi * round((end[name] - begin[name]) / (2.0 * math.pi))
        for name in twin.outputs
        if abs(end[name] - begin[name]) > 1.0
    }
