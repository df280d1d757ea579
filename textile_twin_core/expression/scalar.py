"""Expressions as lines of Python, and as one plain function of floats for single samples.

Shared nodes are assigned once, others are written inline. The function is straight-line code over `math`: a call costs
little more than its arithmetic.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from textile_twin_core.expression.graph import OPERATIONS, Expr
from textile_twin_core.expression.piecewise_polynomial import Rows, searched
from textile_twin_core.expression.traversal import topological_order

_MENTIONED_TWICE: Final = frozenset(op for op, record in OPERATIONS.items() if record.source.count("{0}") > 1)
ScalarFunction = Callable[..., tuple[float, ...]]
_FUNCTIONS: Final[Mapping[str, Any]] = {name: getattr(math, name) for name in ("sqrt", "sin", "cos", "atan2")}


def statements(outputs: Sequence[Expr], deepest: int, paired: bool = False) -> tuple[list[str], list[str]]:
    """Write assignments, and for each output an expression of the assigned names.

    Nodes that are needed once are nested inline, up to `deepest` levels. With `paired`, sine and cosine come from one
    call of sincos, and `far` counts the angles beyond FARTHEST, which sincos cannot reduce; the arrays of a piecewise
    polynomial have its own names.
    """
    outputs = searched(outputs)
    order = topological_order(outputs)
    uses = Counter(a for node in order for a in node.args)
    uses.update([*outputs, *(node.args[0] for node in order if node.op in _MENTIONED_TWICE)])
    uses.update(a for node in order if node.op == "piecewise" for a in node.args)
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
        elif isinstance(node.payload, Rows):
            k, (place, condition) = len(lines), (text[a] for a in node.args)
            if paired:
                name = node.payload.name
                lines.append(f"v{k} = piece({place}, {condition}, edges_{name}, {name})")
            else:
                numbers = [f"{letter}{k}" for letter in "oabcd"[: node.payload.degree + 2]]
                lines.append(f"{', '.join(numbers)} = {_choice(node.payload, place, condition)}")
                value = numbers[-1]
                for number in numbers[-2:0:-1]:
                    value = f"{number} + t{k} * ({value})"
                lines += [f"t{k} = {place} - o{k}", f"v{k} = {value}"]
            text[node] = f"v{k}"
        else:
            text[node] = OPERATIONS[node.op].source.format(*(text[a] for a in node.args))
            depth[node] = 1 + max(depth.get(a, 0) for a in node.args)
            if uses[node] > 1 or depth[node] > deepest:
                lines.append(f"v{len(lines)} = {text[node]}")
                text[node], depth[node] = f"v{len(lines) - 1}", 0
    return lines, [text[e] for e in outputs]


def _choice(rows: Rows, place: str, condition: str) -> str:
    """Write the choice of a row by comparisons, which take less time than a call of a search."""
    used = rows.degree + 2
    pairs = [(a[:used], b[:used]) for a, b in zip(rows.yes, rows.no, strict=True)]
    leaves = [f"{a}" if a == b else f"({a} if {condition} else {b})" for a, b in pairs]

    def between(low: int, high: int) -> str:
        if low == high:
            return leaves[low]
        middle = (low + high) // 2
        return f"({between(low, middle)} if {place} < {rows.edges[middle]!r} else {between(middle + 1, high)})"

    return between(0, len(rows.edges))


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
