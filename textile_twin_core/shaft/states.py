"""The result of shaft estimation: angle, speed, acceleration and their covariance at the stamps of the samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.shaft.status import STATE, Records
from textile_twin_core.shaft.turns import join_turns

UNMODELLED = np.array([1.0, 1.15, 1.15])
"""Motions are no white jerk: how much wider than the model says errors of angle, speed and acceleration are, at the
median over kinds of records with known truth (see tests/shaft/kinds.py)."""


@dataclass(frozen=True)
class ShaftStates:
    """States of the shaft, one row per accepted sample, in the order of the samples.

    Attributes:
        stamps: (n,) the samples' own stamps, with the dtype and the values they came with.
        rows: (n,) records that begin as STATE (see `status`), which the properties give units.
    """

    stamps: FloatArray | IntArray
    rows: Records

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def index(self) -> IntArray:
        """(n,) running number, from 0, of the input sample (accepted or not) that the state speaks of."""
        return self.rows["index"].astype(np.int64)

    @property
    def turns(self) -> IntArray:
        """(n,) whole turns of the shaft; with `phase_rad` the angle without loss, however many turns there are."""
        return self.rows["turns"].astype(np.int64)

    @property
    def phase_rad(self) -> FloatArray:
        """(n,) angle beyond the whole turns, in [-pi, pi)."""
        return self.rows["phase"]

    @property
    def theta_rad(self) -> FloatArray:
        """(n,) unwrapped angle; follows the input's own turn count when the input is unwrapped."""
        return join_turns(self.turns, self.phase_rad)

    @property
    def omega_rad_s(self) -> FloatArray:
        """(n,) speed."""
        return self.rows["speed"]

    @property
    def alpha_rad_s2(self) -> FloatArray:
        """(n,) acceleration."""
        return self.rows["acceleration"]

    @property
    def settled(self) -> BoolArray:
        """(n,) True where the estimator has found its feet."""
        return self.rows["settled"] > 0.5

    @property
    def covariance(self) -> FloatArray:
        """(n, 3, 3) of (theta, omega, alpha)."""
        return np.asarray(self.rows["covariance"].reshape(-1, 3, 3) * np.outer(UNMODELLED, UNMODELLED))

    @property
    def sigma(self) -> FloatArray:
        """(n, 3) standard deviations of theta [rad], omega [rad/s], alpha [rad/s^2]."""
        return np.asarray(np.sqrt(self.rows["covariance"][:, ::4]) * UNMODELLED)

    def variance_of(self, gradient: FloatArray) -> FloatArray:
        """Variance of a quantity with the given (n, 3) gradient by (theta, omega, alpha)."""
        return np.asarray(np.einsum("ni,nij,nj->n", gradient, self.covariance, gradient))

    @classmethod
    def empty(cls, stamps: FloatArray | IntArray | None = None) -> ShaftStates:
        """No states; `stamps` lends its dtype."""
        return cls(np.zeros(0, dtype=np.float64 if stamps is None else stamps.dtype), np.zeros(0, STATE))

    @classmethod
    def join(cls, parts: Sequence[ShaftStates]) -> ShaftStates:
        """One after the other; the parts must be of one stamp dtype."""
        if len(parts) == 1:
            return parts[0]
        rows = [part.rows[list(STATE.names or ())].astype(STATE) for part in parts]
        return cls(np.concatenate([part.stamps for part in parts]), np.concatenate(rows))
