"""Table method: tabulated functions of the angle with discontinuities at the loads' events, and remaining closed
forms.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics import INPUTS
from textile_twin_core.errors import SceneError
from textile_twin_core.expression import Expr, const, derivative, interpret, square, variable
from textile_twin_core.expression.graph import scaled
from textile_twin_core.expression.loop import Loop
from textile_twin_core.expression.traversal import operation_cost
from textile_twin_core.machine.machine import Machine
from textile_twin_core.mechanism import THETA
from textile_twin_core.twin.exact import ExactEvaluator
from textile_twin_core.twin.linear_form import OMEGA_SQUARED, LinearForms
from textile_twin_core.twin.periodic_table import AngleTable, tabulate
from textile_twin_core.twin.phase_steps import as_phase_steps

FINEST_TABLE = 1e-13
"""Finest tolerance of tables of smooth mechanisms; below it the rounding of coefficients dominates."""
_SPEED_SHARES = (0.1, 1.0, 10.0)
"""Speeds over nominal at which the tolerance is ensured."""
_ONE = const(1.0)
_OMEGA = variable("omega")


class TableEvaluator:
    """Evaluator of outputs by periodic tables; outputs without a linear form stay exact (`exact_outputs`).

    Raises:
        SceneError: No table reaches the tolerance.
    """

    def __init__(self, machine: Machine, outputs: Mapping[str, Expr], tolerance: float) -> None:
        self.outputs = dict(outputs)
        self.exact = ExactEvaluator(outputs)
        forms = LinearForms(machine)
        self._intensities = {v: as_phase_steps(true) for v, true in forms.intensities.items()}
        self._names: dict[Expr, tuple[Expr, float]] = {}
        combined: dict[str, Expr] = {}
        for name in outputs:
            expression = self._combine(forms, name)
            if expression is not None:
                combined[name] = expression
        self.exact_outputs = tuple(name for name in outputs if name not in combined)
        self.combined = {name: combined.get(name, outputs[name]) for name in outputs}
        self.functions = tuple(stored * function for function, (_, stored) in self._names.items())
        self.table = self._tabulate(machine, tolerance)

    def _combine(self, forms: LinearForms, name: str) -> Expr | None:
        """Write the output as an expression of tabulated values, speed and acceleration."""
        form = forms.form(name)
        if form is None:
            return None
        by_factor: dict[Expr, Expr] = {}
        for coefficient, factor in form.terms:
            products = [(_ONE, _ONE if factor is None else factor)]
            if factor is not None and factor in self._intensities:
                intensity = self._intensities[factor]
                if intensity is None:
                    return None
                products = intensity
            for step, share in products:
                size, unscaled = scaled(share)
                by_factor[unscaled] = by_factor.get(unscaled, const(0.0)) + size * coefficient * step
        total = form.winding * THETA
        for factor, function in by_factor.items():
            total += self._value(*scaled(function)) * (square(_OMEGA) if factor is OMEGA_SQUARED else factor)
        return total

    def _value(self, size: float, function: Expr) -> Expr:
        """Return size * function as a tabulated value; the table stores the function with its first requested size."""
        if function.is_constant:
            return size * function
        name, stored = self._names.setdefault(function, (variable(f"f{len(self._names)}"), size))
        return (size / stored) * name

    def _tabulate(self, machine: Machine, tolerance: float) -> AngleTable | None:
        if not self.functions:
            return None
        table = tabulate(self.functions, self._weights(machine.nominal_speed_rad_s), tolerance)
        if table is None:
            finer = tolerance < FINEST_TABLE
            why = (
                f"ask for {FINEST_TABLE:g} or more, or" if finer else "the motion is too sharp, as near a change point;"
            )
            raise SceneError(f"no table reaches a tolerance of {tolerance:g}: {why} use method 'exact'")
        return table

    def _weights(self, nominal_speed: float) -> FloatArray:
        """Return (rows, functions): error over peak of each output at several speeds, per error of a function."""
        theta = np.linspace(0.0, 2.0 * math.pi, 720, endpoint=False)
        zeros = {f"f{i}": 0.0 for i in range(len(self.functions))}
        rows = []
        for speed in (share * nominal_speed for share in _SPEED_SHARES):
            acceleration = 0.1 * speed**2
            values = {name: np.empty_like(theta) for name in self.outputs}
            self.exact.fill((theta, np.full_like(theta, speed), np.full_like(theta, acceleration)), values)
            state = {"theta": 0.0, "omega": speed, "alpha": acceleration, **zeros}
            for name, expression in self.combined.items():
                peak = float(np.abs(values[name]).max())
                rows.append(_slopes(expression, len(self.functions), state) / (peak or 1.0))
        return np.array(rows)

    @cached_property
    def loop(self) -> Loop:
        """Loop that reads the table and evaluates the outputs from its values."""
        if self.table is None:
            return self.exact.loop
        outputs, plain = list(self.combined.values()), list(self.exact.expressions.values())
        return Loop(outputs, INPUTS, self.table.reading(), self.table.tables(), plain)

    @property
    def cost(self) -> float:
        """Operations per sample, weighted by their time relative to an addition."""
        return operation_cost(list(self.combined.values())) + (0.0 if self.table is None else self.table.cost)

    def single(self, theta: float, omega: float, alpha: float) -> dict[str, float]:
        """Evaluate the outputs at one sample by the closed forms."""
        return self.exact.single(theta, omega, alpha)

    def fill(self, inputs: Sequence[FloatArray], out: Mapping[str, FloatArray], cores: int = 1) -> None:
        """Evaluate one-dimensional inputs into the arrays of `out`; short blocks use the closed forms."""
        self.loop(inputs, [out[name] for name in self.combined], cores)


def _slopes(expression: Expr, count: int, state: Mapping[str, float | FloatArray]) -> FloatArray:
    """Return the largest absolute derivative of an output with respect to each tabulated value f0, f1, .. over
    states.
    """
    slopes = [derivative([expression], variable(f"f{i}"))[0] for i in range(count)]
    return np.array([np.abs(slope).max() for slope in interpret(slopes, state, np)], dtype=np.float64)
