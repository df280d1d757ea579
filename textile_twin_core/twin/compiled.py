"""compile(machine, outputs, method, tolerance) -> Twin: only what is asked for is computed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, overload

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact import ContactEvent
from textile_twin_core.errors import MotionError, SceneError
from textile_twin_core.machine import AnyMachine, ContactMachine, Machine
from textile_twin_core.twin.accuracy import reached_errors
from textile_twin_core.twin.exact import ExactEvaluator
from textile_twin_core.twin.history import HistoryTwin
from textile_twin_core.twin.instant import InstantPredictor
from textile_twin_core.twin.motion_arrays import arrays_for, flat_columns
from textile_twin_core.twin.plan import describe
from textile_twin_core.twin.predictor import twin_text
from textile_twin_core.twin.session import Session
from textile_twin_core.twin.table import FINEST_TABLE, TableEvaluator

METHODS = ("exact", "table", "auto")
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

    def predictor(self) -> InstantPredictor:
        """What a session asks for predictions."""
        return InstantPredictor(self)

    def session(self, shaft: str = "causal", **settings: Any) -> Session:
        """A session: angle samples in, predictions out, state kept between blocks.

        `shaft` is the estimator: causal, lag or smooth; its settings follow by keyword.
        Raises SceneError for an unknown estimator or setting.
        """
        return Session(self, shaft, **settings)


@overload
def compile_machine(
    machine: Machine, outputs: Sequence[str] | None = None, method: str | None = None, tolerance: float | None = None
) -> Twin: ...


@overload
def compile_machine(
    machine: ContactMachine,
    outputs: Sequence[str] | None = None,
    method: str | None = None,
    tolerance: float | None = None,
) -> HistoryTwin: ...


@overload
def compile_machine(
    machine: AnyMachine, outputs: Sequence[str] | None = None, method: str | None = None, tolerance: float | None = None
) -> Twin | HistoryTwin: ...


def compile_machine(
    machine: AnyMachine,
    outputs: Sequence[str] | None = None,
    method: str | None = None,
    tolerance: float | None = None,
) -> Twin | HistoryTwin:
    """Compile a machine into a twin that computes the outputs asked for and nothing else.

    Args:
        machine: from `ttc.machines` or `ttc.load_machine`.
        outputs: names of outputs, as `machine.outputs` lists them; those of the machine's scene without it.
        method: "exact" evaluates closed forms, "table" periodic tables, "auto" whichever is faster (see `Twin`); that
            of the machine's scene without it.
        tolerance: error over the peak that a table may have; that of the machine's scene without it.

    Returns:
        The twin: `evaluate` for shaft angles, speeds and accelerations, `session` for samples of an encoder. A
        HistoryTwin for a machine with impacts.

    Raises:
        SceneError: an unknown output or method, or a tolerance that is not positive.
        MachineError: the machine lacks what an output needs, such as masses.

    Example:
        >>> import textile_twin_core as ttc
        >>> twin = ttc.compile(ttc.machines.tufting(), outputs=["balancing_torque_Nm"])
        >>> round(twin.evaluate(1.0, 16.755, 0.0)["balancing_torque_Nm"], 3)
        14.108
    """
    if isinstance(machine, (str, Path)):
        raise SceneError(f"compile takes a machine: ttc.machines.create('{machine}') or ttc.load_machine('{machine}')")
    if isinstance(outputs, str):
        raise SceneError(f"outputs must be a list of names, such as ['{outputs}']")
    # plain names, since those of a numpy array would not stand in the code that is written for them
    names = tuple(dict.fromkeys(str(name) for name in (machine.scene.outputs if outputs is None else outputs)))
    method = machine.scene.method if method is None else method
    tolerance = machine.scene.tolerance if tolerance is None else tolerance
    if not names:
        raise SceneError("no outputs are asked for; name at least one, for example balancing_torque_Nm")
    if method not in METHODS:
        raise SceneError(f"there is no method '{method}'; choose one of {', '.join(METHODS)}")
    if not (math.isfinite(tolerance) and tolerance > 0.0):
        raise SceneError(f"tolerance must be a positive number, not {tolerance!r}")
    if isinstance(machine, ContactMachine):
        if method == "table":
            raise SceneError(f"machine '{machine.name}' has a history, which no table holds; use method 'exact'")
        return HistoryTwin(machine, names, tolerance)
    if not isinstance(machine, Machine):
        raise SceneError(f"there is no law for a machine of type {type(machine).__name__}")
    return Twin(machine, names, method, tolerance)
