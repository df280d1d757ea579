"""What every shaft estimator offers, and the table of their names."""

from __future__ import annotations

from typing import Protocol

import numpy.typing as npt

from textile_twin_core.shaft.report import SampleReport
from textile_twin_core.shaft.states import ShaftStates


class ShaftEstimator(Protocol):
    """Angle samples in, shaft states out; state lives between the calls.

    The same samples give identical states however they are cut into blocks. From the third accepted sample on each
    accepted sample gets exactly one state, now (`step`) or later (`step`, `finish`).
    """

    @property
    def report(self) -> SampleReport:
        """Counts of what came in and what became of it."""

    def step(
        self, stamps: npt.ArrayLike, angles: npt.ArrayLike, velocities: npt.ArrayLike | None = None
    ) -> ShaftStates:
        """Take a block of samples of any size; the states that are ready.

        Args:
            stamps: (n,) int64 nanoseconds or float seconds, or a scalar.
            angles: (n,) shaft angle [rad], wrapped or not.
            velocities: (n,) speed [rad/s] where the sensor gives it (NaN where not).

        Raises:
            MotionError: arrays of different lengths, or stamps of another kind than before.
        """

    def finish(self) -> ShaftStates:
        """The states that the estimator still holds; it is then as after `reset`, but for the report."""

    def reset(self) -> None:
        """Forget everything, the report included."""
