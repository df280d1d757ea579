"""Walks through expressions: their order, and replacing parts of them."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Mapping
from typing import Final

from textile_twin_core.expression.functions import at_least, atan2, cos, select, sin, sqrt, square
from textile_twin_core.expression.graph import Expr, absolute, sign


def topological_order(outputs: Iterable[Expr]) -> list[Expr]:
    """Every node that the outputs need, each after its arguments."""
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


_REBUILD: Final[Mapping[str, Callable[..., Expr]]] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": operator.truediv,
    "neg": operator.neg,
    "sqrt": sqrt,
    "sin": sin,
    "cos": cos,
    "abs": absolute,
    "sign": sign,
    "square": square,
    "atan2": atan2,
    "at_least": at_least,
    "select": select,
}


def substitute(outputs: Iterable[Expr], replacements: Mapping[Expr, Expr]) -> list[Expr]:
    """The outputs with nodes replaced and what then is constant folded."""
    outputs = list(outputs)
    new: dict[Expr, Expr] = dict(replacements)
    for node in topological_order(outputs):
        if node in new:
            continue
        args = tuple(new[a] for a in node.args)
        if args == node.args:
            new[node] = node
        else:
            new[node] = _REBUILD[node.op](*args)
    return [new[e] for e in outputs]
