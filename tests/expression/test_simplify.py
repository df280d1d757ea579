"""The algebraic rules against values carried with random expressions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import mpmath as mp
import pytest
from hypothesis import Phase, given, settings

from tests.expression.random_graphs import DIGITS, Carried, Program, X, Y, programs
from textile_twin_core.expression import (
    Expr,
    absolute,
    at_least,
    const,
    interpret,
    sign,
    sin,
    sqrt,
    substitute,
    topological_order,
)
from textile_twin_core.expression.graph import OPERATIONS, node


def excess(program: Program, made: list[Carried]) -> float:
    """Compute the largest deviation of an expression's value from the carried one, over the bound of rounding."""
    with mp.workdps(DIGITS):
        inputs = {"x": mp.mpf(program.x), "y": mp.mpf(program.y)}
        found = interpret([c.expression for c in made], inputs, mp)
        return max((float(abs(f - c.value) / (c.bound + 1e-30)) for f, c in zip(found, made, strict=True)), default=0.0)


@pytest.mark.slow
@settings(max_examples=400)
@given(programs())
def test_simplified_expressions_keep_their_value(program: Program) -> None:
    assert excess(program, program.run()) < 20.0


WRONG: dict[str, tuple[str, Callable[..., Expr]]] = {
    "a - b for a + b": ("add", lambda a, b: node("sub", (a, b))),
    "b - a for a - b": ("sub", lambda a, b: node("sub", (b, a))),
    "a a for a b": ("mul", lambda a, b: node("square", (a,))),
    "b / a for a / b": ("div", lambda a, b: node("div", (b, a))),
    "a for -a": ("neg", lambda a: a),
    "sign a without the sign of its factor": ("sign", lambda a: node("sign", (a.args[-1] if a.args else a,))),
    "a >= b scaled by any factor": (
        "at_least",
        lambda a, b: (
            node("at_least", (a.args[1], const(b.value / a.args[0].value)))
            if a.op == "mul" and a.args[0].is_constant and b.is_constant
            else node("at_least", (a, b))
        ),
    ),
    "the root of the rest without that of the factor": (
        "sqrt",
        lambda a: node("sqrt", (a.args[1],)) if a.op == "mul" and a.args[0].is_constant else node("sqrt", (a,)),
    ),
    "no for yes": ("select", lambda c, yes, no: no),
}


_QUICK = settings(database=None, derandomize=True, phases=[Phase.generate], report_multiple_bugs=False)


@pytest.mark.parametrize("wrong", WRONG, ids=list(WRONG))
def test_a_wrong_rule_is_seen(wrong: str, monkeypatch: pytest.MonkeyPatch) -> None:
    op, rule = WRONG[wrong]
    monkeypatch.setitem(OPERATIONS, op, replace(OPERATIONS[op], rule=rule))

    @settings(_QUICK, max_examples=1500)
    @given(programs())
    def check(program: Program) -> None:
        assert excess(program, program.run()) < 20.0

    with pytest.raises((AssertionError, ZeroDivisionError)):
        check()


def test_equal_expressions_are_one_node() -> None:
    assert (X + Y) * 2.0 is 2.0 * (Y + X)
    assert X - X is const(0.0)
    assert X + X is 2.0 * X
    assert 3.0 - (1.0 - X) is X + 2.0


@pytest.mark.parametrize(
    ("expression", "operations"),
    [
        (2.0 * X - X * Y, 3),
        (3.0 * X + 3.0 * Y, 2),
        (2.0 * X - 2.0 * Y + 0.0, 2),
        (-(X - Y), 1),
        ((2.0 * X) * (0.5 * Y), 1),
        ((2.0 * X) / (4.0 * Y), 2),
        (X / 4.0, 1),
        (at_least(2.0 * X + 1.0, 2.2), 1),
        (sqrt(-3.0 * ((X - 2.0) * Y)), 4),
        (sin(0.0 * X), 0),
    ],
)
def test_constants_gather(expression: Expr, operations: int) -> None:
    assert sum(bool(e.args) for e in topological_order([expression])) == operations


@pytest.mark.parametrize("x", [-1.5, 0.0, 2.0, 1e-200])
@pytest.mark.parametrize("y", [-3.0, 0.0, 0.5, 1e-200])
def test_friction_on_what_moves_is_its_size_times_the_sign_of_the_rest(x: float, y: float) -> None:
    """x z sign(x y) = |x| z sign(y): the sign of x is not evaluated, so that a tiny product keeps its sign."""
    e = X * (3.0 * sign(X * Y))
    assert e is 3.0 * (absolute(X) * sign(Y))
    expected = 3.0 * abs(x) * (0.0 if y == 0.0 else math.copysign(1.0, y))
    assert interpret([e], {"x": x, "y": y}, math)[0] == pytest.approx(expected, rel=1e-15)


def test_substitution_folds_what_becomes_constant() -> None:
    (e,) = substitute([X * Y + sin(Y)], {Y: const(0.0)})
    assert e is const(0.0)
