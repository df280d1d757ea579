"""Piecewise polynomials by every back end, against numpy's polynomials piece by piece."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.compile_at_once import compile_at_once
from textile_twin_core.expression import Expr, at_least, derivative, interpret, piecewise, sin, variable
from textile_twin_core.expression.c_source import c_statements
from textile_twin_core.expression.loop import Loop, Numpy
from textile_twin_core.expression.piecewise_polynomial import Row
from textile_twin_core.expression.real import Symbolic
from textile_twin_core.expression.scalar import compile_scalar

X, Y = variable("x"), variable("y")
EDGES = (-0.7, -0.2, 0.1, 0.1, 0.9)
UP: tuple[Row, ...] = (
    (0.0, 0.0),
    (-0.7, 1.0, 2.0),
    (-0.2, 2.0, -1.0, 0.5),
    (0.1, 9.0),
    (0.1, 1.5, 0.3, -0.2, 4.0),
    (0.0, 0.0),
)
DOWN: tuple[Row, ...] = ((0.0, 0.0), (-0.7, 1.0, 2.0), (-0.2, -1.0), (0.1, 9.0), (0.1, 0.5, -1.0), (0.0, 0.0))


def truth(place: np.ndarray, rises: np.ndarray) -> np.ndarray:
    found = np.zeros(place.shape)
    for rows, way in ((UP, rises), (DOWN, ~rises)):
        for k, (origin, *coefficients) in enumerate(rows):
            low, high = ((-math.inf, *EDGES)[k], (*EDGES, math.inf)[k])
            at = way & (low <= place) & (place < high)
            found[at] = np.polynomial.polynomial.polyval(place[at] - origin, coefficients)
    found[np.isnan(place)] = math.nan
    return found


def law(place: Expr) -> Expr:
    return piecewise(place, at_least(Y, 0.0), EDGES, UP, DOWN)


@pytest.fixture(scope="module")
def loop() -> Loop:
    made = Loop([2.0 * law(sin(X)) * Y + X, sin(X) * Y, law(sin(X)) - law(X)], ["x", "y"])
    compile_at_once(made)
    return made


@pytest.mark.parametrize("n", [1, 15, 1025, 2000])
@pytest.mark.parametrize("order", ["slowly", "at random"])
def test_a_compiled_loop_finds_every_piece(loop: Loop, n: int, order: str) -> None:
    x = np.linspace(-3.0, 9.0, n) if order == "slowly" else np.random.default_rng(1).uniform(-2.0, 2.0, n)
    x[n // 2] = math.nan
    y = np.cos(3.0 * np.arange(n) / n + 0.1)
    found = [np.empty(n) for _ in range(3)]
    loop([x, y], found)
    expected = [
        2.0 * truth(np.sin(x), y >= 0.0) * y + x,
        np.sin(x) * y,
        truth(np.sin(x), y >= 0.0) - truth(x, y >= 0.0),
    ]
    for values, exact in zip(found, expected, strict=True):
        np.testing.assert_allclose(values, exact, rtol=1e-14, atol=1e-13)
    one = loop.single()
    for k in range(0, n, max(n // 20, 1)):
        np.testing.assert_allclose(one(x[k], y[k])[:3], [each[k] for each in expected], rtol=1e-14, atol=1e-13)


def test_single_samples_and_arrays_agree_at_the_edges_too() -> None:
    x = np.unique([*np.linspace(-1.0, 1.2, 23), *EDGES, *np.nextafter(EDGES, -1.0)])
    single = compile_scalar([law(X)], ["x", "y"])
    for y in (1.0, -1.0):
        exact = truth(x, np.full(x.shape, y >= 0.0))
        (block,) = interpret([law(X)], {"x": x, "y": y}, Numpy)
        np.testing.assert_allclose(block, exact, rtol=1e-15, atol=1e-15)
        np.testing.assert_allclose([single(each, y)[0] for each in x.tolist()], exact, rtol=1e-15, atol=1e-15)
    assert math.isnan(single(math.nan, 1.0)[0])


def test_slopes_are_those_of_the_pieces() -> None:
    x, step = np.array([-0.65, -0.1, 0.4, 0.8, 1.5]), 1e-7
    (slope,) = interpret(derivative([law(X)], X), {"x": x, "y": 1.0}, Numpy)
    differences = (truth(x + step, x < 9.0) - truth(x - step, x < 9.0)) / (2.0 * step)
    np.testing.assert_allclose(slope, differences, rtol=1e-7, atol=1e-7)


def test_what_cannot_be_searched_stays_a_tree_of_choices() -> None:
    symbol = Symbolic.parameter("force", 2.0)
    with_parameter = piecewise(X, at_least(Y, 0.0), (0.0,), ((0.0, 0.0), (0.0, symbol)), ((0.0, 0.0), (0.0, 1.0)))
    over_another = piecewise(law(X), at_least(Y, 0.0), EDGES, UP, DOWN)
    assert [with_parameter.op, over_another.op, law(X).op] == ["select", "select", "piecewise"]
    assert piecewise(X, at_least(Y, 0.0), (0.0, 1.0), ((5.0, 3.0),) * 3, ((2.0, 3.0),) * 3).value == 3.0
    assert "?" in " ".join(c_statements([law(X)])[0])
