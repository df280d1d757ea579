"""The filtered states (view `causal`), and the code shared with the smoothing views."""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import entry, records
from textile_twin_core.errors import MotionError
from textile_twin_core.shaft.encoder import StepFinder, ToothWheel
from textile_twin_core.shaft.filter import Block, run_filter
from textile_twin_core.shaft.measurement_noise import set_resolution
from textile_twin_core.shaft.settings import ShaftSettings
from textile_twin_core.shaft.states import INFLATION, REJECTION_CAUSES, OneState, SampleReport, ShaftStates
from textile_twin_core.shaft.status import (
    COUNTS,
    MOTIONS,
    ROW,
    STATE,
    WRAPPINGS,
    Records,
    Stamps,
    new_status,
    status_of_next_record,
)
from textile_twin_core.shaft.turns import TURN

Part = tuple[Stamps, Records]  # stamps and rows of accepted samples
_STATE = struct.Struct(f"={STATE.names.index('settled') + 1}d" if STATE.names else "")
_VARIANCE, _SPEED_VARIANCE_AT = struct.Struct("=d"), STATE.itemsize - 5 * 8  # of the covariance (9,), the last field
SPEED_INFLATION = float(INFLATION[1])
PIECE = 262_144  # samples filtered at once: the system reclaims an array of so large a size when it is released


class ShaftEstimator:
    """Recursive estimator: angle samples in, shaft states out.

    The same samples give identical states in blocks of any size. From the third on, each accepted sample gets exactly
    one state, from the same `step`, a later one, or `finish`.

    Args:
        settings: fields of `ShaftSettings`.

    Raises:
        SceneError: a setting of the wrong kind or value.
        TypeError: a setting that does not exist.
    """

    at_once = True  # whether a sample's state is ready with the sample

    def __init__(self, **settings: Any) -> None:
        self._settings = ShaftSettings(**settings)
        self.reset()

    def reset(self) -> None:
        """Reset everything, the report included."""
        given = self._settings
        self._finder = StepFinder(given.period_rad, given.step_rad)
        self._status = new_status(given, 2)
        self._last: Stamps = np.zeros(1, np.int64)
        self._kind, self._run, self._one = "", run_filter, Block(*np.zeros((5, 1)))
        self._row: Any = records(ROW)
        self._wheel = ToothWheel(given.teeth, given.tooth_zero_rad, given.pitch_errors_rad) if given.teeth else None
        self._begin()

    def _begin(self) -> None:
        """Start a record."""

    def step(self, stamps: ArrayLike, angles: ArrayLike, velocities: ArrayLike | None = None) -> ShaftStates:
        """Process a block of samples of any size.

        Args:
            stamps: (n,) int64 nanoseconds or float seconds, or a scalar.
            angles: (n,) shaft angle [rad], wrapped or not.
            velocities: (n,) speed [rad/s] of a sensor that measures it, NaN where missing.

        Returns:
            The states that became ready.

        Raises:
            MotionError: arrays of different lengths, or stamps of another kind than before.
        """
        return states_of(self._walk(stamps, angles, velocities))

    def serves_one(self, stamp: int | float) -> bool:
        """Return whether `step_one` may be called: stamps are integers, and no learning between samples is pending."""
        ready = self.at_once and self._kind == "l" and self._wheel is None
        return ready and type(stamp) is int and not self._finder.wanted

    def step_one(self, stamp: int, angle: float, velocity: float) -> OneState | None:
        """Process one sample: stamp [ns], angle [rad], speed [rad/s] or NaN; return its state, None if it has none.

        A live node wakes for each sample with cold caches: creating and checking arrays would take five times as long
        as the filter. The block is therefore created once.
        """
        if self._last is not self._one.last:
            self._one = Block(self._last, np.zeros(1, np.int64), np.zeros(1), np.zeros(1), np.zeros(1))
            self._run = entry(run_filter, self._status, self._one, self._row)
        one = self._one
        one.stamps[0], one.angles[0], one.velocities[0] = stamp, angle, velocity
        if not self._run(self._status, one, self._row):
            return None
        phase, omega, alpha, turns, settled = _STATE.unpack_from(self._row)
        return None if settled < 0.0 else OneState(phase, omega, alpha, turns)

    @property
    def omega_sigma_rad_s(self) -> float:
        """Standard deviation of the last speed from `step_one` [rad/s]."""
        (variance,) = _VARIANCE.unpack_from(self._row, _SPEED_VARIANCE_AT)
        return math.sqrt(max(variance, 0.0)) * SPEED_INFLATION

    def finish(self) -> ShaftStates:
        """End the record and return the remaining states; report and newest stamp persist, everything else is reset."""
        self._status = status_of_next_record(self._status, self._settings)
        self._begin()
        return ShaftStates.empty(self._last)

    def forget_newest(self) -> None:
        """Accept stamps older than the newest one; call it after `finish`, where a clock was set back."""
        self._last[0] = np.iinfo(np.int64).min // 2

    @property
    def report(self) -> SampleReport:
        """Counts of accepted and rejected samples and of events, and the estimated parameters."""
        now = self._status[0]
        counts, sampling, track, noise = now["counts"], now["sampling"], now["track"], now["noise"]
        travel = abs(track["speed"]) * sampling["interval"]
        state = "waiting" if counts["accepted"] == 0 else MOTIONS[int(track["motion"])]
        return SampleReport(
            received=int(counts["received"]),
            rejected={cause: int(counts[cause]) for cause in REJECTION_CAUSES},
            longest_gap_s=float(sampling["longest"]),
            period_s=float(sampling["interval"]),
            samples_per_turn=float(TURN / travel) if travel > 0.0 else float("inf"),
            resolution_rad=float(noise["resolution"]) if self._finder.step else 0.0,
            stamp_jitter_s=float(np.sqrt(noise["jitter"])),
            pitch_errors_rad=() if self._wheel is None else tuple(self._wheel.errors_rad.tolist()),
            ripple=tuple(_ripple_amplitudes(self._status).tolist()),
            wrapping=WRAPPINGS[int(now["unwrapping"]["wrapping"])],
            state="lost" if state == "starting" and counts["losses"] > 0 else state,
            **{name: int(counts[name]) for name in COUNTS},
        )

    def _walk(self, stamps: ArrayLike, angles: ArrayLike, velocities: ArrayLike | None) -> list[Part]:
        """Process samples in pieces, estimating the encoder's resolution in between; return the rows of each piece."""
        stamp, angle, velocity = _as_samples(stamps, angles, velocities)
        if self._kind != stamp.dtype.char:
            if self._last.dtype != stamp.dtype and self._status["counts"]["accepted"][0] > 0:
                raise MotionError("stamps changed between integer nanoseconds and float seconds: keep to one, or reset")
            self._last, self._kind = self._last.astype(stamp.dtype), stamp.dtype.char
            self._status["sampling"]["unit"] = 1e-9 if stamp.dtype == np.int64 else 1.0
        if self._wheel is not None:
            angle = self._wheel.corrected(angle)
        parts: list[Part] = []
        for first in range(0, max(stamp.size, 1), PIECE):
            end, done, count = min(first + PIECE, stamp.size), first, 0
            ready, rows = self._room(end - first)
            while done < end:
                to = min(end, done + self._piece())
                block = Block(self._last, stamp[done:to], angle[done:to], velocity[done:to], np.empty(to - done))
                count += self._take(block, ready[count:], rows[count:])
                if self._finder.wanted:
                    self._find_step(block)
                done = to
            parts.append((ready, rows) if count == rows.size else (ready[:count], rows[:count]))
        return parts

    def _room(self, more: int) -> Part:
        """Allocate arrays for the states that `more` further samples make ready."""
        return np.empty(more, self._last.dtype), records(ROW, more)

    def _piece(self) -> int:
        """Maximum number of samples in a block."""
        return self._finder.wanted or PIECE

    def _take(self, block: Block, ready: Stamps, rows: Records) -> int:
        """Filter a block; write stamps and rows of the states that become ready, and return their number."""
        stamps = block.stamps
        count = run_filter(self._status, block, rows)
        if count < stamps.size:
            stamps = stamps[
                rows["index"][:count].astype(np.int64) - (int(self._status["counts"]["received"][0]) - stamps.size)
            ]
        ready[:count] = stamps
        return count

    def _find_step(self, block: Block) -> None:
        """Search the encoder's step in a filtered block."""
        used = ~np.isnan(block.unwrapped)
        readings = block.unwrapped[used]
        if self._settings.reading_at is not None:
            readings = self._settings.reading_at(readings)
        step = self._finder.take(block.stamps[used].astype(np.float64), readings)
        if step is not None:
            set_resolution(self._status, step)


