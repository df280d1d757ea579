"""The expression graph and its back ends against each other, mpmath and numerical differences."""

from __future__ import annotations

import cmath
import math

import mpmath as mp
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from textile_twin_core.expression import (
    Expr,
    absolute,
    at_least,
    atan2,
    const,
    cos,
    derivative,
    interpret,
    select,
    sign,
    sin,
    sqrt,
    substitute,
    topological_order,
    variable,
)
from textile_twin_core.expression.angle_grid import AngleGrid
from textile_twin_core.expression.blocks import BlockProgram
from textile_twin_core.expression.scalar import compile_scalar
from textile_twin_core.expression.sincos import sincos

X, Y = variable("x"), variable("y")


def decimals(size: float) -> st.SearchStrategy[float]:
    """Numbers of a machine's size: three decimals."""
    return st.floats(-size, size).map(lambda value: round(value, 3))


def expressions() -> st.SearchStrategy[Expr]:
    leaves = st.one_of(st.just(X), st.just(Y), decimals(3.0).map(const))
    return st.recursive(
        leaves,
        lambda inner: st.one_of(
            st.tuples(inner, inner).map(lambda p: p[0] + p[1]),
            st.tuples(inner, inner).map(lambda p: p[0] - p[1]),
            st.tuples(inner, inner).map(lambda p: p[0] * p[1]),
            st.tuples(inner, inner).map(lambda p: p[0] / (2.0 + p[1] * p[1])),
            inner.map(sin),
            inner.map(cos),
            inner.map(lambda e: sqrt(1.0 + e * e)),
            inner.map(absolute),
            st.tuples(inner, inner).map(lambda p: select(at_least(p[0], 0.5), p[1], p[0])),
            st.tuples(inner, inner).map(lambda p: sign(p[0]) * p[1]),
            st.tuples(inner, inner).map(lambda p: at_least(p[0], 0.3) * p[1]),
            st.tuples(inner, decimals(2.0)).map(lambda p: p[1] * p[0] - Y),
            inner.map(lambda e: sin(0.5 * e)),
        ),
        max_leaves=25,
    )


@settings(max_examples=150, deadline=None)
@given(expressions(), decimals(2.0), decimals(2.0))
def test_all_back_ends_agree(expression: Expr, x: float, y: float) -> None:
    (plain,) = interpret([expression], {"x": x, "y": y}, math)
    (scalar,) = compile_scalar([expression], ["x", "y"])(x, y)
    out = np.empty(3)
    BlockProgram([expression], ["x", "y"])([np.full(3, x), np.full(3, y)], [out])
    scale = 1e-12 * max(1.0, abs(plain))
    assert scalar == pytest.approx(plain, abs=scale)
    assert out[1] == pytest.approx(plain, abs=scale) or abs(plain) > 1e8


@settings(max_examples=100, deadline=None)
@given(
    st.lists(expressions(), min_size=2, max_size=4),
    st.lists(decimals(3.0), min_size=4, max_size=4),
    st.booleans(),
    decimals(2.0),
    decimals(2.0),
)
def test_sums_of_multiples_leave_alone_what_is_needed_again(
    parts: list[Expr], weights: list[float], arranged: bool, x: float, y: float
) -> None:
    """y + c x goes onto y, unless y is an output, an input or wanted later; without leaps, which rounding may shift."""
    assume(all(node.op not in ("sign", "at_least") for node in topological_order(parts)))
    outputs = list(parts)
    for part, weight in zip(parts[1:], weights, strict=False):
        outputs += [outputs[-1] + weight * part, part - weight * outputs[0]]
    plain = interpret(outputs, {"x": x, "y": y}, math)
    largest = max(1.0, *(abs(value) for value in interpret(topological_order(outputs), {"x": x, "y": y}, math)))
    found = np.empty((len(outputs), 5))
    BlockProgram(outputs, ["x", "y"], arranged=arranged)([np.full(5, x), np.broadcast_to(y, 5)], list(found))
    for value, expected in zip(found, plain, strict=True):
        assert value == pytest.approx(expected, rel=1e-11, abs=1e-11 * largest)


