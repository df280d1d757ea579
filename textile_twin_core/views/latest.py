"""What the last minutes held, while samples come in for weeks: residuals by angle, and extremes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison import AngleBins, RunningAngleBins

T = TypeVar("T")


class Latest(Generic[T]):
    """Two gatherers, of which the one that is shown goes as the other has held `span_s`, and becomes it.

    What is shown is thus of the last `span_s` to twice that.

    Args:
        create: makes an empty gatherer.
        span_s: seconds; inf keeps all.
    """

    def __init__(self, create: Callable[[], T], span_s: float) -> None:
        self._create, self._span_s = create, span_s
        self.shown, self._next = create(), create()
        self._turned_s = np.nan

    def turn(self, time_s: float) -> None:
        """Let go what is too old at this time [s]; also where time was set back."""
        if not self._turned_s - self._span_s <= time_s < self._turned_s + self._span_s:
            if np.isfinite(self._turned_s):
                self.shown, self._next = self._next, self._create()
            self._turned_s = time_s

    @property
    def both(self) -> tuple[T, T]:
        """What has to take all that comes."""
        return self.shown, self._next


class Residuals:
    """Residuals by shaft angle in so many bins, and their statistics."""

    def __init__(self, bins: int) -> None:
        self._bins = RunningAngleBins(bins)
        self._squares = 0.0
        self.count, self.worst_Nm = 0, 0.0

    def add(self, theta_rad: FloatArray, residual_Nm: FloatArray) -> None:
        """Take residuals (n,) at angles (n,), all finite."""
        self._bins.add(theta_rad, residual_Nm)
        self._squares += float(residual_Nm @ residual_Nm)
        self.count += residual_Nm.size
        self.worst_Nm = max(self.worst_Nm, float(np.max(np.abs(residual_Nm), initial=0.0)))

    @property
    def rms_Nm(self) -> float:
        """Root mean square; there has to be one."""
        return float(np.sqrt(self._squares / self.count))

    def bins(self) -> AngleBins:
        """The bins of all of them."""
        return self._bins.bins()


class Extremes:
    """The smallest and the largest of numbers; 0 stands for none."""

    def __init__(self) -> None:
        self.low, self.high = 0.0, 0.0

    def add(self, values: FloatArray) -> None:
        """Take numbers (n,); those that are not finite are left out."""
        finite = values[np.isfinite(values)]
        self.low = min(self.low, float(np.min(finite, initial=0.0)))
        self.high = max(self.high, float(np.max(finite, initial=0.0)))
