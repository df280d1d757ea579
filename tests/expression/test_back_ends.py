"""Scalar code, compiled loops and numpy's arrays against extended precision, over random graphs."""

from __future__ import annotations

import cmath
import math
import random
from collections.abc import Iterable
from typing import Any

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings

from tests.compile_at_once import compile_at_once
from tests.expression.random_graphs import OPERATIONS, Carried, Program, X, Y, programs
from textile_twin_core.expression import cos, derivative, interpret, sin, sqrt
from textile_twin_core.expression.loop import Loop, Numpy
from textile_twin_core.expression.scalar import compile_scalar

_ROOM = 30.0
"""Allowed multiple of the bound of rounding, since back ends evaluate in another order."""


def check(made: list[Carried], found: Iterable[Any]) -> None:
    for carried, value in zip(made, found, strict=True):
        assert abs(mp.mpf(float(value)) - carried.value) <= _ROOM * carried.bound + 1e-300, carried


@settings(max_examples=300)
@given(programs())
def test_every_back_end_keeps_to_rounding(program: Program) -> None:
    """The loop as Python, with the sine, cosine and angle that it has when compiled."""
    made = program.run()
    outputs = [c.expression for c in made]
    if outputs:
        check(made, compile_scalar(outputs, ["x", "y"])(program.x, program.y))
        one = Loop(outputs, ["x", "y"]).functions()["one"]
        check(made, one(np.float64(program.x), np.float64(program.y))[:-1])
        arrays = {"x": np.full(3, program.x), "y": np.full(3, program.y)}
        with np.errstate(all="ignore"):
            check(made, [np.broadcast_to(v, 3)[1] for v in interpret(outputs, arrays, Numpy)])
        wide = {name: np.longdouble(value) for name, value in (("x", program.x), ("y", program.y))}
        check(made, interpret(outputs, wide, Numpy))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_compiled_loops_keep_to_rounding(seed: int) -> None:
    """Some fifty expressions in one loop, compiled."""
    rng = random.Random(seed)
    steps = tuple((rng.choice(OPERATIONS), *(rng.randrange(40) for _ in range(3))) for _ in range(90))
    program = Program(steps, rng.uniform(-2.0, 2.0), rng.uniform(-2.0, 2.0))
    made = program.run()
    loop = Loop([c.expression for c in made], ["x", "y"])
    compile_at_once(loop)
    found = np.empty((len(made), 37))
    loop([np.full(37, program.x), np.full(37, program.y)], list(found))
    for i in (0, 8, 36):
        check(made, found[:, i])


def test_derivative_against_complex_step() -> None:
    e = sin(X * Y) * sqrt(1.0 + X * X) / (2.0 + cos(Y)) + X * X * Y - 4.0 / (X + 5.0)
    (slope,) = derivative([e], X)
    step = 1e-30
    (stepped,) = interpret([e], {"x": 0.7 + 1j * step, "y": 1.3}, cmath)
    (found,) = interpret([slope], {"x": 0.7, "y": 1.3}, math)
    assert found == pytest.approx(stepped.imag / step, rel=1e-14)


@settings(max_examples=150)
@given(programs())
def test_derivatives_of_random_graphs_against_differences(program: Program) -> None:
    made = program.run()
    slopes = derivative([c.expression for c in made], X)
    with mp.workdps(40):
        step = mp.mpf(10) ** -15
        beside = {"x": mp.mpf(program.x) + step, "y": mp.mpf(program.y)}
        before = {"x": mp.mpf(program.x) - step, "y": mp.mpf(program.y)}
        expressions = [c.expression for c in made]
        ahead, behind = interpret(expressions, beside, mp), interpret(expressions, before, mp)
        found = interpret(slopes, {"x": mp.mpf(program.x), "y": mp.mpf(program.y)}, mp)
        for value, a, b in zip(found, ahead, behind, strict=True):
            numerical = (a - b) / (2 * step)
            assert abs(value - numerical) <= 1e-9 * (1 + abs(numerical))
