"""Records of all operations, and the functions that build expressions from them."""

from __future__ import annotations

from functools import partial
from typing import Any

from textile_twin_core.expression import simplify
from textile_twin_core.expression.graph import OPERATIONS, Expr, Number, Operation, make

sin, cos = partial(make, "sin"), partial(make, "cos")
square = partial(make, "square")
sign = partial(make, "sign")
"""Sign of an expression: 1, 0 or -1."""


def sqrt(x: Expr | Number) -> Expr:
    """Express the square root.

    Args:
        x: an expression or number that is not negative.

    Returns:
        The root.

    Examples:
        >>> from textile_twin_core.expression import const, sqrt
        >>> sqrt(const(4.0)).value
        2.0
    """
    return make("sqrt", x)


def absolute(x: Expr | Number) -> Expr:
    """Express the magnitude.

    Args:
        x: an expression or number.

    Returns:
        The magnitude.

    Examples:
        >>> from textile_twin_core.expression import absolute, const
        >>> absolute(const(-4.0)).value
        4.0
    """
    return make("abs", x)


def atan2(y: Expr | Number, x: Expr | Number) -> Expr:
    """Express the angle of the direction (x, y), in (-pi, pi]."""
    return make("atan2", y, x)


def at_least(a: Expr | Number, b: Expr | Number) -> Expr:
    """Express 1 where a >= b, else 0."""
    return make("at_least", a, b)


def select(condition: Expr | Number, yes: Expr | Number, no: Expr | Number) -> Expr:
    """Express `yes` where the condition is not 0, else `no`; both are evaluated."""
    return make("select", condition, yes, no)


def _real(number: Any) -> Any:
    return number.real if isinstance(number, complex) else number


def _absolute(functions: Any, a: Any) -> Any:
    return a * (1.0 * (_real(a) >= 0.0) - 1.0 * (_real(a) < 0.0))


def _sign(functions: Any, a: Any) -> Any:
    return 1.0 * (_real(a) > 0.0) - 1.0 * (_real(a) < 0.0) + 0.0 * a  # NaN for NaN


def _select(functions: Any, condition: Any, yes: Any, no: Any) -> Any:
    if hasattr(functions, "where"):
        return functions.where(condition != 0.0, yes, no)
    return yes if condition else no


OPERATIONS.update(
    {
        "add": Operation(lambda f, a, b: a + b, "({} + {})", lambda e, d: d[0] + d[1], simplify.add),
        "sub": Operation(lambda f, a, b: a - b, "({} - {})", lambda e, d: d[0] - d[1], simplify.subtract),
        "mul": Operation(
            lambda f, a, b: a * b, "({} * {})", lambda e, d: d[0] * e.args[1] + e.args[0] * d[1], simplify.multiply
        ),
        "div": Operation(
            lambda f, a, b: a / b, "({} / {})", lambda e, d: (d[0] - e * d[1]) / e.args[1], simplify.divide, cost=8.0
        ),
        "neg": Operation(lambda f, a: -a, "(-{})", lambda e, d: -d[0], simplify.negate),
        "square": Operation(lambda f, a: a * a, "({0} * {0})", lambda e, d: 2.0 * e.args[0] * d[0], lambda a: a * a),
        "sqrt": Operation(
            lambda f, a: f.sqrt(a), "sqrt({})", lambda e, d: 0.5 * d[0] / e, simplify.square_root, cost=12.0
        ),
        "sin": Operation(lambda f, a: f.sin(a), "sin({})", lambda e, d: cos(e.args[0]) * d[0], cost=15.0),
        "cos": Operation(lambda f, a: f.cos(a), "cos({})", lambda e, d: -(sin(e.args[0]) * d[0]), cost=15.0),
        "atan2": Operation(
            lambda f, y, x: f.atan2(y, x),
            "atan2({}, {})",
            lambda e, d: (e.args[1] * d[0] - e.args[0] * d[1]) / (square(e.args[0]) + square(e.args[1])),
            cost=50.0,
        ),
        "abs": Operation(_absolute, "abs({})", lambda e, d: sign(e.args[0]) * d[0]),
        "sign": Operation(_sign, "(1.0 if {0} > 0.0 else -1.0 if {0} < 0.0 else {0})", None, simplify.sign, cost=2.0),
        "at_least": Operation(
            lambda f, a, b: 1.0 * (_real(a) >= _real(b)), "(1.0 if {} >= {} else 0.0)", None, simplify.at_least
        ),
        "select": Operation(
            _select, "({1} if {0} else {2})", lambda e, d: select(e.args[0], d[1], d[2]), simplify.select, cost=2.0
        ),
        "piecewise": Operation(lambda f, place, condition, tree: tree, "{2}", lambda e, d: d[2], lambda *args: args[2]),
    }
)
