"""The result of shaft estimation: angle, speed, acceleration and their covariance at the stamps of the samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.shaft.status import ACCELERATION, COVARIANCE, PHASE, SETTLED, SPEED, TURNS, WIDTH
from textile_twin_core.shaft.turns import join_turns


@dataclass(frozen=True)
class ShaftStates:
    """States of the shaft, one row per accepted sample, in the order of the samples.

    Attributes:
        stamps: (n,) the samples' own stamps, with the dtype and the values they came with.
        index: (n,) running number, from 0, of the input sample (accepted or not) that the state speaks of.
        turns: (n,) whole turns of the shaft; with `phase_rad` the angle without loss, however many turns there are.
        phase_rad: (n,) angle beyond the whole turns, in [-pi, pi).
        omega_rad_s: (n,) speed.
        alpha_rad_s2: (n,) acceleration.
        covariance: (n, 3, 3) of (theta, omega, alpha).
        settled: (n,) True where the estimator has found its feet.
    """

    stamps: FloatArray | IntArray
    index: IntArray
    turns: IntArray
    phase_rad: FloatArray
    omega_rad_s: FloatArray
    alpha_rad_s2: FloatArray
    covariance: FloatArray
    settled: BoolArray

    def __len__(self) -> int:
        return int(self.index.size)

    @property
    def theta_rad(self) -> FloatArray:
        """(n,) unwrapped angle; follows the input's own turn count when the input is unwrapped."""
        return join_turns(self.turns, self.phase_rad)

    @property
    def sigma(self) -> FloatArray:
        """(n, 3) standard deviations of theta [rad], omega [rad/s], alpha [rad/s^2]."""
        return np.asarray(np.sqrt(np.maximum(np.diagonal(self.covariance, axis1=1, axis2=2), 0.0)))

    def variance_of(self, gradient: FloatArray) -> FloatArray:
        """Variance of a quantity with the given (n, 3) gradient by (theta, omega, alpha)."""
        return np.asarray(np.einsum("ni,nij,nj->n", gradient, self.covariance, gradient))

    @classmethod
    def empty(cls, stamps: FloatArray | IntArray | None = None) -> ShaftStates:
        """No states; `stamps` lends its dtype."""
        none = np.zeros(0, dtype=np.float64 if stamps is None else stamps.dtype)
        return cls.from_table(none, np.zeros(0, dtype=np.int64), np.zeros((0, WIDTH)))

    @classmethod
    def from_table(cls, stamps: FloatArray | IntArray, index: IntArray, table: FloatArray) -> ShaftStates:
        """From the rows (n, WIDTH) of a table (see `status`)."""
        covariance = table[:, COVARIANCE : COVARIANCE + 9].reshape(-1, 3, 3)
        turns, settled = table[:, TURNS].astype(np.int64), table[:, SETTLED] > 0.5
        return cls(
            stamps, index, turns, table[:, PHASE], table[:, SPEED], table[:, ACCELERATION], covariance, settled
        )  # fmt: skip

    @classmethod
    def join(cls, parts: Sequence[ShaftStates]) -> ShaftStates:
        """One after the other; the parts must be of one stamp dtype."""
        if len(parts) == 1:
            return parts[0]
        names = cls.__dataclass_fields__
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})
