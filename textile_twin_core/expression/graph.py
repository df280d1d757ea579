"""The expression graph: immutable nodes, shared when equal.

Equal sub-expressions are one node (hash-consing), so that every back end computes them once. `operations` has one
record for each operation; `simplify` has the rules that replace a node by a simpler one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from typing import Any, Final
from weakref import WeakValueDictionary

Number = float | int


class Expr:
    """A node: an operation, its arguments and, for constants and variables, its value or name.

    Attributes:
        is_constant: whether the node is a number.
        signed: whether the node is a sign, or a product with a sign among its factors.
        rank: key of the expression that is the same in every process; it orders arguments, which makes results
            reproducible to the last digit.

    Examples:
        >>> from textile_twin_core.expression import const, sqrt
        >>> sqrt(const(9.0)).value
        3.0
    """

    __slots__ = ("__weakref__", "args", "is_constant", "op", "payload", "rank", "signed")

    op: str
    args: tuple[Expr, ...]
    payload: object
    rank: bytes
    is_constant: bool
    signed: bool

    def __add__(self, other: Expr | Number) -> Expr:
        return make("add", self, other)

    def __radd__(self, other: Number) -> Expr:
        return make("add", other, self)

    def __sub__(self, other: Expr | Number) -> Expr:
        return make("sub", self, other)

    def __rsub__(self, other: Number) -> Expr:
        return make("sub", other, self)

    def __mul__(self, other: Expr | Number) -> Expr:
        if not isinstance(other, (Expr, float, int)):
            return NotImplemented  # Vector multiplies itself by an expression
        return make("mul", self, other)

    def __rmul__(self, other: Number) -> Expr:
        return make("mul", other, self)

    def __truediv__(self, other: Expr | Number) -> Expr:
        return make("div", self, other)

    def __rtruediv__(self, other: Number) -> Expr:
        return make("div", other, self)

    def __neg__(self) -> Expr:
        return make("neg", self)

    @property
    def value(self) -> float:
        """Number of a constant."""
        if not isinstance(self.payload, float):
            raise TypeError(f"{self!r} is not a constant")
        return self.payload

    def __repr__(self) -> str:
        if self.op in ("const", "variable"):
            return str(self.payload)
        return f"{self.op}({', '.join('..' if a.args else repr(a) for a in self.args)})"


@dataclass(frozen=True)
class Operation:
    """Properties of an operation.

    Attributes:
        value: value for arguments of any number type, given a namespace of functions (math, mpmath, numpy ..) first.
        source: Python source of the value of floats, for scalar code and for compiled loops.
        slope: derivative of a node from the derivatives of its arguments; None for piecewise constant functions.
        rule: rule that returns a simpler equivalent node.
        cost: time in a compiled loop, as a multiple of that of an addition.
    """

    value: Callable[..., Any]
    source: str
    slope: Callable[[Expr, Sequence[Expr]], Expr] | None = None
    rule: Callable[..., Expr] | None = None
    cost: float = 1.0


OPERATIONS: Final[dict[str, Operation]] = {}
"""Operations by name, filled by the module `operations`."""

_INTERNED: Final[WeakValueDictionary[tuple[object, ...], Expr]] = WeakValueDictionary()
_COMMUTATIVE: Final = frozenset({"add", "mul"})


def make(op: str, *arguments: Expr | Number) -> Expr:
    """Build an operation on expressions and numbers: folded if all are constant, simplified if a rule applies."""
    args = tuple([a if isinstance(a, Expr) else const(a) for a in arguments])
    operation = OPERATIONS[op]
    for a in args:
        if not a.is_constant:
            return operation.rule(*args) if operation.rule else node(op, args)
    return const(operation.value(math, *(a.value for a in args)))


def node(op: str, args: tuple[Expr, ...] = (), payload: object = None) -> Expr:
    """Return the unique node of an operation and its arguments, without simplification."""
    if op in _COMMUTATIVE and (args[1].is_constant or (args[0].rank > args[1].rank and not args[0].is_constant)):
        args = (args[1], args[0])  # constants first, other arguments by rank
    key = (op, payload, math.copysign(1.0, payload) if isinstance(payload, float) else None, *map(id, args))
    found = _INTERNED.get(key)
    if found is None:
        found = Expr()
        found.op, found.args, found.payload, found.is_constant = op, args, payload, op == "const"
        name = f"{op} {payload!r}".encode()
        found.rank = blake2b(b"".join([name, *[a.rank for a in args]]), digest_size=12).digest()
        found.signed = op == "sign" or (op == "mul" and (args[0].signed or args[1].signed))
        _INTERNED[key] = found
    return found


def const(value: Number) -> Expr:
    """Return a number as an expression; a symbolic number (see `real`) gives its own expression.

    Args:
        value: the number.

    Returns:
        The constant.

    Examples:
        >>> from textile_twin_core.expression import const
        >>> (const(2.0) * const(3.0)).value
        6.0
    """
    expr = getattr(value, "expr", None)
    if isinstance(expr, Expr):
        return expr
    return node("const", payload=float(value))


def variable(name: str) -> Expr:
    """Return a named input."""
    return node("variable", payload=name)


def as_expr(value: Expr | Number) -> Expr:
    """Return the value itself if it is an expression, else a constant."""
    return value if isinstance(value, Expr) else const(value)


def scaled(e: Expr) -> tuple[float, Expr]:
    """Split an expression into (factor, base) such that e = factor * base."""
    if e.op == "mul" and e.args[0].is_constant:
        return e.args[0].value, e.args[1]
    if e.op == "neg":
        return -1.0, e.args[0]
    return 1.0, e
