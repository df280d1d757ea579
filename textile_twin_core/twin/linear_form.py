"""Linear forms of outputs: smooth functions of the shaft angle times speed, its square, acceleration and loads.

Every output of one degree of freedom has this form, with the intensities of the loads as further factors. The functions
of the angle alone are tabulated once; discontinuous factors stay exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from textile_twin_core.dynamics import ShaftState
from textile_twin_core.expression import Expr, const, derivative, substitute, topological_order, variable
from textile_twin_core.expression.scalar import compile_scalar
from textile_twin_core.machine.machine import Machine
from textile_twin_core.machine.model import MachineModel
from textile_twin_core.mechanism import THETA

OMEGA_SQUARED = variable("omega_squared")
_DISCONTINUOUS = frozenset({"sign", "at_least", "abs", "select"})
_FACTORS = (variable("omega"), OMEGA_SQUARED, variable("alpha"))


@dataclass(frozen=True)
class LinearForm:
    """Linear form: output = winding * theta + sum of coefficient(theta) * factor; the factor None stands for 1."""

    winding: float
    terms: tuple[tuple[Expr, Expr | None], ...]


class LinearForms:
    """Linear forms of the outputs of a machine, with the intensities of its loads as variables."""

    def __init__(self, machine: Machine) -> None:
        self._model = MachineModel(machine, ShaftState(omega_squared=OMEGA_SQUARED), loads_as_variables=True)
        self.intensities = {
            linkage.intensity_variable(i): true.intensity(i)
            for linkage, true in zip(self._model.linkages, machine.model.linkages, strict=True)
            for i in range(len(machine.loads))
        }

    def form(self, output: str) -> LinearForm | None:
        """Return the linear form of an output; None if it is not linear or not smooth in the angle."""
        expression = self._model.output(output)
        factors = [*_FACTORS, *self.intensities]
        constant = substitute([expression], dict.fromkeys(factors, const(0.0)))[0]
        coefficients = [derivative([expression], f)[0] for f in factors]
        if not all(_smooth_in_theta(e) for e in (constant, *coefficients)):
            return None
        winding = _winding(constant)
        terms = [(constant - winding * THETA, None), *zip(coefficients, factors, strict=True)]
        zero = const(0.0)
        return LinearForm(winding, tuple((e, f) for e, f in terms if e is not zero))


def depends_on(expression: Expr) -> set[str]:
    """Return the variables of an expression."""
    return {str(node.payload) for node in topological_order([expression]) if node.op == "variable"}


def is_smooth(expression: Expr) -> bool:
    """Return true if the expression has no step and no kink."""
    return all(node.op not in _DISCONTINUOUS for node in topological_order([expression]))


def _smooth_in_theta(expression: Expr) -> bool:
    return depends_on(expression) <= {"theta"} and is_smooth(expression)


def _winding(expression: Expr) -> float:
    (winds,) = compile_scalar([expression], ["theta"])(2.0 * math.pi)
    (begins,) = compile_scalar([expression], ["theta"])(0.0)
    return float(round((winds - begins) / (2.0 * math.pi)))
