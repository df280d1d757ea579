"""Exact partial derivatives of expressions, node by node (forward accumulation)."""

from __future__ import annotations

from collections.abc import Iterable

from textile_twin_core.expression.graph import OPERATIONS, Expr, const
from textile_twin_core.expression.traversal import topological_order


def derivative(outputs: Iterable[Expr], with_respect_to: Expr) -> list[Expr]:
    """The partial derivative of each output; steps (sign, at_least) count as constant between their jumps."""
    outputs = list(outputs)
    zero = const(0.0)
    slope = {with_respect_to: const(1.0)}
    for node in topological_order(outputs):
        if node not in slope:
            known = [slope[a] for a in node.args]
            rule = OPERATIONS[node.op].slope if any(d is not zero for d in known) else None
            slope[node] = rule(node, known) if rule else zero
    return [slope[e] for e in outputs]
