"""Uncertainties by turns: the definition with matrices of all samples, and the coverage of intervals."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from textile_twin_core.comparison.uncertainty import (
    Uncertainty,
    pseudo_residuals,
    uncertainty_by_turns,
    uncertainty_by_turns_and_angle,
    with_sigma,
)


def by_definition(slopes: np.ndarray, left: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Covariance and degrees of freedom of Bell and McCaffrey 2002, equations (4) and (9), with n by n matrices."""
    n, k = slopes.shape
    normal = np.linalg.inv(slopes.T @ slopes)
    rest = np.eye(n) - slopes @ normal @ slopes.T
    weighed, scores = np.zeros((np.unique(turn).size, n, k)), np.zeros((np.unique(turn).size, k))
    for row, number in enumerate(np.unique(turn)):
        mine = turn == number
        adjust = np.linalg.inv(np.real(scipy.linalg.sqrtm(rest[np.ix_(mine, mine)])))
        scores[row] = left[mine] @ adjust @ slopes[mine] @ normal
        weighed[row] = rest[:, mine] @ adjust @ slopes[mine] @ normal
    degrees = []
    for column in range(k):
        shared = weighed[:, :, column] @ weighed[:, :, column].T
        degrees.append(np.trace(shared) ** 2 / np.sum(shared**2))
    return scores.T @ scores, np.array(degrees)


