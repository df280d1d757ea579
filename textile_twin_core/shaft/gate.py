"""The gate for angle samples: refuses what cannot be used, counts why, and unwraps what may pass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.errors import MotionError
from textile_twin_core.shaft.report import SampleReport
from textile_twin_core.shaft.turns import TURN, split_turn

SPAN_OF_WRAPPED = 1.25
"""In periods: a wrapped angle stays within one, and noise about its ends; a counting one leaves it soon."""


@dataclass(frozen=True)
class Accepted:
    """Samples that passed the gate.

    Attributes:
        stamps: (n,) as they came.
        index: (n,) running number of the input sample.
        step_s: (n,) time since the accepted sample before; 0 for the very first.
        angles: (n,) as they came [rad].
        velocities: (n,) [rad/s], NaN where there is none; or None.
    """

    stamps: FloatArray | IntArray
    index: IntArray
    step_s: FloatArray
    angles: FloatArray
    velocities: FloatArray | None

    def __len__(self) -> int:
        return int(self.index.size)


class SampleGate:
    """Accepts samples whose angle is finite and whose stamp is newer than every accepted one; works in blocks.

    The outcome does not depend on how the samples are cut into blocks. Nothing raises for what a sensor may send;
    only arrays of different lengths or dtypes that are no numbers are the caller's mistake.
    """

    def __init__(self, report: SampleReport) -> None:
        self._report = report
        self._last: np.int64 | np.float64 | None = None

    def admit(self, stamps: npt.ArrayLike, angles: npt.ArrayLike, velocities: npt.ArrayLike | None = None) -> Accepted:
        """The samples of one block that may pass.

        Args:
            stamps: (n,) integer nanoseconds or float seconds, or a scalar.
            angles: (n,) shaft angle [rad].
            velocities: (n,) shaft speed [rad/s] where the sensor gives it, NaN where not.

        Raises:
            MotionError: lengths differ, or stamps change between integer and float.
        """
        stamp, angle, velocity = _as_samples(stamps, angles, velocities)
        if self._last is not None and (self._last.dtype.kind == "i") != (stamp.dtype.kind == "i"):
            raise MotionError("stamps changed between integer nanoseconds and float seconds: keep to one, or reset")
        report = self._report
        first = report.received
        report.received += stamp.size
        finite = np.isfinite(angle)
        if stamp.dtype.kind == "f":
            finite &= np.isfinite(stamp)
        report.rejected["not_finite"] += int(stamp.size - np.count_nonzero(finite))
        where = np.flatnonzero(finite)
        stamp = stamp[where]
        newest = stamp if self._last is None else np.concatenate([[self._last], stamp])
        newest = np.maximum.accumulate(newest) if newest.size else newest
        if self._last is None:
            newer = np.ones(stamp.size, dtype=bool)
            newer[1:] = stamp[1:] > newest[:-1]
            twice = np.zeros(stamp.size, dtype=bool)
            twice[1:] = stamp[1:] == newest[:-1]
        else:
            newer = stamp > newest[:-1]
            twice = stamp == newest[:-1]
        repeated = int(np.count_nonzero(twice))
        report.rejected["duplicate_stamp"] += repeated
        report.rejected["older_stamp"] += int(stamp.size - np.count_nonzero(newer)) - repeated
        stamp, where = stamp[newer], where[newer]
        report.accepted += stamp.size
        step = self._steps(stamp)
        chosen = None if velocity is None else velocity[where]
        return Accepted(stamp, where.astype(np.int64) + first, step, angle[where], chosen)

    def _steps(self, stamp: FloatArray | IntArray) -> FloatArray:
        if stamp.size == 0:
            return np.zeros(0)
        before = stamp[:1] if self._last is None else np.array([self._last], dtype=stamp.dtype)
        step = np.diff(np.concatenate([before, stamp]))
        self._last = stamp[-1]
        seconds = step * 1e-9 if stamp.dtype.kind == "i" else step.astype(np.float64)
        self._report.longest_gap_s = max(self._report.longest_gap_s, float(seconds.max()))
        return np.asarray(seconds, dtype=np.float64)


def _as_samples(
    stamps: npt.ArrayLike, angles: npt.ArrayLike, velocities: npt.ArrayLike | None
) -> tuple[FloatArray | IntArray, FloatArray, FloatArray | None]:
    stamp = np.atleast_1d(np.asarray(stamps))
    angle = np.atleast_1d(np.asarray(angles, dtype=np.float64))
    if stamp.dtype.kind not in "iuf":
        raise MotionError(f"stamps are of type {stamp.dtype}: give integer nanoseconds or float seconds")
    stamp = stamp.astype(np.float64 if stamp.dtype.kind == "f" else np.int64, copy=False)
    if stamp.ndim != 1 or angle.shape != stamp.shape:
        raise MotionError(
            f"{stamp.size} stamps (shape {stamp.shape}) but {angle.size} angles (shape {angle.shape}): "
            "give one stamp per angle"
        )
    if velocities is None:
        return stamp, angle, None
    velocity = np.atleast_1d(np.asarray(velocities, dtype=np.float64))
    if velocity.size == 0:
        return stamp, angle, None
    if velocity.shape != stamp.shape:
        raise MotionError(f"{stamp.size} stamps but {velocity.size} velocities: give one per angle, or none")
    return stamp, angle, velocity


class Unwrapper:
    """Turns raw angles into angles near a prediction, in a local frame that starts at a whole turn.

    A sensor may give angles that wrap (any range of one period) or that count their turns. `auto` takes the input as
    wrapped while all values fit within one period, and as unwrapped for good from the first that does not.

    Args:
        wrapping: "auto", "wrapped" or "unwrapped".
        period_rad: what a wrapping input wraps by: a turn, times the gear ratio between encoder and shaft.
    """

    def __init__(self, wrapping: str, period_rad: float) -> None:
        self._auto = wrapping == "auto"
        self._period = period_rad
        self.wrapped = wrapping != "unwrapped"
        self.origin = 0
        self._low = np.inf
        self._high = -np.inf
        self._slips = 0

    def begin(self, raw: float) -> float:
        """Choose the whole turn nearest to the first angle as origin; the local angle."""
        self.origin, phase = split_turn(raw)
        self._low = self._high = raw
        self._slips = 0
        return phase

    def local(self, raw: float, expected: float) -> float:
        """The local angle of a raw one; `expected` is where the shaft should be, by which a wrap is recognised."""
        if self._auto and self.wrapped:
            self._low, self._high = min(self._low, raw), max(self._high, raw)
            if self._high - self._low > self._period * SPAN_OF_WRAPPED:
                self.wrapped = False
                self._slips = 0
        turns, phase = split_turn(raw)
        angle = phase + (turns - self.origin) * TURN
        if self.wrapped:
            self._slips = round((expected - angle) / self._period)
        return angle + self._slips * self._period

    def rebase(self, local: float) -> float:
        """Move the origin to the whole turn nearest to a local angle, so that local angles stay small; the new one."""
        turns = round(local / TURN)
        self.origin += turns
        return local - turns * TURN
