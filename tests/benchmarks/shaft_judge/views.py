"""Judged estimators: each makes tracks from readings; the package's, the textbook's or a prototype."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.benchmarks.engine_records import TEETH, EngineRun
from tests.shaft.textbook import textbook
from textile_twin_core.shaft import ShaftStates, create_estimator

VIEWS = ("causal", "lag", "smooth")


@dataclass(frozen=True)
class Track:
    """States that an estimator gave.

    Attributes:
        index: (n,) running number of the reading that a state speaks of.
        theta, omega, alpha: (n,); whole turns do not matter.
        covariance: (n, 3, 3).
        settled: (n,) where the estimator says that it has found its feet.
        reading_variance: (n,) what the estimator holds of a reading's error [rad^2]; NaN where it does not tell.
        pitch: nominal angles to the pitch errors that the estimator learnt there: true angle = nominal + pitch.
    """

    index: np.ndarray
    theta: np.ndarray
    omega: np.ndarray
    alpha: np.ndarray
    covariance: np.ndarray
    settled: np.ndarray
    reading_variance: np.ndarray
    pitch: Callable[[np.ndarray], np.ndarray] | None = None


# (times_s, angles_rad, kind, view) -> Track, or a plain tuple of its first five fields or more.
Factory = Callable[[np.ndarray, np.ndarray, str, str], Any]


def track(factory: Factory, time_s: np.ndarray, angle_rad: np.ndarray, kind: str, view: str) -> Track:
    """Run a factory, and fill in missing values."""
    made = factory(time_s, angle_rad, kind, view)
    if isinstance(made, Track):
        return made
    index, theta, omega, alpha, covariance, *rest = made
    settled = rest[0] if rest else np.ones(len(index), dtype=bool)
    variance = rest[1] if len(rest) > 1 else np.full(len(index), np.nan)
    return Track(
        np.asarray(index),
        np.asarray(theta),
        np.asarray(omega),
        np.asarray(alpha),
        np.asarray(covariance),
        np.asarray(settled, dtype=bool),
        np.broadcast_to(variance, len(index)),
        rest[2] if len(rest) > 2 else None,
    )


def package(time_s: np.ndarray, angle_rad: np.ndarray, kind: str, view: str) -> Track:
    """The package's estimators at default settings; the lag is 10 ms on the engine."""
    settings: dict[str, Any] = {"shaft_lag_s": 0.01} if view == "lag" and kind == "engine" else {}
    estimator = create_estimator(view, **settings)
    parts = [estimator.step(time_s, angle_rad), estimator.finish()]
    states = ShaftStates.join([part for part in parts if len(part)] or parts[:1])
    report = estimator.report
    variance = report.resolution_rad**2 / 12.0 + (report.stamp_jitter_s * states.omega_rad_s) ** 2
    return Track(
        states.index,
        states.theta_rad,
        states.omega_rad_s,
        states.alpha_rad_s2,
        states.covariance,
        states.settled,
        variance,
    )


def learnt_pitch_errors(run: EngineRun) -> np.ndarray:
    """(57,) pitch errors [rad] as the package's `smooth` learns them from all teeth of a run."""
    estimator = create_estimator("smooth", teeth=TEETH + 3, cycle_turns=2)
    estimator.step(run.time_s, run.angle_rad)
    estimator.finish()
    return np.array(estimator.report.pitch_errors_rad)[:TEETH]


def tuned(time_s: np.ndarray, angle_rad: np.ndarray, kind: str, view: str) -> Track:
    """The textbook, tuned on these very readings (unwrapped here); for `lag` the filter."""
    book = textbook(time_s, np.unwrap(angle_rad))
    states, covariance = (
        (book.smooth, book.smooth_covariance) if view == "smooth" else (book.causal, book.causal_covariance)
    )
    n = time_s.size
    return Track(
        np.arange(n),
        states[:, 0],
        states[:, 1],
        states[:, 2],
        covariance,
        np.ones(n, dtype=bool),
        np.full(n, book.reading_variance),
    )
