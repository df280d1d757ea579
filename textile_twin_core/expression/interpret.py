"""Evaluation of expressions with any number type: arrays, extended precision, complex numbers, mpmath, symbols."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any

from textile_twin_core.expression.graph import OPERATIONS, Expr
from textile_twin_core.expression.traversal import topological_order


def interpret(outputs: Iterable[Expr], inputs: Mapping[str, Any], functions: Any) -> list[Any]:
    """Evaluate the outputs for the inputs by name.

    `functions` is a module or namespace with sqrt, sin and cos, such as math, cmath, mpmath or numpy. Expressions with
    angles need atan2; conditions on arrays need `where`. Constants remain IEEE doubles.
    """
    leaves, steps, places = _plan(tuple(outputs))
    value: dict[int, Any] = {k: inputs[str(e.payload)] if e.op == "variable" else e.payload for k, e in leaves}
    for k, operation, arguments, done in steps:
        value[k] = operation(functions, *[value[i] for i in arguments])
        for i in done:
            del value[i]  # frees cache for the arrays of later operations
    return [value[k] for k in places]


@lru_cache(maxsize=64)
def _plan(outputs: tuple[Expr, ...]) -> tuple[list[Any], list[Any], list[int]]:
    """Order the evaluation: inputs, operations with arguments and values to free afterwards, places of the outputs."""
    order = topological_order(outputs)
    place = {e: k for k, e in enumerate(order)}
    last = {place[a]: k for k, e in enumerate(order) for a in e.args} | {place[e]: -1 for e in outputs}
    arguments = [[place[a] for a in e.args] for e in order]
    steps = [
        (k, OPERATIONS[e.op].value, arguments[k], [i for i in {*arguments[k]} if last[i] == k])
        for k, e in enumerate(order)
        if e.args
    ]
    return [(k, e) for k, e in enumerate(order) if not e.args], steps, [place[e] for e in outputs]
