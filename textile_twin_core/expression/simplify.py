"""Algebraic rules that replace an operation by a simpler node, for arguments that are not all constant.

Only identities of all real numbers are applied. Products of constants are assumed to stay within the range of a double.
Constant factors are collected in front of sums and products.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from textile_twin_core.expression.graph import Expr, const, make, node, scaled

_ROUNDING_OF_ONE: Final = 4e-16


def _joined(factor: float) -> float:
    """Return a product or quotient of constants, 1 if only its rounding differs from 1."""
    return math.copysign(1.0, factor) if abs(abs(factor) - 1.0) < _ROUNDING_OF_ONE else factor


def add(a: Expr, b: Expr) -> Expr:
    """Simplify a + b."""
    if a.is_constant:
        return _shift(a.value, b)
    if b.is_constant:
        return _shift(b.value, a)
    if b.op == "neg":
        return a - b.args[0]
    if a.op == "neg":
        return b - a.args[0]
    (ka, ra), (kb, rb) = scaled(a), scaled(b)
    if ra is rb:
        return (ka + kb) * ra
    return _of_multiples("add", a, b)


def subtract(a: Expr, b: Expr) -> Expr:
    """Simplify a - b."""
    if b.is_constant:
        return _shift(-b.value, a)
    if b.op == "neg":
        return a + b.args[0]
    if a.is_constant:
        return -_shift(-a.value, b)
    (ka, ra), (kb, rb) = scaled(a), scaled(b)
    if ra is rb:
        return (ka - kb) * ra
    return _of_multiples("sub", a, b)


def _of_multiples(op: str, a: Expr, b: Expr) -> Expr:
    """Build the sum or difference of two multiples, with the larger factor in front if both have one."""
    (ka, ra), (kb, rb) = scaled(a), scaled(b)
    if ka == 1.0 or kb == 1.0:
        return node(op, (a, b))
    if abs(ka) >= abs(kb):
        return ka * _plus_multiple(op, ra, _joined(kb / ka), rb)
    return (kb if op == "add" else -kb) * _plus_multiple(op, rb, _joined(ka / kb), ra)


def _plus_multiple(op: str, a: Expr, factor: float, b: Expr) -> Expr:
    if factor == -1.0:
        op, factor = ("sub" if op == "add" else "add"), 1.0
    return make(op, a, b) if factor == 1.0 else node(op, (a, factor * b))


def _shift(offset: float, e: Expr) -> Expr:
    """Build offset + e, joining the constants of nested sums."""
    if offset == 0.0:
        return e
    if e.op == "add" and e.args[0].is_constant:
        return _shift(offset + e.args[0].value, e.args[1])
    if e.op == "sub" and e.args[0].is_constant:
        return (offset + e.args[0].value) - e.args[1]
    factor, base = scaled(e)
    if factor != 1.0:
        return factor * _shift(offset / factor, base)
    return node("add", (const(offset), e))


def negate(a: Expr) -> Expr:
    """Simplify -a."""
    if a.op == "sub" and scaled(a.args[1])[0] == 1.0:
        return a.args[1] - a.args[0]
    if a.op == "add" and a.args[0].is_constant:
        return node("sub", (const(-a.args[0].value), a.args[1]))
    factor, base = scaled(a)
    return node("neg", (a,)) if factor == 1.0 else -factor * base


def multiply(a: Expr, b: Expr) -> Expr:
    """Simplify a b."""
    if b.is_constant:
        a, b = b, a
    if a.is_constant:
        return _scale(a.value, b)
    (ka, ra), (kb, rb) = scaled(a), scaled(b)
    if ka != 1.0 or kb != 1.0:
        return _joined(ka * kb) * (ra * rb)
    if a is b:
        return node("square", (a,))
    for x, product in ((a, b), (b, a)):
        unsigned = _less_sign(product, x) if product.signed else None
        if unsigned is not None:
            return make("abs", x) * unsigned
    return node("mul", (a, b))


def _scale(factor: float, e: Expr) -> Expr:
    if factor == 0.0:
        return const(0.0)
    if factor == 1.0:
        return e
    if factor == -1.0:
        return -e
    own, base = scaled(e)
    return node("mul", (const(factor), e)) if own == 1.0 else _joined(factor * own) * base


def _less_sign(product: Expr, x: Expr) -> Expr | None:
    """Replace the factor sign(x y) of a product by sign(y), as x sign(x y) = |x| sign(y).

    The result is None if there is no such factor.
    """
    if product.op == "sign":
        base = _less_factor(product.args[0], x)
        return None if base is None else make("sign", base)
    return _in_one_factor(product, lambda factor: _less_sign(factor, x) if factor.signed else None)


def _less_factor(product: Expr, x: Expr) -> Expr | None:
    """Remove the factor x from a product; None if it has no such factor."""
    return const(1.0) if product is x else _in_one_factor(product, lambda factor: _less_factor(factor, x))


def _in_one_factor(product: Expr, change: Callable[[Expr], Expr | None]) -> Expr | None:
    """Change the first factor of a product for which `change` returns a node; None if there is none."""
    for i in (0, 1) if product.op == "mul" else ():
        changed = change(product.args[i])
        if changed is not None:
            return changed * product.args[1 - i]
    return None


def divide(a: Expr, b: Expr) -> Expr:
    """Simplify a / b."""
    if b.is_constant:
        return (1.0 / b.value) * a
    if a.is_constant and a.value != 1.0:
        return a * (1.0 / b)
    (ka, ra), (kb, rb) = scaled(a), scaled(b)
    if ka != 1.0 or kb != 1.0:
        return (ka / kb) * (ra / rb)
    return node("div", (a, b))


def sign(a: Expr) -> Expr:
    """Simplify sign a."""
    factor, base = scaled(a)
    return math.copysign(1.0, factor) * node("sign", (base,))


def square_root(a: Expr) -> Expr:
    """Simplify the root of a, with the root of its factor in front."""
    factor, base = scaled(a)
    if factor < 0.0:
        factor, base = -factor, _opposite(base)
    return math.sqrt(factor) * node("sqrt", (base,))


def _opposite(e: Expr) -> Expr:
    """Build -e, changing the sign in one factor of a product."""
    changed = _in_one_factor(e, lambda factor: _opposite(factor) if factor.op == "add" else None)
    return -e if changed is None else changed


def at_least(a: Expr, b: Expr) -> Expr:
    """Simplify a >= b, moving constants to the side of a constant b."""
    if b.is_constant:
        if a.op == "add" and a.args[0].is_constant:
            return make("at_least", a.args[1], b.value - a.args[0].value)
        factor, base = scaled(a)
        if factor > 0.0 and factor != 1.0:
            return make("at_least", base, b.value / factor)
    return node("at_least", (a, b))


def select(condition: Expr, yes: Expr, no: Expr) -> Expr:
    """Return one of the alternatives if the condition is known."""
    if condition.is_constant or yes is no:
        return yes if yes is no or condition.value else no
    return node("select", (condition, yes, no))
