"""What every shaft estimator offers, and what the three views share: gate, recursion, encoder, report."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import MotionError
from textile_twin_core.shaft.encoder import UNKNOWN_STEP_RAD, StepFinder
from textile_twin_core.shaft.filter import follow
from textile_twin_core.shaft.gate import as_samples
from textile_twin_core.shaft.readings import set_rounding
from textile_twin_core.shaft.report import SampleReport
from textile_twin_core.shaft.settings import ShaftSettings
from textile_twin_core.shaft.states import ShaftStates
from textile_twin_core.shaft.status import COUNTS, INDEX, KEPT, MOTIONS, SETTLED, WIDTH, new_status, ripple_amplitudes
from textile_twin_core.shaft.teeth import ToothWheel
from textile_twin_core.shaft.turns import TURN

Stamps: TypeAlias = npt.NDArray[Any]
"""int64 nanoseconds or float64 seconds."""
Parts = list[tuple[Stamps, FloatArray]]
Walk = Callable[[Stamps, FloatArray, FloatArray, FloatArray], tuple[Stamps, FloatArray]]


PIECE = 262_144
"""Samples whose rows are held together, so many that their memory goes back to the computer when they are let go."""


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


class Recursion:
    """The status of one stream of samples, and the encoder that gives them.

    Args:
        settings: as told.
    """

    def __init__(self, settings: ShaftSettings) -> None:
        self.settings = settings
        self.finder = StepFinder(settings.period_rad)
        self.finder.step = settings.step_rad
        self.status = new_status(settings, UNKNOWN_STEP_RAD if settings.step_rad is None else settings.step_rad)
        self.last: Stamps = np.zeros(1, np.int64)
        self._kind = ""
        self.wheel = (
            ToothWheel(settings.teeth, settings.tooth_zero_rad, settings.pitch_errors_rad) if settings.teeth else None
        )

    def walk(self, walk: Walk, stamps: npt.ArrayLike, angles: npt.ArrayLike, velocities: npt.ArrayLike | None) -> Parts:
        """Let `walk` take the samples piece by piece, learning about the encoder between the pieces.

        Returns stamps and rows of the table that each piece gave.
        """
        stamp, angle, velocity = as_samples(stamps, angles, velocities)
        self._mind_kind(stamp)
        if self.wheel is not None:
            angle = self.wheel.corrected(angle)
        if not self.finder.wanted and stamp.size <= PIECE:
            return [walk(stamp, angle, velocity, np.empty(stamp.size))]
        done = 0
        parts: Parts = []
        while done < stamp.size or not parts:
            end = min(stamp.size, done + (self.finder.wanted or PIECE))
            piece, heard = slice(done, end), np.empty(end - done)
            parts.append(walk(stamp[piece], angle[piece], velocity[piece], heard))
            self._learn(heard)
            done = end
        return parts

    def follow(
        self, stamps: Stamps, angles: FloatArray, velocities: FloatArray, heard: FloatArray
    ) -> tuple[Stamps, FloatArray]:
        """Stamps and rows of the accepted samples, filtered."""
        table = np.empty((stamps.size, WIDTH))
        count = follow(self.status, self.last, stamps, angles, velocities, heard, table)
        if count < stamps.size:
            table = table[:count]
            stamps = stamps[table[:, INDEX].astype(np.int64) - (self.received - stamps.size)]
        return stamps, table

    def _mind_kind(self, stamp: Stamps) -> None:
        if self._kind == stamp.dtype.char:
            return
        if self.last.dtype != stamp.dtype:
            if self.status["accepted"][0] > 0:
                raise MotionError("stamps changed between integer nanoseconds and float seconds: keep to one, or reset")
            self.last = np.zeros(1, stamp.dtype)
        self.status["unit"] = 1e-9 if stamp.dtype == np.int64 else 1.0
        self._kind = stamp.dtype.char

    def _learn(self, heard: FloatArray) -> None:
        """A lesson about the encoder from readings that were used (n,), NaN for the others."""
        if self.finder.wanted:
            step = self.finder.take(heard[~np.isnan(heard)])
            if step is not None:
                set_rounding(self.status, step)

    @property
    def received(self) -> int:
        """Samples that came in so far."""
        return int(self.status["received"][0])

    def begin_anew(self) -> None:
        """Forget the motion; counts, the newest stamp and what is known of the encoder stay."""
        fresh = new_status(self.settings, float(self.status["rounding"][0]))
        for name in KEPT:
            fresh[name] = self.status[name]
        self.status = fresh

    def report(self) -> SampleReport:
        """Counts and what was learnt so far."""
        now = self.status[0]
        counts = {name: int(now[name]) for name in COUNTS}
        travel = abs(now["speed"]) * now["interval"]
        state = "waiting" if now["accepted"] == 0 else MOTIONS[int(now["motion"])]
        if state == "starting" and now["losses"] > 0:
            state = "lost"
        return SampleReport(
            received=self.received,
            rejected={"not_finite": int(now["not_finite"]), "duplicate_stamp": int(now["duplicate"]), "older_stamp":
            int(now["older"])},
            longest_gap_s=float(now["longest"]),
            period_s=float(now["interval"]),
            samples_per_turn=float(TURN / travel) if travel > 0.0 else float("inf"),
            resolution_rad=float(now["rounding"]) if self.finder.step else 0.0,
            stamp_jitter_s=float(np.sqrt(now["jitter"])),
            pitch_errors_rad=() if self.wheel is None else tuple(self.wheel.errors_rad.tolist()),
            ripple=tuple(ripple_amplitudes(self.status).tolist()),
            state=state,
            **counts,
        )  # fmt: skip


def joined(parts: Parts) -> tuple[Stamps, FloatArray]:
    """Stamps and rows of all parts, which are taken out of their list on the way: the rows of hours are large."""
    if len(parts) == 1:
        return parts.pop()
    count = sum(stamps.size for stamps, _ in parts)
    stamps, table = np.empty(count, parts[0][0].dtype), np.empty((count, WIDTH))
    while parts:
        stamp, rows = parts.pop()
        stamps[count - stamp.size : count], table[count - stamp.size : count] = stamp, rows
        count -= stamp.size
    return stamps, table


def states_of(parts: Parts) -> ShaftStates:
    """States of the rows, but for those of a motion's first two samples."""
    stamps, table = joined(parts)
    first = 0
    while first < min(2, stamps.size) and table[first, SETTLED] < 0.0:
        first += 1
    return ShaftStates(stamps[first:], table[first:]) if first else ShaftStates(stamps, table)
