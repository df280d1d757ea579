"""Real numbers that may be symbolic, and functions for plain and symbolic numbers.

A `Symbolic` number is a float with its nominal value, so that every check and every choice of a closed form sees a
number. It carries an expression of parameters, which enters the graph in place of a constant.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any, Final

from textile_twin_core.expression.graph import Expr, Number, const, make, node
from textile_twin_core.expression.interpret import interpret
from textile_twin_core.expression.traversal import topological_order


class _Nominal(float):
    """Value of a parameter, identified by its name."""

    name: str

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Nominal) and self.name == other.name and float(self) == float(other)

    def __hash__(self) -> int:
        return hash((self.name, float(self)))


class Symbolic(float):
    """A number with a nominal value and its expression of parameters.

    Arithmetic preserves the expression; comparisons use nominal values. A symbolic number equals only itself and is
    truthy, so that no term is dropped because its nominal value is 0.
    """

    __slots__ = ("expr",)
    expr: Expr

    def __new__(cls, value: float, expr: Expr) -> Symbolic:
        """Create a number with that nominal value and expression."""
        made = super().__new__(cls, value)
        made.expr = expr
        return made

    @classmethod
    def parameter(cls, name: str, value: float) -> Symbolic:
        """Create a parameter with that name."""
        nominal = _Nominal(value)
        nominal.name = name
        return cls(value, node("parameter", payload=nominal))

    def _with(self, op: str, other: Any, reflected: bool = False) -> Any:
        if not isinstance(other, (int, float, Fraction)):
            return NotImplemented
        theirs = other if isinstance(other, (int, float)) else float(other)
        a, b = (theirs, self) if reflected else (self, theirs)
        value = _PLAIN[op](float(a), float(b))
        return Symbolic(value, make(op, _expr(a), _expr(b)))

    def __add__(self, other: Any) -> Any:
        return self._with("add", other)

    def __radd__(self, other: Any) -> Any:
        return self._with("add", other, True)

    def __sub__(self, other: Any) -> Any:
        return self._with("sub", other)

    def __rsub__(self, other: Any) -> Any:
        return self._with("sub", other, True)

    def __mul__(self, other: Any) -> Any:
        return self._with("mul", other)

    def __rmul__(self, other: Any) -> Any:
        return self._with("mul", other, True)

    def __truediv__(self, other: Any) -> Any:
        return self._with("div", other)

    def __rtruediv__(self, other: Any) -> Any:
        return self._with("div", other, True)

    def __pow__(self, exponent: Any, modulus: Any = None) -> Any:
        if exponent == 2 and modulus is None:
            return self * self
        return NotImplemented

    def __neg__(self) -> Symbolic:
        return Symbolic(-float(self), -self.expr)

    def __pos__(self) -> Symbolic:
        return self

    def __abs__(self) -> Symbolic:
        return Symbolic(abs(float(self)), make("abs", self.expr))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Symbolic) and self.expr is other.expr

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:
        return id(self.expr)

    def __bool__(self) -> bool:
        return True


_PLAIN: Final[dict[str, Callable[[float, float], float]]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
}


def _expr(value: Number) -> Expr:
    return value.expr if isinstance(value, Symbolic) else const(value)


def is_parametric(expr: Expr) -> bool:
    """Return whether an expression depends on constants and parameters alone."""
    return all(node.op != "variable" for node in topological_order([expr]))


def number_of(expr: Expr) -> float:
    """Return the number of an expression without variables; symbolic if it depends on parameters.

    Raises TypeError for an expression with variables.
    """
    if expr.is_constant:
        return expr.value
    if not is_parametric(expr):
        raise TypeError(f"{expr!r} is not a number")
    return Symbolic(interpret([expr], {}, math)[0], expr)


def exact(value: Any) -> Any:
    """Convert a plain number to a fraction, for differences that nearly cancel; a symbolic one is unchanged."""
    return value if isinstance(value, (Symbolic, Fraction)) else Fraction(value)


def rounded(value: Any) -> float:
    """Convert a result of `exact` arithmetic to a float."""
    return value if isinstance(value, Symbolic) else float(value)


def _function(plain: Callable[..., float], symbolic: Callable[..., Expr]) -> Callable[..., float]:
    def evaluate(*arguments: float) -> float:
        value = plain(*arguments)
        if not any(isinstance(a, Symbolic) for a in arguments):
            return value
        return Symbolic(value, symbolic(*(_expr(a) for a in arguments)))

    evaluate.__doc__ = f"{plain.__name__}, for symbolic numbers too."
    return evaluate


sqrt = _function(math.sqrt, lambda a: make("sqrt", a))
cos = _function(math.cos, lambda a: make("cos", a))
sin = _function(math.sin, lambda a: make("sin", a))
tan = _function(math.tan, lambda a: make("sin", a) / make("cos", a))
atan2 = _function(math.atan2, lambda y, x: make("atan2", y, x))
acos = _function(math.acos, lambda a: make("atan2", make("sqrt", 1.0 - a * a), a))
hypot = _function(math.hypot, lambda x, y: make("sqrt", x * x + y * y))