def few_turns(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of a record in which three turns of a run-up determine most of one parameter, and the turns."""
    turn = np.repeat(np.arange(12), rng.integers(8, 30, 12))
    speed = np.where(turn < 3, 0.3 * (turn + 1.0), 1.2)
    return np.column_stack([np.ones(turn.size), speed, np.sin(np.arange(turn.size))]), turn


def test_it_is_what_its_authors_define() -> None:
    rng = np.random.default_rng(4)
    slopes, turn = few_turns(rng)
    # Samples are correlated within turns, so that the number of turns counts.
    residual = rng.standard_normal(12)[turn] + 0.3 * rng.standard_normal(turn.size)
    covariance, degrees = by_definition(slopes, pseudo_residuals(residual), turn)
    found = uncertainty_by_turns(slopes, residual, turn)
    sigma = np.sqrt(np.diag(found.covariance))
    np.testing.assert_allclose(found.covariance[:2, :2], covariance[:2, :2], rtol=1e-9)
    np.testing.assert_allclose((found.half_width / sigma)[:2], scipy.stats.t.ppf(0.975, degrees)[:2], rtol=1e-9)


def test_instruments_are_slopes_projected_on_them() -> None:
    rng = np.random.default_rng(5)
    slopes, turn = few_turns(rng)
    residual = rng.standard_normal(turn.size)
    instruments = slopes + 0.2 * rng.standard_normal(slopes.shape)
    projected = instruments @ np.linalg.lstsq(instruments, slopes, rcond=None)[0]
    found = uncertainty_by_turns(slopes, residual, turn, instruments)
    same = uncertainty_by_turns(projected, residual, turn)
    np.testing.assert_allclose(found.covariance, same.covariance, rtol=1e-8, atol=1e-14)
    np.testing.assert_allclose(found.half_width, same.half_width, rtol=1e-8)


def test_normal_noise_has_the_known_loss_of_hubers_estimate() -> None:
    rng = np.random.default_rng(6)
    noise = rng.standard_normal(400_000)
    # Huber's estimate is 95 % efficient at 1.345 standard deviations (Huber 1981, section 4.5).
    assert float(np.mean(pseudo_residuals(noise) ** 2)) == pytest.approx(1.0 / 0.95, rel=0.01)


@pytest.mark.parametrize("common", [0.0, 1.0])
def test_intervals_of_few_turns_hold_the_truth(common: float) -> None:
    rng = np.random.default_rng(7)
    inside = np.zeros(3)
    for _ in range(400):
        slopes, turn = few_turns(rng)
        noise = common * rng.standard_normal(12)[turn] + rng.standard_normal(turn.size)
        found = np.linalg.lstsq(slopes, noise, rcond=None)[0]
        half = uncertainty_by_turns(slopes, noise - slopes @ found, turn).half_width
        inside += np.abs(found) < half
    # The first two depend on three turns: there Satterthwaite's quantile is conservative.
    assert np.all(inside[:2] >= 0.94 * 400)
    assert 0.92 * 400 <= inside[2] <= 0.98 * 400


def test_a_parameter_that_one_turn_alone_tells_has_an_interval() -> None:
    rng = np.random.default_rng(8)
    turn = np.repeat(np.arange(10), 20)
    slopes = np.column_stack([np.ones(200), turn == 4]).astype(np.float64)
    found = uncertainty_by_turns(slopes, rng.standard_normal(200), turn)
    assert np.sqrt(found.covariance[1, 1]) == pytest.approx(np.sqrt(1 / 20 + 1 / 180), rel=0.2)
    assert np.all(np.isfinite(found.half_width))


def test_two_turns_that_agree_by_chance_are_no_surer_than_their_samples() -> None:
    rng = np.random.default_rng(11)
    turn = np.repeat([0, 1], 100)
    slopes = np.column_stack([np.ones(200), np.sin(np.arange(200) * 0.0628)])
    for _ in range(200):
        residual = rng.standard_normal(200)
        residual -= slopes @ np.linalg.lstsq(slopes, residual, rcond=None)[0]
        found = uncertainty_by_turns(slopes, residual, turn)
        alone = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)) * np.mean(pseudo_residuals(residual) ** 2))
        assert (np.sqrt(np.diag(found.covariance)) >= (1.0 - 1e-9) * alone).all()
        assert (found.half_width >= 1.95 * alone).all()


def test_what_other_choices_move_an_estimate_by_is_in_its_interval() -> None:
    known = Uncertainty(np.diag([4.0, 9.0]), np.array([5.0, 7.0]), np.array([1.0, 1.0]))
    wider = known.wider([np.array([3.0, 0.0]), np.array([0.0, -4.0])])
    np.testing.assert_allclose(np.sqrt(np.diag(wider.covariance)), [np.sqrt(13.0), 5.0])
    np.testing.assert_allclose(wider.half_width, [np.hypot(5.0, 1.96 * 3.0), np.hypot(7.0, 1.96 * 4.0)], rtol=1e-4)
    assert known.wider([]) is known


@pytest.mark.parametrize(("repeated", "wider"), [(0.0, 1.2), (0.5, 2.0)])
def test_an_error_that_repeats_in_every_turn_is_in_the_interval(repeated: float, wider: float) -> None:
    """40 turns of 48 samples with white noise, and an error of each of 24 sectors, the same in all turns."""
    rng = np.random.default_rng(7)
    turn, place = (each.ravel() for each in np.mgrid[0:40, 0:48])
    theta = 2.0 * np.pi * place / 48.0
    slopes = np.column_stack([np.sin(theta), np.cos(theta), np.ones(theta.size)])
    inside, ratio = [], []
    for _ in range(200):
        error = repeated * rng.standard_normal(24)[place // 2] + rng.standard_normal(theta.size)
        found = np.linalg.lstsq(slopes, error, rcond=None)[0]
        residual = error - slopes @ found
        both = uncertainty_by_turns_and_angle(slopes, residual, turn, place // 2, slopes)
        inside.append(np.abs(found) < both.half_width)
        ratio.append(both.half_width / uncertainty_by_turns(slopes, residual, turn).half_width)
    assert np.mean(inside) > 0.9
    assert (np.median(ratio) > wider) == (repeated > 0.0)


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [(-0.0071, 0.00034, "-0.0071 +- 0.0003"), (0.1459, 0.0061, "0.146 +- 0.006"), (2.0, 0.0, "2.000 +- 0.000")],
)
def test_a_standard_deviation_is_never_rounded_to_zero(value: float, sigma: float, text: str) -> None:
    assert with_sigma(value, sigma) == text
