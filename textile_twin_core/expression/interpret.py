"""Evaluate expressions with any number type: floats, complex numbers (complex step), mpmath's numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from textile_twin_core.expression.graph import Expr
from textile_twin_core.expression.traversal import topological_order


def interpret(outputs: Iterable[Expr], inputs: Mapping[str, Any], functions: Any) -> list[Any]:
    """Values of the outputs for the inputs by name.

    `functions` is a module or namespace with sqrt, sin and cos (and atan2 where an angle is asked):
    math, cmath, mpmath; arrays of any float type do as well. Constants of the graph stay what they are, IEEE doubles.
    """
    outputs = list(outputs)
    value: dict[Expr, Any] = {}
    for node in topological_order(outputs):
        a = [value[x] for x in node.args]
        match node.op:
            case "const":
                value[node] = node.payload
            case "variable":
                value[node] = inputs[str(node.payload)]
            case "add":
                value[node] = a[0] + a[1]
            case "sub":
                value[node] = a[0] - a[1]
            case "mul":
                value[node] = a[0] * a[1]
            case "div":
                value[node] = a[0] / a[1]
            case "neg":
                value[node] = -a[0]
            case "square":
                value[node] = a[0] * a[0]
            case "abs":
                value[node] = a[0] * _sign(a[0])
            case "sign":
                value[node] = _sign(a[0])
            case "at_least":
                value[node] = 1.0 * (_real(a[0]) >= _real(a[1]))
            case "select":
                value[node] = a[1] * a[0] + a[2] * (1.0 - a[0])
            case "sqrt" | "sin" | "cos" | "atan2":
                value[node] = getattr(functions, node.op)(*a)
            case _:
                raise TypeError(f"'{node.op}' has no meaning outside its own evaluator")
    return [value[e] for e in outputs]


def _sign(number: Any) -> Any:
    real = _real(number)
    return 1.0 * (real > 0) - 1.0 * (real < 0)


def _real(number: Any) -> Any:
    return number.real if isinstance(number, complex) else number
