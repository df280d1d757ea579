"""Scores of tracks on a real engine: every second tooth fed, the others predicted; and all teeth fed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.benchmarks.engine_records import EngineRun
from tests.benchmarks.shaft_judge.kinds_score import SKIP, not_positive
from tests.benchmarks.shaft_judge.views import Factory, Track, track

KIND = "engine"


@dataclass(frozen=True)
class Prediction:
    """One run.

    Attributes:
        rms: error of the predicted readings [rad], of those after the skipped part.
        rms_second_half: of those in the second half of the run, when pitch errors are learnt.
        inside: share within one and two sigma of state and reading.
        bad: covariances that are not positive.
    """

    rms: float
    rms_second_half: float
    inside: np.ndarray
    bad: int


def predict(factory: Factory, run: EngineRun, angle_rad: np.ndarray, view: str) -> Prediction:
    """Feed the teeth of even running number, predict the others.

    Causal: by Taylor's series from the last fed tooth. Lag, smooth: by Hermite's quintic between the neighbours. The
    variances of two neighbours are taken as wholly correlated, which smoothed neighbours nearly are.
    """
    made = track(factory, run.time_s[::2], angle_rad[::2], KIND, view)
    keep = made.index < angle_rad[1::2].size - (0 if view == "causal" else 1)
    if view == "causal":
        i = np.flatnonzero(keep)
        held = 2 * made.index[i] + 1
        theta, variance = _taylor(made, i, run.time_s[held] - run.time_s[held - 1])
    else:
        i = np.flatnonzero(keep[:-1] & (np.diff(made.index) == 1))
        held = 2 * made.index[i] + 1
        theta, variance = _hermite(made, i, run.time_s[held - 1], run.time_s[held], run.time_s[held + 1])
    nominal = angle_rad[held]
    truth = nominal if made.pitch is None else nominal + made.pitch(nominal)
    error = theta - truth
    error = error - 2.0 * np.pi * np.round(np.median(error[error.size // 2 :]) / (2.0 * np.pi))
    sigma = np.sqrt(np.maximum(variance, 0.0) + np.nan_to_num(made.reading_variance[i]))
    late = held >= SKIP * angle_rad.size
    half = held >= 0.5 * angle_rad.size
    inside = np.array([np.mean(np.abs(error[late]) <= k * sigma[late]) for k in (1.0, 2.0)])
    return Prediction(
        float(np.sqrt(np.mean(error[late] ** 2))),
        float(np.sqrt(np.mean(error[half] ** 2))),
        inside,
        not_positive(made.covariance),
    )


def leaves(made: Track, run: EngineRun) -> bool:
    """Return whether a full-rate track leaves the shaft once settled: speed off by half, or angle by half a tooth."""
    settled = made.settled & (made.index >= SKIP * run.time_s.size)
    speed = np.gradient(run.angle_rad, run.time_s)[made.index]
    off = made.theta - run.angle_rad[made.index]
    off = off - 2.0 * np.pi * np.round(np.median(off) / (2.0 * np.pi))
    good = (np.abs(made.omega - speed) <= 0.5 * speed) & (np.abs(off) <= np.deg2rad(3.0))
    return bool((settled & ~good).any() or not settled.any())


def _taylor(made: Track, i: np.ndarray, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    gradient = np.stack([np.ones_like(h), h, 0.5 * h * h], axis=1)
    theta = np.einsum("nk,nk->n", gradient, _states(made, i))
    return theta, np.einsum("nj,njk,nk->n", gradient, made.covariance[i], gradient)


def _hermite(
    made: Track, i: np.ndarray, before: np.ndarray, now: np.ndarray, after: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    h = after - before
    x = (now - before) / h
    y = 1.0 - x
    # Weights of theta, omega, alpha on the left; on the right they are mirrored.
    left = np.stack([y**3 * (1 + 3 * x + 6 * x**2), h * x * y**3 * (1 + 3 * x), 0.5 * h**2 * x**2 * y**3], axis=1)
    right = np.stack([x**3 * (1 + 3 * y + 6 * y**2), -h * y * x**3 * (1 + 3 * y), 0.5 * h**2 * y**2 * x**3], axis=1)
    theta = np.einsum("nk,nk->n", left, _states(made, i)) + np.einsum("nk,nk->n", right, _states(made, i + 1))
    parts = [
        np.sqrt(np.maximum(np.einsum("nj,njk,nk->n", weight, made.covariance[j], weight), 0.0))
        for weight, j in ((left, i), (right, i + 1))
    ]
    return theta, (parts[0] + parts[1]) ** 2


def _states(made: Track, i: np.ndarray) -> np.ndarray:
    return np.stack([made.theta[i], made.omega[i], made.alpha[i]], axis=1)
