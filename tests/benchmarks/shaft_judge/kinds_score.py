"""Scores of tracks on records with known truth, relative to the textbook tuned on the clean record of the same seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.benchmarks.shaft_judge.views import Factory, Track, track, tuned
from tests.shaft.kinds import Record, make

SKIP = 0.15  # of each record: the estimators learn there


@dataclass(frozen=True)
class Score:
    """One record, one view; pairs are of (omega, alpha).

    Attributes:
        rms: RMS errors.
        book: those of the textbook on the record without outliers.
        inside: share of states whose truth lies within one sigma, and within two, and within one of the textbook's
            (without outliers): (3, 2).
        diverged: a settled speed was off by more than half of itself (or of 0.3 of the record's top speed).
        bad: states with a negative or not finite variance, or a covariance that is not positive semidefinite.
        missing: share of the readings after the skipped part that got no state.
    """

    rms: np.ndarray
    book: np.ndarray
    inside: np.ndarray
    diverged: bool
    bad: int
    missing: float


def score(factory: Factory, kind: str, seed: int, view: str) -> Score:
    """Make the record, estimate, compare."""
    record = make(kind, seed)
    clean = make(kind.partition("+")[0], seed)
    book = tuned(clean.time_s, clean.angle_rad, kind, "causal" if view == "causal" else "smooth")
    made = track(factory, record.time_s, record.fed_rad, kind, view)
    late, errors = _errors(made, record)
    late_in_book, reference = _errors(book, clean)
    sigma, book_sigma = _sigma(made)[late], _sigma(book)[late_in_book]
    shares = [np.abs(errors) <= sigma, np.abs(errors) <= 2.0 * sigma, np.abs(reference) <= book_sigma]
    inside = np.stack([np.mean(share, axis=0) for share in shares])
    wanted = int(record.time_s.size * (1.0 - SKIP))
    return Score(
        _rms(errors),
        _rms(reference),
        inside,
        diverged(made, record),
        not_positive(made.covariance),
        1.0 - min(late.sum() / wanted, 1.0),
    )


def diverged(made: Track, record: Record) -> bool:
    """Return whether a settled speed is off by more than half of itself (or of 0.3 of the record's top speed)."""
    late, errors = _errors(made, record)
    least = np.maximum(np.abs(record.omega[made.index[late]]), 0.3 * np.abs(record.omega).max())
    return bool((made.settled[late] & ~(np.abs(errors[:, 0]) <= 0.5 * least)).any())


def not_positive(covariance: np.ndarray) -> int:
    """Number of covariances that are not positive semidefinite, to rounding, or not finite."""
    diagonal = np.diagonal(covariance, axis1=1, axis2=2)
    fit = np.isfinite(covariance).all(axis=(1, 2)) & (diagonal >= 0.0).all(axis=1)
    scale = np.sqrt(np.where(fit[:, None] & (diagonal > 0.0), diagonal, 1.0))
    normed = np.where(fit[:, None, None], covariance, np.eye(3)) / (scale[:, :, None] * scale[:, None, :])
    return int((~fit | (np.linalg.eigvalsh(normed)[:, 0] < -1e-9)).sum())


def _errors(made: Track, record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Mask of the states that count, and their errors of (omega, alpha)."""
    late = made.index >= SKIP * record.time_s.size
    i = made.index[late]
    return late, np.stack([made.omega[late] - record.omega[i], made.alpha[late] - record.alpha[i]], axis=1)


def _sigma(made: Track) -> np.ndarray:
    """Standard deviations of (omega, alpha); NaN where the variance is negative."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(np.diagonal(made.covariance, axis1=1, axis2=2)[:, 1:]))


def _rms(errors: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.mean(errors**2, axis=0))) if len(errors) else np.full(2, np.nan)


HEADER = (
    f"{'kind':15} {'view':7} {'omega':>6} {'worst':>6} {'alpha':>6} {'worst':>6}   "
    f"{'1s om':>5} {'1s al':>5} {'2s om':>5} {'2s al':>5}  {'book 1s':>9}  diverged  bad cov  missing"
)


def row(kind: str, view: str, scores: list[Score]) -> str:
    """A line of the table: ratios to the textbook (median and worst of the seeds), shares inside (medians)."""
    ratio = np.array([one.rms / one.book for one in scores])
    inside = np.median([one.inside for one in scores], axis=0)
    middle, worst = np.median(ratio, axis=0), ratio.max(axis=0)
    return (
        f"{kind:15} {view:7} {middle[0]:6.2f} {worst[0]:6.2f} {middle[1]:6.2f} {worst[1]:6.2f}   "
        f"{inside[0, 0]:5.2f} {inside[0, 1]:5.2f} {inside[1, 0]:5.2f} {inside[1, 1]:5.2f}  "
        f"{inside[2, 0]:4.2f} {inside[2, 1]:4.2f}  "
        f"{sum(one.diverged for one in scores):3d}/{len(scores):<3d}   "
        f"{sum(one.bad for one in scores):6d}  {max(one.missing for one in scores):6.2f}"
    )