@settings(max_examples=100, deadline=None)
@given(st.lists(expressions(), min_size=1, max_size=3), st.booleans(), st.booleans(), st.booleans())
def test_switches_act_on_each_sample(parts: list[Expr], forwards: bool, again: bool, arranged: bool) -> None:
    """sign(x) and x >= c times y, onto y or a copy; wanted again or not."""
    assume(all(node.op not in ("sign", "at_least") for node in topological_order(parts)))
    x = np.array([2.0, 0.5, 1.25, 3.0]) if forwards else np.array([-1.0, 0.0, 0.5, 2.0])
    outputs = [sign(X) * (part * at_least(X, 0.5)) + part * sign(X - 1.0) for part in parts]
    outputs += [at_least(X, 0.5) * outputs[-1], sign(X) + Y] if again else []
    found = np.empty((len(outputs), 4))
    BlockProgram(outputs, ["x", "y"], arranged=arranged)([x, np.full(4, 1.5)], list(found))
    for k, value in enumerate(x):
        inputs = {"x": float(value), "y": 1.5}
        largest = max(1.0, *(abs(float(e)) for e in interpret(topological_order(outputs), inputs, math)))
        for array, expected in zip(found, interpret(outputs, inputs, math), strict=True):
            assert array[k] == pytest.approx(expected, rel=1e-11, abs=1e-11 * largest)


def test_outputs_that_cannot_be_filled_in_place_are_refused() -> None:
    inputs, outputs = [np.ones(4), np.ones(4)], np.zeros((4, 2))
    program = BlockProgram([Y * Y + 2.0 * X], ["x", "y"])
    for wrong in (outputs[:, 0], np.zeros(4, dtype=np.float32)):
        with pytest.raises(ValueError, match="contiguous arrays of float64"):
            program(inputs, [wrong])


@pytest.mark.parametrize("exponent", [-600, -300, -11, -10, 10, 11, 300])
def test_sines_of_any_multiple_of_a_power_of_two(exponent: int) -> None:
    x, out = np.linspace(-2.0, 2.0, 9) * 2.0**-exponent, np.empty(9)
    BlockProgram([sin(2.0**exponent * X)], ["x"])([x], [out])
    np.testing.assert_allclose(out, np.sin(np.linspace(-2.0, 2.0, 9)), atol=2.3e-16)


@pytest.mark.parametrize(("x", "y"), [(0.3, 0.2), (0.9, -0.4)])
def test_no_constant_is_left_under_a_root_or_in_a_comparison(x: float, y: float) -> None:
    """Whatever the sign of the factor; at_least may be scaled by a positive one alone."""
    cases = {
        sqrt(-3.0 * ((X - 2.0) * (X + 2.0))): math.sqrt(3.0 * (2.0 - x) * (x + 2.0)),
        sqrt(-0.5 * (Y - 4.0 + X)): math.sqrt(0.5 * (4.0 - x - y)),
        sqrt(7.0 * (X + 1.0)): math.sqrt(7.0 * (x + 1.0)),
        2.0 * X - Y: 2.0 * x - y,
        (3.0 * X - Y) * (0.5 * Y - X): (3.0 * x - y) * (0.5 * y - x),
        at_least(2.0 * X + 1.0, 2.2): float(2.0 * x + 1.0 >= 2.2),
        at_least(-2.0 * X, -1.0): float(-2.0 * x >= -1.0),
    }
    for expression, expected in cases.items():
        assert interpret([expression], {"x": x, "y": y}, math)[0] == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    ("expression", "operations"),
    [
        (X * Y + 2.0 * X, 2),
        (2.0 * X - X * Y, 3),  # -(X Y - 2 X): the product, the multiple onto it, the sign
        (sin(0.5 * X) * Y, 2),
        (sign(X) * (X + Y), 2),
        (at_least(X, 0.5) * (X + Y), 2),
    ],
)
def test_multiples_switches_and_half_angles_need_no_operation_of_their_own(expression: Expr, operations: int) -> None:
    kept = [expression * (1.0 + Y)]  # so that it is not an output itself, which is not written onto
    assert BlockProgram(kept, ["x", "y"], arranged=True).operations == operations + 2


def test_an_arranged_program_needs_no_more_buffers() -> None:
    """Neither where the order of definition is good, nor where it keeps all waiting."""
    products = [sin(float(k) * X) * cos(float(k) * Y) for k in range(3, 23)]
    total = products[-1]
    for product in reversed(products[:-1]):
        total = total + product
    waiting = [(X + float(k)) * Y for k in range(1, 30)]
    inward = waiting[0]
    for product in waiting[1:]:
        inward = inward * product
    for outputs in ([total * total + Y], [sum(waiting, const(0.0)) * inward]):
        defined, arranged = (BlockProgram(outputs, ["x", "y"], arranged=a).buffer_count for a in (False, True))
        assert arranged <= defined


