"""Expressions as C99 statements of doubles, for FMUs and for the benchmark."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from textile_twin_core.expression.graph import Expr, variable
from textile_twin_core.expression.traversal import substitute, topological_order

PLAIN_SINCOS: Final = """static inline void both(double x, double *s, double *c) { *s = sin(x); *c = cos(x); }
"""
"""Default definition of `both`: sine and cosine by the C library."""
_INFIX: Final = {"add": "+", "sub": "-", "mul": "*", "div": "/"}


def c_statements(outputs: Sequence[Expr], prefix: str = "v") -> tuple[list[str], list[str]]:
    """Write declarations of doubles, and for each output a C expression of them.

    A variable is written as its payload, which is C text: `variable("theta[i]")` reads an array. Sine and cosine of one
    angle come from one call of `both`, which the caller defines (see `PLAIN_SINCOS`).
    """
    name: dict[Expr, str] = {}
    pairs: dict[Expr, str] = {}
    lines: list[str] = []
    for node in topological_order(outputs):
        if node.op in ("const", "parameter"):
            name[node] = f"({float(node.payload)!r})"  # type: ignore[arg-type]
            continue
        if node.op == "variable":
            name[node] = str(node.payload)
            continue
        if node.op in ("sin", "cos"):
            (angle,) = node.args
            if angle not in pairs:
                k = pairs[angle] = f"{len(pairs)}"
                lines.append(f"double {prefix}s{k}, {prefix}c{k}; both({name[angle]}, &{prefix}s{k}, &{prefix}c{k});")
            name[node] = f"{prefix}{node.op[0]}{pairs[angle]}"
            continue
        name[node] = f"{prefix}{len(lines)}"
        lines.append(f"double {name[node]} = {_value(node.op, [name[a] for a in node.args])};")
    return lines, [name[e] for e in outputs]


def c_function(signature: str, outputs: Sequence[Expr], into: str) -> str:
    """Write a C function with that signature which stores the outputs in the array `into`."""
    lines, values = c_statements(outputs)
    stores = [f"{into}[{k}] = {value};" for k, value in enumerate(values)]
    body = "\n".join(f"    {line}" for line in [*lines, *stores])
    return f"{signature} {{\n{body}\n}}\n"


def hoisted(groups: Sequence[Sequence[Expr]], array: str) -> tuple[list[Expr], list[list[Expr]]]:
    """Move the sub-expressions of parameters alone out of several lists of outputs.

    Returns:
        Expressions of parameters to be computed once, and the lists with their values as `array[k]`.
    """
    order = topological_order([e for group in groups for e in group])
    fixed: dict[Expr, bool] = {}
    for node in order:
        fixed[node] = node.op != "variable" and all(fixed[a] for a in node.args)
    used = {a for node in order if not fixed[node] for a in node.args} | {e for group in groups for e in group}
    taken = [node for node in order if fixed[node] and node in used and not node.is_constant]
    new = {node: variable(f"{array}[{k}]") for k, node in enumerate(taken)}
    return taken, [substitute(group, new) for group in groups]


def parameters_in(outputs: Iterable[Expr]) -> list[str]:
    """List the names of the parameters in the outputs."""
    return [node.payload.name for node in topological_order(outputs) if node.op == "parameter"]  # type: ignore[attr-defined]


def with_parameters(outputs: Iterable[Expr], text: Mapping[str, str]) -> list[Expr]:
    """Replace each parameter in the outputs by a variable with that C text."""
    outputs = list(outputs)
    nodes = [node for node in topological_order(outputs) if node.op == "parameter"]
    return substitute(outputs, {node: variable(text[node.payload.name]) for node in nodes})  # type: ignore[attr-defined]


def _value(op: str, a: Sequence[str]) -> str:
    match op:
        case "add" | "sub" | "mul" | "div":
            return f"{a[0]} {_INFIX[op]} {a[1]}"
        case "neg":
            return f"-{a[0]}"
        case "square":
            return f"{a[0]} * {a[0]}"
        case "sqrt":
            return f"sqrt({a[0]})"
        case "abs":
            return f"fabs({a[0]})"
        case "sign":
            return f"(double)({a[0]} > 0.0) - (double)({a[0]} < 0.0)"
        case "at_least":
            return f"{a[0]} >= {a[1]} ? 1.0 : 0.0"
        case "select":
            return f"{a[0]} != 0.0 ? {a[1]} : {a[2]}"
        case "piecewise":
            return a[2]
        case "atan2":
            return f"atan2({a[0]}, {a[1]})"
        case _:
            raise TypeError(f"'{op}' has no C form")
