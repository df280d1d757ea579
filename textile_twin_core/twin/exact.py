"""Exact method: closed forms, as a compiled loop over long blocks and as plain `math` for single samples."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics import INPUTS
from textile_twin_core.expression import Expr
from textile_twin_core.expression.loop import Loop
from textile_twin_core.expression.scalar import compile_scalar_mapping
from textile_twin_core.expression.traversal import operation_cost


class ExactEvaluator:
    """Evaluator of the closed forms; each back end is built at its first use."""

    def __init__(self, outputs: Mapping[str, Expr]) -> None:
        self.expressions = dict(outputs)
        self.loop = Loop(list(self.expressions.values()), INPUTS)

    @cached_property
    def single(self) -> Callable[[float, float, float], dict[str, float]]:
        """Function of floats (theta, omega, alpha) that returns a dict by output; `fill` may replace it by a
        faster one.

        It raises ValueError where the linkage cannot close, and ZeroDivisionError where its motion is not determined.
        """
        return compile_scalar_mapping(self.expressions, INPUTS)

    def fill(self, inputs: Sequence[FloatArray], out: Mapping[str, FloatArray], cores: int = 1) -> None:
        """Evaluate one-dimensional inputs into the arrays of `out`."""
        self.loop(inputs, [out[name] for name in self.expressions], cores)
        if self.loop.is_compiled and not self._swapped:
            self.single, self._swapped = self._compiled_single(self.single), True

    _swapped = False

    def _compiled_single(self, careful: Callable[..., dict[str, float]]) -> Callable[..., dict[str, float]]:
        """Combine the compiled closed forms with the careful ones, which raise where a value is not finite."""
        values = [f"v{k}" for k in range(len(self.expressions))]
        entries = ", ".join(f"{name!r}: {value}" for name, value in zip(self.expressions, values, strict=True))
        source = [
            "def single(theta, omega, alpha):",
            f"{', '.join(values)}, far = one(theta, omega, alpha)",
            f"if far or not isfinite({' + '.join(values)}): return careful(theta, omega, alpha)",
            f"return {{{entries}}}",
        ]
        scope: dict[str, Any] = {"one": self.loop.single(), "careful": careful, "isfinite": math.isfinite}
        exec(compile("\n    ".join(source), "<twin>", "exec"), scope)
        single: Callable[..., dict[str, float]] = scope["single"]
        return single

    @property
    def cost(self) -> float:
        """Operations per sample, weighted by their time relative to an addition."""
        return operation_cost(list(self.expressions.values()))
