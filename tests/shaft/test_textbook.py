"""The yardstick is the textbook's: exact posterior, and noises found from records that its own model made."""

from __future__ import annotations

import numpy as np
import pytest

from tests.shaft.textbook import textbook


def white_jerk(seed: int, n: int, jerk: float, reading: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps, readings and states of the model itself, at uneven stamps."""
    rng = np.random.default_rng(seed)
    h = 0.01 * rng.uniform(0.5, 1.5, n)
    states, x = np.empty((n, 3)), np.array([0.3, 5.0, 0.0])
    for i in range(n):
        states[i] = x
        f, q = model(h[i], jerk)
        x = f @ x + np.linalg.cholesky(q) @ rng.normal(size=3)
    return np.cumsum(h) - h, states[:, 0] + rng.normal(0.0, np.sqrt(reading), n), states


def model(h: float, jerk: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition and its noise (Bar-Shalom, Li, Kirubarajan 2001, equations 6.2.3-7 and 6.2.3-9)."""
    f = np.array([[1.0, h, h**2 / 2], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
    q = jerk * np.array([[h**5 / 20, h**4 / 8, h**3 / 6], [h**4 / 8, h**3 / 3, h**2 / 2], [h**3 / 6, h**2 / 2, h]])
    return f, q


def test_noises_are_found_and_sigmas_hold() -> None:
    inside = []
    for seed in range(6):
        time, angle, states = white_jerk(seed, 2000, 4e4, 1e-6)
        book = textbook(time, angle)
        assert book.jerk == pytest.approx(4e4, rel=0.35)
        assert book.reading_variance == pytest.approx(1e-6, rel=0.2)
        for made, covariance in ((book.causal, book.causal_covariance), (book.smooth, book.smooth_covariance)):
            sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
            inside.append(np.mean(np.abs(made - states)[50:] < sigma[50:], axis=0))
    assert np.allclose(np.mean(inside, axis=0), 0.683, atol=0.05)


def test_the_smoother_is_the_posterior_of_all_readings() -> None:
    """Least squares over all states at once: readings and transitions, each weighed by its noise."""
    time, angle, _ = white_jerk(1, 60, 4e4, 1e-6)
    book = textbook(time, angle)
    n, unit = time.size, float(np.median(np.diff(time)))
    scale = np.array([1.0, 1.0 / unit, 1.0 / unit**2])  # states in samples: the numbers stay near one
    rows, values = [], []
    for i in range(n):
        row = np.zeros(3 * n)
        row[3 * i] = 1.0 / np.sqrt(book.reading_variance)
        rows.append(row)
        values.append((angle[i] - angle[0]) / np.sqrt(book.reading_variance))
    for i in range(n - 1):
        f, q = model(time[i + 1] - time[i], book.jerk)
        root = np.linalg.inv(np.linalg.cholesky(q))
        block = np.zeros((3, 3 * n))
        block[:, 3 * i + 3 : 3 * i + 6], block[:, 3 * i : 3 * i + 3] = root * scale, -(root @ f) * scale
        rows.extend(block)
        values.extend(np.zeros(3))
    answer, *_ = np.linalg.lstsq(np.array(rows), np.array(values), rcond=None)
    states = answer.reshape(n, 3) * scale + [angle[0], 0.0, 0.0]
    spread = np.linalg.inv(np.array(rows).T @ np.array(rows)).reshape(n, 3, n, 3)
    sigma = np.sqrt(np.array([np.diag(spread[i, :, i]) for i in range(n)])) * scale
    assert np.abs((book.smooth - states) / sigma).max() < 1e-2  # the filter's first variance is wide, not infinite
    assert np.allclose(np.sqrt(np.diagonal(book.smooth_covariance, axis1=1, axis2=2)), sigma, rtol=1e-2)
    assert np.allclose(book.smooth[-1], book.causal[-1])
