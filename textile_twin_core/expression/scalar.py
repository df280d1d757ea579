"""Expressions as one plain Python function of floats, for single samples.

The function is straight-line code over `math`: a call costs little more than its arithmetic.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from textile_twin_core.expression.graph import Expr
from textile_twin_core.expression.source import statements

ScalarFunction = Callable[..., tuple[float, ...]]

_FUNCTIONS: Final[Mapping[str, Any]] = {name: getattr(math, name) for name in ("sqrt", "sin", "cos", "atan2")}


def scalar_source(outputs: Sequence[Expr], inputs: Sequence[str], names: Sequence[str] | None = None) -> str:
    """Write the source of `def f(inputs): ...`, which returns the outputs as a tuple, or as a dict by name."""
    lines, values = statements(outputs, deepest=24)
    entries = [f"{name!r}: {value}" for name, value in zip(names or (), values, strict=names is not None)]
    returned = f"({', '.join(values)},)" if names is None else f"{{{', '.join(entries)}}}"
    return "\n    ".join([f"def f({', '.join(inputs)}):", *lines, f"return {returned}"])


def compile_scalar(outputs: Sequence[Expr], inputs: Sequence[str]) -> ScalarFunction:
    """Compile a function of float inputs that returns the outputs as a tuple of floats.

    The function raises ValueError for a square root of a negative number, where the linkage cannot close.
    """
    function: ScalarFunction = _compiled(scalar_source(outputs, inputs))
    return function


def compile_scalar_mapping(outputs: Mapping[str, Expr], inputs: Sequence[str]) -> Callable[..., dict[str, float]]:
    """Compile a function as `compile_scalar` does, which returns a dict by output name."""
    function: Callable[..., dict[str, float]] = _compiled(scalar_source([*outputs.values()], inputs, [*outputs]))
    return function


def _compiled(source: str) -> Any:
    namespace = {**_FUNCTIONS, "abs": math.fabs}
    exec(compile(source, "<twin>", "exec"), namespace)
    return namespace["f"]