def test_equal_expressions_are_one_node() -> None:
    assert (X + Y) * 2.0 is 2.0 * (Y + X)
    assert X - X is const(0.0)
    assert X + X is 2.0 * X
    assert 3.0 - (1.0 - X) is X + 2.0


def test_derivative_against_complex_step() -> None:
    e = sin(X * Y) * sqrt(1.0 + X * X) / (2.0 + cos(Y)) + X * X * Y - 4.0 / (X + 5.0)
    (slope,) = derivative([e], X)
    step = 1e-30
    (stepped,) = interpret([e], {"x": 0.7 + 1j * step, "y": 1.3}, cmath)
    (found,) = interpret([slope], {"x": 0.7, "y": 1.3}, math)
    assert found == pytest.approx(stepped.imag / step, rel=1e-14)


@pytest.mark.parametrize("x", [-1.5, 0.0, 2.0, 1e-200])
@pytest.mark.parametrize("y", [-3.0, 0.0, 0.5, 1e-200])
def test_friction_on_what_moves_is_its_size_times_the_sign_of_the_rest(x: float, y: float) -> None:
    """x z sign(x y) = |x| z sign(y): the sign of x is not evaluated, so that a tiny product does not lose it either."""
    e = X * (3.0 * sign(X * Y))
    assert e is 3.0 * (absolute(X) * sign(Y))
    expected = 3.0 * abs(x) * np.sign(y)
    assert compile_scalar([e], ["x", "y"])(x, y)[0] == pytest.approx(expected, rel=1e-15)
    out = np.empty(2)
    BlockProgram([e], ["x", "y"])([np.full(2, x), np.full(2, y)], [out])
    assert out[1] == pytest.approx(expected, rel=1e-15)


def test_substitution_folds_what_becomes_constant() -> None:
    (e,) = substitute([X * Y + sin(Y)], {Y: const(0.0)})
    assert e is const(0.0)


def test_angles_of_directions() -> None:
    assert compile_scalar([atan2(X, Y)], ["x", "y"])(1.0, -1.0)[0] == math.atan2(1.0, -1.0)


@pytest.mark.parametrize("factor", [1.0, 0.5, 0.25, 2.0])
@pytest.mark.parametrize("size", [1e-8, 1.0, 1e4, 4e4, 1e9])
def test_sine_and_cosine_to_the_last_place(size: float, factor: float) -> None:
    x = np.random.default_rng(2).uniform(-size, size, 300) / factor
    s, c = np.empty_like(x), np.empty_like(x)
    sincos(x, s, c, [np.empty_like(x) for _ in range(4)], factor)
    with mp.workdps(40):
        for i, angle in enumerate(factor * x):
            assert abs(mp.mpf(float(s[i])) - mp.sin(mp.mpf(float(angle)))) < 2.3e-16
            assert abs(mp.mpf(float(c[i])) - mp.cos(mp.mpf(float(angle)))) < 2.3e-16


@pytest.mark.parametrize("turns", [1.0, 2.0])
@pytest.mark.parametrize("nodes", [32, 1024, 2048])
@pytest.mark.parametrize("size", [10.0, 1e3, 2e6, 1e9])
def test_reduction_keeps_the_rest_of_a_billion_radians(nodes: int, turns: float, size: float) -> None:
    grid = AngleGrid(nodes, turns)
    theta = np.random.default_rng(4).uniform(-size, size, 300) * turns
    index, rest = np.empty(300, dtype=np.int64), np.empty(300)
    assert grid.reduce(theta, index, rest, np.empty(300))
    with mp.workdps(50):
        step = 2 * turns * mp.pi / nodes
        for t, k, r in zip(theta, index, rest, strict=True):
            around = (mp.mpf(float(t)) - mp.mpf(float(r)) - int(k) * step) / (2 * turns * mp.pi)
            assert abs(around - mp.nint(around)) * 2 * turns * mp.pi < turns * 1e-15


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -1.1e9])
def test_an_angle_too_large_to_reduce_is_told(wrong: float) -> None:
    theta = np.array([0.0, wrong, 1.0])
    assert not AngleGrid(2048).reduce(theta, np.empty(3, dtype=np.int64), np.empty(3), np.empty(3))
