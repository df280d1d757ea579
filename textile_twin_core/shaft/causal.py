"""Recursive shaft estimation: `causal` gives each sample's state at once, `lag` a fixed time later."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.shaft.gate import SampleGate
from textile_twin_core.shaft.past import Estimate
from textile_twin_core.shaft.report import SampleReport
from textile_twin_core.shaft.settings import TrackerSettings, require_positive
from textile_twin_core.shaft.states import ShaftStates
from textile_twin_core.shaft.tracker import ShaftTracker


class CausalEstimator:
    """No lag: an angle-harmonic extended Kalman filter with a bank of event hypotheses (see `tracker`).

    Args:
        settings: fields of `TrackerSettings`.

    Raises:
        SceneError: a setting of the wrong kind or value.
        TypeError: a setting that does not exist.
    """

    lag_s = 0.0

    def __init__(self, **settings: Any) -> None:
        self._settings = TrackerSettings(**settings)
        self.reset()

    def reset(self) -> None:
        """Forget everything, the report included."""
        self._report = SampleReport()
        self._gate = SampleGate(self._report)
        self._begin()

    def _begin(self) -> None:
        self._tracker = ShaftTracker(self._settings, self._report, self.lag_s)
        self._waiting: list[tuple[FloatArray | IntArray, IntArray]] = []
        self._taken = 0

    @property
    def report(self) -> SampleReport:
        """Counts of what came in and what became of it."""
        return self._report

    def step(
        self, stamps: npt.ArrayLike, angles: npt.ArrayLike, velocities: npt.ArrayLike | None = None
    ) -> ShaftStates:
        """Take a block of samples; the states that are ready. See `ShaftEstimator.step`."""
        block = self._gate.admit(stamps, angles, velocities)
        speeds = np.full(len(block), np.nan) if block.velocities is None else block.velocities
        tracker = self._tracker
        for step, angle, speed in zip(block.step_s.tolist(), block.angles.tolist(), speeds.tolist(), strict=True):
            tracker.sample(step, angle, speed)
        skip = min(max(2 - self._taken, 0), len(block))
        self._taken += len(block)
        self._waiting.append((block.stamps[skip:], block.index[skip:]))
        return self._collect()

    def finish(self) -> ShaftStates:
        """The states still held; then the estimator begins anew, but for the report and the newest stamp."""
        self._tracker.release()
        states = self._collect()
        self._begin()
        return states

    def _collect(self) -> ShaftStates:
        ready: list[Estimate] = self._tracker.ready
        self._tracker.ready = []
        self._tracker.tell()
        stamps = np.concatenate([part[0] for part in self._waiting]) if self._waiting else np.zeros(0)
        index = np.concatenate([part[1] for part in self._waiting]) if self._waiting else np.zeros(0, np.int64)
        count = len(ready)
        self._waiting = [(stamps[count:], index[count:])]
        rows = np.array([estimate.row() for estimate in ready]).reshape(count, 5)
        covariance = np.concatenate([np.zeros((0, 3)), *[estimate.covariance for estimate in ready]])
        return ShaftStates.from_rows(stamps[:count], index[:count], rows, covariance.reshape(count, 3, 3))


class LagEstimator(CausalEstimator):
    """Fixed lag: each state has seen all samples up to `shaft_lag_s` after its own.

    Args:
        shaft_lag_s: the lag [s].
        settings: fields of `TrackerSettings`.

    Raises:
        SceneError: a lag that is not positive, or a setting of the wrong kind or value.
        TypeError: a setting that does not exist.
    """

    def __init__(self, *, shaft_lag_s: float = 0.04, **settings: Any) -> None:
        require_positive("shaft_lag_s", shaft_lag_s)
        self.lag_s = shaft_lag_s
        super().__init__(**settings)
