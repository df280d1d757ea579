"""Loops over arrays: when they are compiled, and arrays and angles of every kind."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.compile_at_once import compile_at_once
from textile_twin_core.expression import cos, sin, sqrt, variable
from textile_twin_core.expression.loop import Loop

X, Y = variable("x"), variable("y")
N = 20_000


@pytest.fixture(scope="module")
def loop() -> Loop:
    made = Loop([sin(X) * Y + 2.0 * X, cos(3.0 * X) / Y, sqrt(Y)], ["x", "y"])
    compile_at_once(made)
    return made


def expected(x: np.ndarray, y: np.ndarray) -> list[np.ndarray]:
    with np.errstate(all="ignore"):
        return [np.sin(x) * y + 2.0 * x, np.cos(3.0 * x) / y, np.sqrt(y)]


def check(loop: Loop, x: np.ndarray, y: np.ndarray, cores: int = 1) -> None:
    found = [np.empty(x.shape[0]) for _ in range(3)]
    loop([x, y], found, cores)
    for values, exact in zip(found, expected(x, y), strict=True):
        np.testing.assert_allclose(values, exact, rtol=1e-14, atol=4e-15)


def test_long_blocks_are_compiled_and_short_ones_never_wait_for_it() -> None:
    made = Loop([sin(X) * Y, X, Y], ["x", "y"])
    x, y = np.linspace(0.0, 9.0, 1000), np.ones(1000)
    for _ in range(100):
        made([x, y], [np.empty(1000) for _ in range(3)])
    assert not made.is_compiled
    assert made.single() is None
    made([np.zeros(70_000), np.ones(70_000)], [np.empty(70_000) for _ in range(3)])
    assert made.is_compiled
    assert made.single()(0.5, 2.0) == pytest.approx((2.0 * math.sin(0.5), 0.5, 2.0, 0), rel=1e-15)


@pytest.mark.parametrize("n", [0, 1, 7, 8193, N])
def test_every_length(loop: Loop, n: int) -> None:
    check(loop, np.linspace(-9.0, 9.0, n), np.linspace(0.5, 2.0, n))


def test_arrays_that_lie_otherwise(loop: Loop) -> None:
    x = np.linspace(-9.0, 9.0, 2 * N)
    check(loop, x[::2], np.broadcast_to(1.5, N))
    check(loop, x[::-2], np.ones(N))
    shifted = np.frombuffer(b"\0" + x[:N].tobytes(), dtype=np.uint8)[1:].view(np.float64)  # not aligned, read only
    assert not shifted.flags.aligned
    check(loop, shifted, np.ones(N))


@pytest.mark.parametrize("cores", [2, 3])
def test_cores_share_the_samples(loop: Loop, cores: int) -> None:
    x, y = np.linspace(-9.0, 9.0, N + 1), np.linspace(0.5, 2.0, N + 1)
    alone, shared = ([np.empty(N + 1) for _ in range(3)] for _ in range(2))
    loop([x, y], alone)
    loop([x, y], shared, cores)
    assert all(np.array_equal(a, b) for a, b in zip(alone, shared, strict=True))


def test_nan_infinity_and_what_has_no_value_stay_where_they_are(loop: Loop) -> None:
    x, y = np.linspace(0.0, 1.0, 50), np.full(50, 2.0)
    x[7], y[11], y[13], x[17] = math.nan, -1.0, 0.0, math.inf
    check(loop, x, y)
    found = [np.empty(50) for _ in range(3)]
    loop([x, y], found)
    assert np.flatnonzero(np.isnan(found[0])).tolist() == [7, 17]
    assert np.flatnonzero(np.isnan(found[2])).tolist() == [11]
    assert np.isinf(found[1][13])


def test_angles_beyond_the_reduction_use_numpy(loop: Loop) -> None:
    x = np.array([0.3, 2e9, -1e12, 1e300])
    check(loop, x, np.ones(4))


def test_outputs_that_cannot_be_filled_in_place_are_refused(loop: Loop) -> None:
    outputs = np.zeros((4, 2))
    for wrong in (outputs[:, 0], np.zeros(4, dtype=np.float32)):
        with pytest.raises(ValueError, match="contiguous arrays of float64"):
            loop([np.ones(4), np.ones(4)], [wrong, np.zeros(4), np.zeros(4)])
