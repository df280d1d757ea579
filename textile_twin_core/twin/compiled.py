"""Twin: a machine compiled for its outputs; only what is asked for is computed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Any

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact import ContactEvent
from textile_twin_core.errors import MotionError, SceneError
from textile_twin_core.machine import Machine
from textile_twin_core.twin.accuracy import reached_errors
from textile_twin_core.twin.exact import ExactEvaluator
from textile_twin_core.twin.instant import InstantPredictor
from textile_twin_core.twin.motion_arrays import arrays_for, flat_columns
from textile_twin_core.twin.plan import describe
from textile_twin_core.twin.predictor import Predictor, twin_text
from textile_twin_core.twin.session import Session
from textile_twin_core.twin.table import FINEST_TABLE, TableEvaluator

_TABLE_PAYS_FROM = 200_000
"""Samples from which on a table is worth making."""


class Twin:
    """A machine compiled for a scene.

    Method `exact` evaluates closed forms, `table` periodic tables refined to the tolerance; `auto` takes the
    table for blocks that are long enough to pay for it, where it is the cheaper one, and else the closed forms.
    """

    def __init__(self, machine: Machine, outputs: tuple[str, ...], method: str, tolerance: float) -> None:
        self.machine, self.outputs, self.method, self.tolerance = machine, outputs, method, tolerance
        self._expressions = {name: machine.model.output(name) for name in outputs}
        self._exact = ExactEvaluator(self._expressions)
        self._evaluator: ExactEvaluator | TableEvaluator = self._table if method == "table" else self._exact

    def __repr__(self) -> str:
        return twin_text(type(self).__name__, self.machine.name, self.outputs, self.method)

    def __reduce__(self) -> tuple[Any, ...]:
        # Compiled functions belong to their process: a copy is compiled anew.
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
        """What `auto` takes for long blocks."""
        if self.tolerance < FINEST_TABLE:
            return self._exact
        try:
            table = self._table
        except SceneError:  # near a change point no table is fine enough
            return self._exact
        return table if table.cost < self._exact.cost else self._exact

    @cached_property
    def reached_errors(self) -> dict[str, float]:
        """Largest error found per output, over its peak, at nominal speed, with a margin (see `accuracy`)."""
        evaluator = self._table_or_exact if self.method == "auto" else self._evaluator
        if isinstance(evaluator, TableEvaluator):
            evaluator.loop.compile_now()  # what is not compiled goes by the closed forms, past the table
        return reached_errors(self.machine, self._expressions, evaluator)

    @property
    def reached_error(self) -> float:
        """The largest of `reached_errors`."""
        return max(self.reached_errors.values(), default=0.0)

    def describe(self) -> str:
        """What is evaluated and what was dropped, with the operations per sample counted."""
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
        """The outputs by name, for shaft angle [rad], speed [rad/s] and acceleration [rad/s^2].

        Floats give floats. Arrays are broadcast against each other and give arrays of the common
        shape; `out` may hold arrays of that shape, float64 and contiguous, to write into. Long blocks are shared by as
        many `cores`. When the samples were taken (`time`) makes no difference to a machine without a history.
        NaN in gives NaN out; so does, among arrays, an angle at which the machine cannot close or its motion is not
        determined. Raises MotionError for such an angle or an infinite one given as a float, for shapes that do not
        fit, and for arrays of `out` that are not separate; SceneError for `cores` below 1.
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
            return self.evaluate(float(theta), float(omega), float(alpha))  # numpy's floats and whole numbers
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

    @property
    def events(self) -> tuple[ContactEvent, ...]:
        """No impacts: the machine has no history."""
        return ()

    def predictor(self, shaft: str = "causal", before: Predictor | None = None) -> InstantPredictor:
        """What a session asks for predictions, which have no state."""
        return InstantPredictor(self)

    def session(self, shaft: str = "causal", **settings: Any) -> Session:
        """A session: angle samples in, predictions out, state kept between blocks.

        `shaft` is the estimator: causal, lag or smooth; its settings follow by keyword.
        Raises SceneError for an unknown estimator or setting.
        """
        return Session(self, shaft, **settings)
