"""The exact method: closed forms, as a compiled loop over long blocks and by plain `math` for single samples."""

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
    """Closed forms of the outputs; each back end is made when first used."""

    def __init__(self, outputs: Mapping[str, Expr]) -> None:
        self.expressions = dict(outputs)
        self.loop = Loop(list(self.expressions.values()), INPUTS)

    @cached_property
    def single(self) -> Callable[[float, float, float], dict[str, float]]:
        """Function of (theta, omega, alpha), floats, to a dict by output; `fill` may put a faster one in its place.

        It raises ValueError where the linkage cannot close, ZeroDivisionError where its motion is not determined.
        """
        return compile_scalar_mapping(self.expressions, INPUTS)

    def fill(self, inputs: Sequence[FloatArray], out: Mapping[str, FloatArray], cores: int = 1) -> None:
        """Evaluate one-dimensional inputs into the arrays of `out`."""
        self.loop(inputs, [out[name] for name in self.expressions], cores)
        if self.loop.is_compiled and not self._swapped:
            self.single, self._swapped = self._compiled_single(self.single), True

    _swapped = False

    def _compiled_single(self, careful: Callable[..., dict[str, float]]) -> Callable[..., dict[str, float]]:
        """The compiled closed forms, and the careful ones, which raise, where a value is not finite."""
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
        """Operations per sample, weighed against additions."""
        return operation_cost(list(self.expressions.values()))
