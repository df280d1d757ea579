"""Guaranteed crossings: roots isolated by Bernstein coefficients against known roots."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from textile_twin_core.contact.polynomials import first_crossing, value


def from_roots(*roots: float, lead: float = 1.0) -> np.ndarray:
    """Return power coefficients, lowest first."""
    return lead * np.polynomial.polynomial.polyfromroots(roots)


@pytest.mark.parametrize("apart", [1e-2, 1e-4, 1e-6])
def test_a_pair_of_roots_closer_than_any_sampling_is_found(apart: float) -> None:
    polynomial = from_roots(0.3, 0.3 + apart)
    found = first_crossing(polynomial, 0.0)
    assert found == pytest.approx(0.3, abs=1e-16 / apart)


def test_a_touch_without_crossing_is_no_event() -> None:
    assert first_crossing(from_roots(0.37, 0.37), 1e-15) == math.inf


def test_a_start_from_zero_upwards_is_no_event_and_the_return_is() -> None:
    assert first_crossing(from_roots(0.0, 0.7, lead=-1.0), 1e-15) == pytest.approx(0.7, abs=1e-15)
    assert first_crossing(from_roots(0.0, 0.0, 0.0, 0.7, lead=-1.0), 1e-15) == pytest.approx(0.7, abs=1e-15)
    assert first_crossing(np.array([1e-17, -1e-17, 0.5, -1.0]), 1e-15) == pytest.approx(0.5, abs=1e-14)


def test_a_start_from_zero_downwards_is_an_event_at_once() -> None:
    assert first_crossing(np.array([1e-17, -1.0, 5.0]), 1e-15) == 0.0
    assert first_crossing(np.array([0.0, 0.0, -1.0, 5.0]), 1e-15) == 0.0


def test_nothing_above_noise_is_no_event() -> None:
    assert first_crossing(np.array([-1e-16, 1e-16, -1e-16]), 1e-15) == math.inf


@settings(max_examples=300)
@given(
    st.lists(st.floats(0.01, 0.99), min_size=1, max_size=7),
    st.lists(st.tuples(st.floats(-2.0, 3.0), st.floats(0.05, 2.0)), max_size=4),
)
def test_first_of_many_roots(roots: list[float], complex_pairs: list[tuple[float, float]]) -> None:
    roots = sorted(roots)
    if any(b - a < 1e-3 for a, b in pairwise(roots)):
        return
    polynomial = from_roots(*roots)
    for real, imaginary in complex_pairs:
        polynomial = np.convolve(polynomial, [real**2 + imaginary**2, -2.0 * real, 1.0])
    if polynomial[0] < 0.0:
        polynomial = -polynomial
    found = first_crossing(polynomial, 0.0)
    assert found <= 1.0
    slope = abs(value(np.arange(1, polynomial.size) * polynomial[1:], roots[0]))
    rounding = 1e-14 * float(np.abs(polynomial).sum())
    assert abs(found - roots[0]) <= rounding / slope + 1e-15


def test_a_hop_of_a_trillionth_of_the_step_is_not_taken_for_a_touch() -> None:
    """The function rises slightly above noise, then falls far: the last bounce on a falling body."""
    hop = np.array([1e-17, 1.8e-15, -1.05e-3, 1.6e-4, 8.3e-6])
    found = first_crossing(hop, 1.5e-15)
    assert found == pytest.approx(1.8e-15 / 1.05e-3, rel=1e-6)