def _as_samples(
    stamps: ArrayLike, angles: ArrayLike, velocities: ArrayLike | None
) -> tuple[Stamps, FloatArray, FloatArray]:
    """Convert samples to arrays: stamps int64 [ns] or float64 [s], angles [rad], velocities [rad/s] (empty for none).

    Raises:
        MotionError: arrays of different lengths, or stamps that are not numbers.
    """
    stamp, angle = np.asarray(stamps), np.ascontiguousarray(angles, dtype=np.float64)
    kind = stamp.dtype.kind
    if kind not in "iuf":
        raise MotionError(f"stamps are of type {stamp.dtype}: give integer nanoseconds or float seconds")
    stamp = np.ascontiguousarray(stamp, dtype=np.float64 if kind == "f" else np.int64)
    if stamp.ndim != 1 or angle.shape != stamp.shape:
        raise MotionError(
            f"{stamp.size} stamps (shape {stamp.shape}) but {angle.size} angles (shape {angle.shape}): "
            "give one stamp per angle"
        )
    velocity = np.zeros(0) if velocities is None else np.ascontiguousarray(velocities, dtype=np.float64)
    if velocity.size and velocity.shape != stamp.shape:
        raise MotionError(f"{stamp.size} stamps but {velocity.size} velocities: give one per angle, or none")
    return stamp, angle, velocity


def joined(parts: list[Part]) -> Part:
    """Join stamps and rows of all parts; empties the list meanwhile, as the rows of hours are large."""
    if len(parts) == 1:
        return parts.pop()
    count = sum(stamps.size for stamps, _ in parts)
    stamps, rows = np.empty(count, parts[0][0].dtype), records(ROW, count)
    while parts:
        stamp, part = parts.pop()
        stamps[count - stamp.size : count], rows[count - stamp.size : count] = stamp, part
        count -= stamp.size
    return stamps, rows


def states_of(parts: list[Part]) -> ShaftStates:
    """Return the states of the rows, without the first two samples of a record, which have none."""
    stamps, rows = joined(parts)
    first = int(np.count_nonzero(rows["settled"][:2] < 0.0))
    return ShaftStates(stamps[first:], rows[first:])


def _ripple_amplitudes(record: Records) -> FloatArray:
    """Return the amplitude of the speed's ripple in each order of the leading model, relative to the speed."""
    bank = record["bank"][0]
    models = bank["models"]
    model = int(models["leading"])
    waves, best = int(models["waves"][model]), int(models["best"][model])
    ripple = bank["filters"]["ripple"][: 2 * waves, best] - models["sensor_ripple"][model][: 2 * waves]
    cosines, sines = ripple.reshape(-1, 2).T
    return np.asarray(np.hypot(cosines, sines) * bank["wave"]["lowest"] * np.arange(1, waves + 1))
