"""Expressions as one plain Python function of floats, for single samples.

Straight-line code over `math`, each shared node computed once, the others written in place:
a call costs little more than its arithmetic.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from textile_twin_core.expression.graph import Expr
from textile_twin_core.expression.traversal import topological_order

_INFIX = {"add": "({} + {})", "sub": "({} - {})", "mul": "({} * {})", "div": "({} / {})", "neg": "(-{})"}
_CALLS = {"sqrt": "sqrt({})", "sin": "sin({})", "cos": "cos({})", "abs": "abs({})", "atan2": "atan2({}, {})"}
_SWITCHES = {"at_least": "({} >= {})", "select": "({1} if {0} else {2})"}
_TWICE = {"square": "({0} * {0})", "sign": "(({0} > 0.0) - ({0} < 0.0) if {0} == {0} else {0})"}
_DEEPEST = 24

ScalarFunction = Callable[..., tuple[float, ...]]


def scalar_source(
    outputs: Sequence[Expr], inputs: Sequence[str], result: str = "({},)", prologue: Sequence[str] = ()
) -> str:
    """Source of `def f(inputs): ...` that returns `result` with the outputs' expressions put in its place.

    The lines of the prologue stand first; they may make further variables of the expressions.
    """
    order = topological_order(outputs)
    uses = Counter(a for node in order for a in node.args)
    uses.update(outputs)
    for node in order:
        if node.op in _TWICE:
            uses[node.args[0]] += 1
    text: dict[Expr, str] = {}
    depth: dict[Expr, int] = {}
    lines: list[str] = []
    for node in order:
        if node.op == "const":
            text[node] = repr(node.payload)
        elif node.op == "variable":
            text[node] = str(node.payload)
        else:
            body = _template(node.op).format(*(text[a] for a in node.args))
            depth[node] = 1 + max(depth.get(a, 0) for a in node.args)
            if uses[node] > 1 or depth[node] > _DEEPEST:
                name = f"v{len(lines)}"
                lines.append(f"    {name} = {body}")
                text[node], depth[node] = name, 0
            else:
                text[node] = body
    returned = (
        result.format(*(text[e] for e in outputs))
        if "{0}" in result
        else result.format(", ".join(text[e] for e in outputs))
    )
    return "\n".join([f"def f({', '.join(inputs)}):", *prologue, *lines, f"    return {returned}"])


def compile_scalar(outputs: Sequence[Expr], inputs: Sequence[str]) -> ScalarFunction:
    """A function of the inputs, floats, that returns the outputs as a tuple of floats.

    It raises ValueError where a square root has a negative argument: the linkage cannot close there.
    """
    function: ScalarFunction = _compiled(scalar_source(outputs, inputs))
    return function


def compile_scalar_mapping(
    outputs: Mapping[str, Expr],
    inputs: Sequence[str],
    prologue: Sequence[str] = (),
    names: Mapping[str, Any] | None = None,
) -> Callable[..., dict[str, float]]:
    """As `compile_scalar`, but the function returns a dict by output name.

    `prologue` is source that stands first, `names` what it may use.
    """
    entries = ", ".join(f"{name!r}: {{{i}}}" for i, name in enumerate(outputs))
    source = scalar_source(list(outputs.values()), inputs, "{{" + entries + "}}", prologue)
    function: Callable[..., dict[str, float]] = _compiled(source, names or {})
    return function


def _template(op: str) -> str:
    for table in (_INFIX, _CALLS, _SWITCHES, _TWICE):
        if op in table:
            return table[op]
    raise TypeError(f"'{op}' has no scalar form")


def _compiled(source: str, names: Mapping[str, Any] | None = None) -> Any:
    namespace: dict[str, Any] = {name: getattr(math, name) for name in ("sqrt", "sin", "cos", "atan2")}
    namespace["abs"] = math.fabs
    namespace.update(names or {})
    exec(compile(source, "<twin>", "exec"), namespace)
    return namespace["f"]
