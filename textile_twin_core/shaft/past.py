"""States of the samples just gone, kept open while later samples mend them: the store of the fixed-lag smoother."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray


@dataclass(slots=True)
class Estimate:
    """Shaft state of one sample.

    Attributes:
        angle, omega, alpha: the state [rad, rad/s, rad/s^2]; the angle counts from `origin` turns.
        covariance: (3, 3).
        origin: whole turns before the local angle.
        settled: whether the filter had found its feet.
        time_s: time of the sample since the first one.
    """

    angle: float
    omega: float
    alpha: float
    covariance: FloatArray
    origin: int
    settled: bool
    time_s: float

    def move(self, shift: FloatArray, spread: FloatArray) -> None:
        """Move by (theta, omega, alpha) and widen by a covariance."""
        angle, omega, alpha = shift.tolist()
        self.angle, self.omega, self.alpha = self.angle + angle, self.omega + omega, self.alpha + alpha
        self.covariance = self.covariance + spread

    def row(self) -> tuple[float, float, float, float, float]:
        """As `ShaftStates.from_rows` wants it."""
        return self.angle, self.omega, self.alpha, float(self.origin), float(self.settled)


class Past:
    """A ring of held states, oldest first, that grows as it must.

    Attributes:
        capacity: places in the ring; the filter keeps three rows of its error matrix for each.
        mean: (3, capacity).
        covariance: (3, 3, capacity).
    """

    def __init__(self) -> None:
        self.capacity = 0
        self.mean = np.zeros((3, 0))
        self.covariance = np.zeros((3, 3, 0))
        self._kept: list[Estimate] = []
        self._oldest = 0

    def __len__(self) -> int:
        return len(self._kept)

    def grow(self) -> IntArray:
        """Enlarge the ring; the (old capacity,) places of old, in the order that the new ring has them first."""
        order = (self._oldest + np.arange(self.capacity)) % max(self.capacity, 1)
        added = max(self.capacity // 4, 8)
        self.mean = np.concatenate([self.mean[:, order], np.zeros((3, added))], axis=1)
        self.covariance = np.concatenate([self.covariance[:, :, order], np.zeros((3, 3, added))], axis=2)
        self.capacity += added
        self._oldest = 0
        return order

    @property
    def full(self) -> bool:
        """Whether the ring must grow before it can take one more."""
        return len(self._kept) == self.capacity

    def push(self, estimate: Estimate) -> int:
        """Hold one more state; its place in the ring."""
        place = (self._oldest + len(self._kept)) % self.capacity
        self.mean[:, place] = estimate.angle, estimate.omega, estimate.alpha
        self.covariance[:, :, place] = estimate.covariance
        self._kept.append(estimate)
        return place

    def mend(self, gain: FloatArray, innovation: float, variance: float) -> None:
        """Take in one reading; `gain` is (3 capacity,), what each held state makes of it."""
        by = gain.reshape(3, -1)
        self.mean += by * innovation
        self.covariance -= by[:, None] * (by * variance)

    def widen(self, columns: FloatArray, moment: FloatArray) -> None:
        """Add what (3 capacity, m) errors per unit make of m independent unknowns of the given second moments."""
        errors = columns.reshape(3, self.capacity, -1)
        self.covariance += np.einsum("ipm,jpm->ijp", errors * moment, errors)

    @property
    def oldest_time_s(self) -> float:
        """Time of the state held longest."""
        return self._kept[0].time_s

    @property
    def oldest(self) -> int:
        """Place of the state held longest."""
        return self._oldest

    def pop(self) -> Estimate:
        """Let go of the oldest state, as it now stands."""
        estimate = self._kept.pop(0)
        place = self._oldest
        estimate.angle, estimate.omega, estimate.alpha = self.mean[:, place].tolist()
        estimate.covariance = self.covariance[:, :, place].copy()
        self._oldest = (place + 1) % self.capacity
        return estimate
