"""Functions of expressions; what is constant is folded."""

from __future__ import annotations

import math

from textile_twin_core.expression.graph import Expr, Number, as_expr, const, function, in_one_factor, node, scaled

sin = function("sin", math.sin)
cos = function("cos", math.cos)
_plain_sqrt = function("sqrt", math.sqrt)


def sqrt(a: Expr | Number) -> Expr:
    """The square root of an expression."""
    factor, rest = scaled(as_expr(a))
    if factor < 0.0:
        factor, rest = -factor, _opposite(rest)
    return const(math.sqrt(factor)) * _plain_sqrt(rest)


def _opposite(e: Expr) -> Expr:
    """-e, in one of its factors if it is a product."""
    if e.op == "add" and e.args[0].is_constant:
        return node("sub", (const(-e.args[0].value), e.args[1]))
    changed = in_one_factor(e, lambda factor: _opposite(factor) if factor.op == "add" else None)
    return -e if changed is None else changed


def square(a: Expr | Number) -> Expr:
    """The square of an expression."""
    return as_expr(a) * as_expr(a)


def atan2(y: Expr | Number, x: Expr | Number) -> Expr:
    """The angle of the direction (x, y), in (-pi, pi]."""
    y, x = as_expr(y), as_expr(x)
    if y.is_constant and x.is_constant:
        return const(math.atan2(y.value, x.value))
    return node("atan2", (y, x))


def at_least(a: Expr | Number, b: Expr | Number) -> Expr:
    """1 where a >= b, else 0."""
    a, b = as_expr(a), as_expr(b)
    if a.is_constant and b.is_constant:
        return const(float(a.value >= b.value))
    if b.is_constant:
        if a.op == "add" and a.args[0].is_constant:
            return at_least(a.args[1], b.value - a.args[0].value)
        factor, rest = scaled(a)
        if factor > 0.0 and factor != 1.0:
            return at_least(rest, b.value / factor)
    return node("at_least", (a, b))


def select(condition: Expr | Number, yes: Expr | Number, no: Expr | Number) -> Expr:
    """`yes` where the condition is not 0, else `no`; both are evaluated."""
    condition, yes, no = as_expr(condition), as_expr(yes), as_expr(no)
    if condition.is_constant:
        return yes if condition.value else no
    if yes is no:
        return yes
    return node("select", (condition, yes, no))
