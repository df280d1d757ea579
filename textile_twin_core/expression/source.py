"""Expressions as lines of Python: shared nodes are assigned once, others are written inline."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

from textile_twin_core.expression.graph import OPERATIONS, Expr
from textile_twin_core.expression.traversal import topological_order

_MENTIONED_TWICE: Final = frozenset(op for op, record in OPERATIONS.items() if record.source.count("{0}") > 1)


def statements(outputs: Sequence[Expr], deepest: int, paired: bool = False) -> tuple[list[str], list[str]]:
    """Write assignments, and for each output an expression of the assigned names.

    Nodes that are needed once are nested inline, up to `deepest` levels. With `paired`, sine and cosine come from one
    call of sincos, and `far` counts the angles beyond FARTHEST, which sincos cannot reduce.
    """
    order = topological_order(outputs)
    uses = Counter(a for node in order for a in node.args)
    uses.update([*outputs, *(node.args[0] for node in order if node.op in _MENTIONED_TWICE)])
    text: dict[Expr, str] = {}
    depth: dict[Expr, int] = {}
    lines: list[str] = []
    pairs: dict[Expr, int] = {}
    for node in order:
        if not node.args:
            text[node] = str(node.payload) if node.op == "variable" else repr(node.payload)
        elif paired and node.op in ("sin", "cos"):
            (angle,) = node.args
            if angle not in pairs:
                k = pairs[angle] = len(pairs)
                lines.append(f"sin{k}, cos{k} = sincos({text[angle]})")
                lines.append(f"far += 1 if abs({text[angle]}) > FARTHEST else 0")
            text[node] = f"{node.op}{pairs[angle]}"
        else:
            text[node] = OPERATIONS[node.op].source.format(*(text[a] for a in node.args))
            depth[node] = 1 + max(depth.get(a, 0) for a in node.args)
            if uses[node] > 1 or depth[node] > deepest:
                lines.append(f"v{len(lines)} = {text[node]}")
                text[node], depth[node] = f"v{len(lines) - 1}", 0
    return lines, [text[e] for e in outputs]
