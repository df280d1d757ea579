"""What expressions cost: operations per sample, counted by kind and weighed against an addition."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from textile_twin_core.expression.graph import Expr
from textile_twin_core.expression.traversal import topological_order

WEIGHTS = {"div": 3.0, "sqrt": 3.0, "sin": 20.0, "cos": 20.0, "atan2": 60.0, "at_least": 2.0, "select": 3.0}
"""Time of an operation on a cached block, as multiples of an addition's; the rest weigh 1."""


def operation_counts(outputs: Iterable[Expr]) -> Counter[str]:
    """How often each operation stands in what the outputs need."""
    return Counter(node.op for node in topological_order(outputs) if node.op not in ("const", "variable"))


def operation_cost(outputs: Iterable[Expr]) -> float:
    """The weighed sum of the operations."""
    return sum(WEIGHTS.get(op, 1.0) * count for op, count in operation_counts(outputs).items())
