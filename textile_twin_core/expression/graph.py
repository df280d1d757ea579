"""The expression graph: immutable nodes, shared when equal, constants folded as they are made.

Equal sub-expressions are one node (hash-consing), so common work is done once by every back end.
Only identities that hold for all real numbers are applied; constants so large or small that their products leave the
range of a double are no machine's.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from hashlib import blake2b
from typing import Final
from weakref import WeakValueDictionary

Number = float | int


class Expr:
    """A node: an operation, its arguments and, for constants and variables, its value or name.

    `signed` tells a sign, and a product with a sign among its factors; `rank` is the same for the same expression in
    every process, so that arguments stand in one order and results are the same to the last digit.
    """

    __slots__ = ("__weakref__", "args", "op", "payload", "rank", "signed")

    op: str
    args: tuple[Expr, ...]
    payload: object
    rank: bytes
    signed: bool

    def __add__(self, other: Expr | Number) -> Expr:
        return _add(self, as_expr(other))

    def __radd__(self, other: Number) -> Expr:
        return _add(as_expr(other), self)

    def __sub__(self, other: Expr | Number) -> Expr:
        return _subtract(self, as_expr(other))

    def __rsub__(self, other: Number) -> Expr:
        return _subtract(as_expr(other), self)

    def __mul__(self, other: Expr | Number) -> Expr:
        if not isinstance(other, (Expr, float, int)):
            return NotImplemented  # a vector multiplies itself
        return _multiply(self, as_expr(other))

    def __rmul__(self, other: Number) -> Expr:
        return _multiply(as_expr(other), self)

    def __truediv__(self, other: Expr | Number) -> Expr:
        return _divide(self, as_expr(other))

    def __rtruediv__(self, other: Number) -> Expr:
        return _divide(as_expr(other), self)

    def __neg__(self) -> Expr:
        return _negate(self)

    @property
    def is_constant(self) -> bool:
        """Whether this is a number."""
        return self.op == "const"

    @property
    def value(self) -> float:
        """The number of a constant."""
        if not isinstance(self.payload, float):
            raise TypeError(f"{self!r} is not a constant")
        return self.payload

    def __repr__(self) -> str:
        if self.op in ("const", "variable"):
            return str(self.payload)
        return f"{self.op}({', '.join('..' if a.args else repr(a) for a in self.args)})"


_INTERNED: Final[WeakValueDictionary[tuple[object, ...], Expr]] = WeakValueDictionary()
_ROUNDING_OF_ONE: Final = 4e-16
_COMMUTATIVE: Final = frozenset({"add", "mul"})


def node(op: str, args: tuple[Expr, ...] = (), payload: object = None) -> Expr:
    """The one node of an operation and its arguments, as they are; the operators and functions simplify."""
    if op in _COMMUTATIVE and (args[1].is_constant or (args[0].rank > args[1].rank and not args[0].is_constant)):
        args = (args[1], args[0])  # a constant stands first, all else in one order
    key = (op, payload, math.copysign(1.0, payload) if isinstance(payload, float) else None, *map(id, args))
    found = _INTERNED.get(key)
    if found is None:
        found = Expr()
        found.op, found.args, found.payload = op, args, payload
        name = f"{op} {payload!r}".encode()
        found.rank = blake2b(b"".join([name, *(a.rank for a in args)]), digest_size=12).digest()
        found.signed = op == "sign" or (op == "mul" and any(a.signed for a in args))
        _INTERNED[key] = found
    return found


def const(value: Number) -> Expr:
    """A number."""
    return node("const", payload=float(value))


def variable(name: str) -> Expr:
    """A named input."""
    return node("variable", payload=name)


def as_expr(value: Expr | Number) -> Expr:
    """The value itself if it is an expression, else the constant."""
    return value if isinstance(value, Expr) else const(value)


def scaled(e: Expr) -> tuple[float, Expr]:
    """Split into (factor, rest) such that e = factor * rest."""
    if e.op == "mul":
        for i in (0, 1):
            if e.args[i].is_constant:
                return e.args[i].value, e.args[1 - i]
    if e.op == "neg":
        return -1.0, e.args[0]
    return 1.0, e


def _joined(factor: float) -> float:
    """A product or quotient of constants, 1 where only its rounding keeps it from that."""
    return math.copysign(1.0, factor) if abs(abs(factor) - 1.0) < _ROUNDING_OF_ONE else factor


def _add(a: Expr, b: Expr) -> Expr:
    if a.is_constant and b.is_constant:
        return const(a.value + b.value)
    if a.is_constant and a.value == 0.0:
        return b
    if b.is_constant and b.value == 0.0:
        return a
    if b.op == "neg":
        return _subtract(a, b.args[0])
    if a.op == "neg":
        return _subtract(b, a.args[0])
    if a.is_constant:
        return _shift(a.value, b)
    if b.is_constant:
        return _shift(b.value, a)
    (ka, ra), (kb, rb) = scaled(a), scaled(b)
    if ra is rb:
        return const(ka + kb) * ra
    if ka == kb != 1.0:
        return const(ka) * (ra + rb)
    if ka == -kb and ka != 1.0 and kb != 1.0:
        return const(ka) * (ra - rb)
    if ka != 1.0 and kb != 1.0:
        if abs(ka) >= abs(kb):
            return const(ka) * node("add", (ra, const(_joined(kb / ka)) * rb))
        return const(kb) * node("add", (const(_joined(ka / kb)) * ra, rb))
    return node("add", (a, b))


def _subtract(a: Expr, b: Expr) -> Expr:
    if a.is_constant and b.is_constant:
        return const(a.value - b.value)
    if a.is_constant and a.value == 0.0:
        return _negate(b)
    if b.is_constant and b.value == 0.0:
        return a
    if b.op == "neg":
        return _add(a, b.args[0])
    if a is b:
        return const(0.0)
    if b.is_constant:
        return _shift(-b.value, a)
    if a.is_constant:
        if b.op == "add" and b.args[0].is_constant:
            return _subtract(const(a.value - b.args[0].value), b.args[1])
        if b.op == "sub" and b.args[0].is_constant:
            return _shift(a.value - b.args[0].value, b.args[1])
    (ka, ra), (kb, rb) = scaled(a), scaled(b)
    if a.is_constant and kb != 1.0:
        return const(-kb) * _shift(-a.value / kb, rb)
    if ra is rb:
        return const(ka - kb) * ra
    if ka == kb != 1.0:
        return const(ka) * (ra - rb)
    if ka == -kb and ka != 1.0 and kb != 1.0:
        return const(ka) * (ra + rb)
    if ka != 1.0 and kb != 1.0:
        if abs(ka) >= abs(kb):
            return const(ka) * node("sub", (ra, const(_joined(kb / ka)) * rb))
        return const(-kb) * node("sub", (rb, const(_joined(ka / kb)) * ra))
    if ka != 1.0:
        return _negate(node("sub", (b, a)))  # a multiple stands last, where it needs no array of its own
    return node("sub", (a, b))


def _shift(offset: float, e: Expr) -> Expr:
    """offset + e, with the constants of nested sums joined."""
    if offset == 0.0:
        return e
    if e.op == "add" and e.args[0].is_constant:
        return _shift(offset + e.args[0].value, e.args[1])
    if e.op == "sub" and e.args[0].is_constant:
        return _subtract(const(offset + e.args[0].value), e.args[1])
    factor, rest = scaled(e)
    if factor != 1.0:
        return const(factor) * _shift(offset / factor, rest)
    return node("add", (const(offset), e))


def _negate(a: Expr) -> Expr:
    if a.is_constant:
        return const(-a.value)
    if a.op == "neg":
        return a.args[0]
    if a.op == "sub" and scaled(a.args[1])[0] == 1.0:
        return _subtract(a.args[1], a.args[0])
    factor, rest = scaled(a)
    if factor != 1.0:
        return const(-factor) * rest
    return node("neg", (a,))


def _multiply(a: Expr, b: Expr) -> Expr:
    if b.is_constant:
        a, b = b, a
    if a.is_constant:
        if b.is_constant:
            return const(a.value * b.value)
        if a.value == 0.0:
            return const(0.0)
        if a.value == 1.0:
            return b
        if a.value == -1.0:
            return _negate(b)
        factor, rest = scaled(b)
        if factor != 1.0:
            return const(_joined(a.value * factor)) * rest
        return node("mul", (a, b))
    (ka, ra), (kb, rb) = scaled(a), scaled(b)
    if _joined(ka * kb) != 1.0:
        return const(_joined(ka * kb)) * _multiply(ra, rb)
    if ra is not a or rb is not b:
        return _multiply(ra, rb)
    if a is b:
        return node("square", (a,))
    for x, product in ((a, b), (b, a)):
        unsigned = _less_sign(product, x) if product.signed else None
        if unsigned is not None:
            return _times_each(absolute(x), unsigned)
    return node("mul", (a, b))


def _times_each(x: Expr, product: Expr) -> Expr:
    """x times one factor of a product with a sign after the other, so that each can switch x off or turn it round."""
    if product.op == "mul" and product.signed:
        return _times_each(_times_each(x, product.args[0]), product.args[1])
    return _multiply(x, product)


def _less_sign(product: Expr, x: Expr) -> Expr | None:
    """A product with its factor sign(x y) replaced by sign(y), None where it has none: x sign(x y) = |x| sign(y)."""
    if product.op == "sign":
        rest = _less_factor(product.args[0], x)
        return None if rest is None else sign(rest)
    return in_one_factor(product, lambda factor: _less_sign(factor, x) if factor.signed else None)


def _less_factor(product: Expr, x: Expr) -> Expr | None:
    """A product without its factor x, None where it has none."""
    return const(1.0) if product is x else in_one_factor(product, lambda factor: _less_factor(factor, x))


def in_one_factor(product: Expr, change: Callable[[Expr], Expr | None]) -> Expr | None:
    """A product with one factor changed, the first that the change gives something for; None if there is none."""
    if product.op == "mul":
        for i in (0, 1):
            changed = change(product.args[i])
            if changed is not None:
                return changed * product.args[1 - i]
    return None


def _divide(a: Expr, b: Expr) -> Expr:
    if b.is_constant:
        if a.is_constant:
            return const(a.value / b.value)
        return const(1.0 / b.value) * a
    if a.is_constant and a.value == 0.0:
        return a
    if a.is_constant and a.value != 1.0:
        return a * _divide(const(1.0), b)
    (ka, ra), (kb, rb) = scaled(a), scaled(b)
    if ka != 1.0 or kb != 1.0:
        return const(ka / kb) * _divide(ra, rb)
    return node("div", (a, b))


def function(op: str, fold: Callable[[float], float]) -> Callable[[Expr | Number], Expr]:
    """A function of one expression by its operation's name, and what it is of a number."""

    def apply(a: Expr | Number) -> Expr:
        a = as_expr(a)
        return const(fold(a.value)) if a.is_constant else node(op, (a,))

    apply.__name__, apply.__doc__ = op, f"{op} of an expression."
    return apply


absolute = function("abs", abs)
_plain_sign = function("sign", lambda v: float((v > 0) - (v < 0)))


def sign(a: Expr | Number) -> Expr:
    """1, 0 or -1, by the sign of an expression."""
    factor, rest = scaled(as_expr(a))
    if factor > 0.0:
        return _plain_sign(rest)
    return -_plain_sign(rest) if factor < 0.0 else const(0.0)
