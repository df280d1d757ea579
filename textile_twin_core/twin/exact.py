"""The exact method: closed forms in place over chunks, and plain `math` for single samples."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics import INPUTS
from textile_twin_core.expression import Expr
from textile_twin_core.expression.blocks import BlockProgram
from textile_twin_core.expression.cost import operation_cost
from textile_twin_core.expression.scalar import compile_scalar_mapping


class ExactEvaluator:
    """Closed forms of the outputs; each back end is made when first used."""

    def __init__(self, outputs: Mapping[str, Expr]) -> None:
        self.expressions = dict(outputs)

    @cached_property
    def scalar(self) -> Callable[[float, float, float], dict[str, float]]:
        """Function of (theta, omega, alpha), floats, to a dict by output."""
        return compile_scalar_mapping(self.expressions, INPUTS)

    @cached_property
    def program(self) -> BlockProgram:
        """The array program."""
        return BlockProgram(list(self.expressions.values()), INPUTS, arranged=True)

    @property
    def cost(self) -> float:
        """Array operations per sample."""
        return operation_cost(list(self.expressions.values()))

    def fill(self, inputs: tuple[FloatArray, FloatArray, FloatArray], out: Mapping[str, FloatArray]) -> None:
        """Evaluate one-dimensional inputs into the arrays of `out`."""
        self.program(inputs, [out[name] for name in self.expressions])
