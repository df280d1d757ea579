"""The Pareto search on problems whose front is known (Zitzler, Deb and Thiele 2000; Deb et al. 2001)."""

from __future__ import annotations

from itertools import islice

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.synthesis.pareto import Evaluate, Population, generations


def run(
    evaluate: Evaluate, low: FloatArray, high: FloatArray, count: int, seed: int = 1, size: int = 100
) -> Population:
    random = np.random.default_rng(seed)
    start = random.uniform(low, high, (size, low.size))
    *_, last = islice(generations(start, low, high, evaluate, random), count)
    assert (last.designs >= low).all() and (last.designs <= high).all() and last.designs.shape == start.shape
    return last.front


def zdt1(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    g = 1.0 + 9.0 * x[:, 1:].mean(axis=1)
    return np.column_stack([x[:, 0], g * (1.0 - np.sqrt(x[:, 0] / g))]), np.zeros(x.shape[0])


def test_convex_front_is_reached_and_spread() -> None:
    front = run(zdt1, np.zeros(8), np.ones(8), 300)
    f1, f2 = front.goals.T
    assert np.abs(f2 - (1.0 - np.sqrt(f1))).max() < 1e-2
    assert front.lacks.size > 90 and f1.min() < 1e-3 and f1.max() > 1.0 - 1e-3
    assert np.diff(np.sort(f1)).max() < 0.05


def test_limits_hold() -> None:
    """Deb's constrained problem: f1 = x, f2 = (1 + y)/x with y + 9 x >= 6 and -y + 9 x >= 1; f2 >= 7/x - 9 there."""

    def evaluate(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        goals = np.column_stack([x[:, 0], (1.0 + x[:, 1]) / x[:, 0]])
        lacks = np.maximum(0.0, 6.0 - x[:, 1] - 9.0 * x[:, 0]) + np.maximum(0.0, 1.0 + x[:, 1] - 9.0 * x[:, 0])
        return goals, lacks

    front = run(evaluate, np.array([0.1, 0.0]), np.array([1.0, 5.0]), 150)
    x, f2 = front.goals.T
    expected = np.where(x < 2.0 / 3.0, 7.0 / x - 9.0, 1.0 / x)
    assert np.abs(f2 - expected).max() < 0.02 * expected.max()
    assert x.min() < 7.0 / 18.0 + 5e-3  # where both limits meet


def test_one_goal_is_a_minimum() -> None:
    def sphere(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.sum((x - 0.3) ** 2, axis=1)[:, None], np.zeros(x.shape[0])

    front = run(sphere, -np.ones(5), np.ones(5), 200)
    assert front.goals.min() < 1e-9


def test_same_seed_gives_the_same_front() -> None:
    first, again, other = (run(zdt1, np.zeros(4), np.ones(4), 10, seed) for seed in (4, 4, 5))
    assert np.array_equal(first.designs, again.designs) and not np.array_equal(first.designs, other.designs)


def test_nothing_fits() -> None:
    front = run(lambda x: (x, np.ones(x.shape[0])), np.zeros(2), np.ones(2), 5)
    assert front.lacks.size == 0
