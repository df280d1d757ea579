"""Traversals of expressions: order, cost, derivatives and substitution."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from textile_twin_core.expression.graph import OPERATIONS, Expr, const, make


def topological_order(outputs: Iterable[Expr]) -> list[Expr]:
    """List every node that the outputs need, each after its arguments."""
    order: list[Expr] = []
    seen: set[int] = set()
    stack: list[tuple[Expr, bool]] = [(e, False) for e in reversed(list(outputs))]
    while stack:
        node, ready = stack.pop()
        if ready:
            order.append(node)
        elif id(node) not in seen:
            seen.add(id(node))
            stack.append((node, True))
            stack.extend((a, False) for a in reversed(node.args) if id(a) not in seen)
    return order


def operation_counts(outputs: Iterable[Expr]) -> Counter[str]:
    """Count each operation in the nodes that the outputs need."""
    return Counter(node.op for node in topological_order(outputs) if node.args)


def operation_cost(outputs: Iterable[Expr]) -> float:
    """Sum the operations' costs."""
    return sum(OPERATIONS[op].cost * count for op, count in operation_counts(outputs).items())


def substitute(outputs: Iterable[Expr], replacements: Mapping[Expr, Expr]) -> list[Expr]:
    """Replace nodes in the outputs, and fold operations that become constant."""
    outputs = list(outputs)
    new: dict[Expr, Expr] = dict(replacements)
    for node in topological_order(outputs):
        if node not in new:
            args = tuple(new[a] for a in node.args)
            new[node] = node if args == node.args else make(node.op, *args)
    return [new[e] for e in outputs]


def derivative(outputs: Iterable[Expr], with_respect_to: Expr) -> list[Expr]:
    """Differentiate each output exactly; steps (sign, at_least) count as constant between their discontinuities."""
    outputs = list(outputs)
    zero = const(0.0)
    slope = {with_respect_to: const(1.0)}
    for node in topological_order(outputs):
        if node not in slope:
            known = [slope[a] for a in node.args]
            rule = OPERATIONS[node.op].slope if any(d is not zero for d in known) else None
            slope[node] = rule(node, known) if rule else zero
    return [slope[e] for e in outputs]
