"""Exact partial derivatives of expressions, node by node (forward accumulation)."""

from __future__ import annotations

from collections.abc import Iterable

from textile_twin_core.expression.functions import cos, select, sin
from textile_twin_core.expression.graph import Expr, const, sign
from textile_twin_core.expression.traversal import topological_order


def derivative(outputs: Iterable[Expr], with_respect_to: Expr) -> list[Expr]:
    """The partial derivative of each output; steps (sign, at_least) count as constant between their jumps."""
    outputs = list(outputs)
    slope: dict[Expr, Expr] = {}
    zero, one = const(0.0), const(1.0)
    for node in topological_order(outputs):
        d = [slope[a] for a in node.args]
        if node is with_respect_to:
            slope[node] = one
        elif all(x is zero for x in d) or node.op in ("sign", "at_least"):
            slope[node] = zero
        else:
            slope[node] = _chain(node, d)
    return [slope[e] for e in outputs]


def _chain(node: Expr, d: list[Expr]) -> Expr:
    a = node.args
    match node.op:
        case "add":
            return d[0] + d[1]
        case "sub":
            return d[0] - d[1]
        case "mul":
            return d[0] * a[1] + a[0] * d[1]
        case "div":
            return (d[0] - node * d[1]) / a[1]
        case "neg":
            return -d[0]
        case "square":
            return 2.0 * a[0] * d[0]
        case "sqrt":
            return 0.5 * d[0] / node
        case "sin":
            return cos(a[0]) * d[0]
        case "cos":
            return -(sin(a[0]) * d[0])
        case "abs":
            return sign(a[0]) * d[0]
        case "atan2":
            return (a[1] * d[0] - a[0] * d[1]) / (a[0] * a[0] + a[1] * a[1])
        case "select":
            return select(a[0], d[1], d[2])
    raise TypeError(f"no derivative is known for '{node.op}'")
