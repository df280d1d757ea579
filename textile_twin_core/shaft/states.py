"""The result of shaft estimation: states at the stamps of the samples, and a report of samples and events."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.shaft.status import STATE, Records
from textile_twin_core.shaft.turns import join_turns

INFLATION = np.array([1.0, 1.15, 1.2])  # of sigmas, as real motions are no white jerk: median in tests/shaft/kinds.py
REJECTION_CAUSES = ("not_finite", "duplicate_stamp", "older_stamp")
EVENTS = ("repeat", "gap", "jump", "outlier", "reversal", "standstill", "loss")
FEW_SAMPLES_A_TURN = 5.0  # below this even the second order of ripple has fewer than 2.5 samples a wave


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


@dataclass
class SampleReport:
    """Counts since the start or the last reset.

    Attributes:
        received, accepted: received samples, and the accepted ones among them.
        rejected: count by cause: not_finite (angle or stamp NaN, infinite or over 1e12 rad or s), duplicate_stamp (less
            than a nanosecond after the newest accepted sample), older_stamp (late or reversed).
        repeats: readings equal to the one before, of a sensor that measures less often than it is read, and readings
            that arrived late together with the one before.
        gaps: pauses of more than 50 intervals, or with an ambiguous turn of a wrapped angle; the filter restarts after
            a gap where its prediction fails.
        jumps: lasting offsets of the angle that no shaft can make.
        outliers: readings rejected because of their residual.
        reversals: changes of the sense of rotation.
        standstills: number of times that the shaft came to a standstill.
        losses: number of times that readings fitted no motion and the filter restarted.
        longest_gap_s, period_s: longest and typical time between accepted samples.
        samples_per_turn: at the present speed; infinite at standstill.
        resolution_rad: encoder step, configured or estimated; 0 while unknown, and where readings are not rounded.
        stamp_jitter_s: standard deviation of the stamps, configured or estimated.
        pitch_errors_rad: of each tooth, configured or estimated; empty for sampled angles.
        ripple: amplitude of the speed's ripple relative to the speed, by multiples of the lowest order,
            1 / cycle_turns; empty without ripple.
        wrapping: wrapped, unwrapped, or open while no reading has shown it.
        state: waiting, starting, running, standstill or lost (restarted within the last 25 samples).
    """

    received: int = 0
    accepted: int = 0
    rejected: dict[str, int] = field(default_factory=lambda: dict.fromkeys(REJECTION_CAUSES, 0))
    repeats: int = 0
    gaps: int = 0
    jumps: int = 0
    outliers: int = 0
    reversals: int = 0
    standstills: int = 0
    losses: int = 0
    longest_gap_s: float = 0.0
    period_s: float = 0.0
    samples_per_turn: float = float("inf")
    resolution_rad: float = 0.0
    stamp_jitter_s: float = 0.0
    pitch_errors_rad: tuple[float, ...] = ()
    ripple: tuple[float, ...] = ()
    wrapping: str = "open"
    state: str = "waiting"

    @property
    def rejected_total(self) -> int:
        """Number of rejected samples of every cause."""
        return sum(self.rejected.values())

    def to_json(self) -> dict[str, object]:
        """Return a dictionary of plain numbers, lists and texts; an infinite number becomes None."""
        values = {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self).items()}
        return {name: None if value == float("inf") else value for name, value in values.items()}

    def text(self) -> str:
        """Return one line for people: samples used, samples rejected by cause, events, and the state."""
        parts = [f"{self.state}: {self.accepted} of {self.received} samples used"]
        if self.rejected_total:
            causes = [f"{count} {cause.replace('_', ' ')}" for cause, count in self.rejected.items() if count]
            parts.append(f"rejected {', '.join(causes)}")
        for event in EVENTS:
            plural = "losses" if event == "loss" else f"{event}s"
            if count := getattr(self, plural):
                parts.append(f"{count} {plural if count > 1 else event}")
        if self.samples_per_turn < FEW_SAMPLES_A_TURN:
            parts.append(
                f"{self.samples_per_turn:.1f} samples a turn: too few to tell the ripple of the speed within a turn;"
                f" give {FEW_SAMPLES_A_TURN:.0f} or more"
            )
        return "; ".join(parts)
