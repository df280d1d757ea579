"""Evaluate expressions with any number type: arrays, extended precision, complex numbers, mpmath's, symbols."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from textile_twin_core.expression.graph import OPERATIONS, Expr
from textile_twin_core.expression.traversal import topological_order


def interpret(outputs: Iterable[Expr], inputs: Mapping[str, Any], functions: Any) -> list[Any]:
    """Values of the outputs for the inputs by name.

    `functions` is a module or namespace with sqrt, sin and cos (and atan2 where an angle is asked, and `where` where
    conditions are no plain numbers): math, cmath, mpmath, arrays' own. Constants stay what they are, IEEE doubles.
    """
    outputs = list(outputs)
    order = topological_order(outputs)
    readers = Counter([*outputs, *(a for node in order for a in node.args)])
    value: dict[Expr, Any] = {}
    for node in order:
        if not node.args:
            value[node] = node.payload if node.op == "const" else inputs[str(node.payload)]
        else:
            value[node] = OPERATIONS[node.op].value(functions, *(value[a] for a in node.args))
        for a in node.args:
            readers[a] -= 1
            if not readers[a]:
                del value[a]  # so that arrays of the next operations find room in the cache
    return [value[e] for e in outputs]
