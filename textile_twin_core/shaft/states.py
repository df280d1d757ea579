"""The result of shaft estimation: angle, speed, acceleration and their covariance at the stamps of the samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.shaft.status import STATE, Records
from textile_twin_core.shaft.turns import join_turns

INFLATION = np.array([1.0, 1.15, 1.2])  # of sigmas, as real motions are no white jerk: median in tests/shaft/kinds.py


class OneState(NamedTuple):
    """The shaft at one sample: phase [rad] beyond its whole turns, speed [rad/s], acceleration [rad/s^2], turns."""

    phase_rad: float
    omega_rad_s: float
    alpha_rad_s2: float
    turns: float


@dataclass(frozen=True)
class ShaftStates:
    """Estimated states of the shaft, one for each accepted sample, in the order of the samples.

    Attributes:
        stamps: (n,) stamps of the samples, unchanged.
        rows: (n,) records whose first fields are those of STATE (see `status`).

    Examples:
        >>> import numpy as np
        >>> from textile_twin_core.shaft import create_estimator
        >>> stamps = np.arange(500) / 500.0  # [s]
        >>> states = create_estimator("causal").step(stamps, 16.76 * stamps)  # [rad]
        >>> round(float(states.omega_rad_s[-1]), 2)  # [rad/s]
        16.76
    """

    stamps: FloatArray | IntArray
    rows: Records

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def index(self) -> IntArray:
        """(n,) index of the state's sample among all received samples, accepted or not."""
        return self.rows["index"].astype(np.int64)

    @property
    def turns(self) -> IntArray:
        """(n,) whole turns; together with `phase_rad` the angle at full precision."""
        return self.rows["turns"].astype(np.int64)

    @property
    def phase_rad(self) -> FloatArray:
        """(n,) angle beyond the whole turns [rad], in [-pi, pi)."""
        return self.rows["phase"]

    @property
    def theta_rad(self) -> FloatArray:
        """(n,) unwrapped angle [rad]; keeps the turn count of an unwrapped input."""
        return join_turns(self.turns, self.phase_rad)

    @property
    def omega_rad_s(self) -> FloatArray:
        """(n,) speed [rad/s]."""
        return self.rows["speed"]

    @property
    def alpha_rad_s2(self) -> FloatArray:
        """(n,) acceleration [rad/s^2]."""
        return self.rows["acceleration"]

    @property
    def settled(self) -> BoolArray:
        """(n,) True where the estimate has converged after a start."""
        return self.rows["settled"] > 0.5

    @property
    def covariance(self) -> FloatArray:
        """(n, 3, 3) covariance of (theta, omega, alpha) [rad, s]."""
        return np.asarray(self.rows["covariance"].reshape(-1, 3, 3) * np.outer(INFLATION, INFLATION))

    @property
    def sigma(self) -> FloatArray:
        """(n, 3) standard deviations of theta [rad], omega [rad/s], alpha [rad/s^2]."""
        return np.asarray(np.sqrt(self.rows["covariance"][:, ::4]) * INFLATION)

    def variance_of(self, gradient: FloatArray) -> FloatArray:
        """Return the (n,) variance of a quantity with this gradient (n, 3) by (theta, omega, alpha)."""
        return np.asarray(np.einsum("ni,nij,nj->n", gradient, self.covariance, gradient))

    @classmethod
    def empty(cls, stamps: FloatArray | IntArray) -> ShaftStates:
        """Return an object without states, with the dtype of `stamps`."""
        return cls(stamps[:0], np.zeros(0, STATE))

    @classmethod
    def join(cls, parts: Sequence[ShaftStates]) -> ShaftStates:
        """Concatenate states; the parts must have stamps of the same dtype."""
        if len(parts) == 1:
            return parts[0]
        rows = [part.rows[list(STATE.names or ())].astype(STATE) for part in parts]
        return cls(np.concatenate([part.stamps for part in parts]), np.concatenate(rows))
