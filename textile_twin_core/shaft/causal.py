"""No lag: each sample's state at once."""

from __future__ import annotations

from typing import Any

import numpy.typing as npt

from textile_twin_core.shaft.base import Recursion, states_of
from textile_twin_core.shaft.report import SampleReport
from textile_twin_core.shaft.settings import ShaftSettings
from textile_twin_core.shaft.states import ShaftStates


class CausalEstimator:
    """The filter's own mixture (see `filter`).

    Args:
        settings: fields of `ShaftSettings`.

    Raises:
        SceneError: a setting of the wrong kind or value.
        TypeError: a setting that does not exist.
    """

    def __init__(self, **settings: Any) -> None:
        self._settings = ShaftSettings(**settings)
        self.reset()

    def reset(self) -> None:
        """Forget everything, the report included."""
        self._recursion = Recursion(self._settings)

    @property
    def report(self) -> SampleReport:
        """Counts of what came in and what became of it."""
        return self._recursion.report()

    def step(
        self, stamps: npt.ArrayLike, angles: npt.ArrayLike, velocities: npt.ArrayLike | None = None
    ) -> ShaftStates:
        """Take a block of samples; a state for each accepted one from the third on. See `ShaftEstimator.step`."""
        return states_of(self._recursion.walk(self._recursion.follow, stamps, angles, velocities))

    def finish(self) -> ShaftStates:
        """Nothing is held back; the estimator begins anew, but for the report and the newest stamp."""
        self._recursion.begin_anew()
        return ShaftStates.empty(self._recursion.last)
