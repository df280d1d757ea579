"""Offline shaft estimation: the whole record at once, each state seeing the samples before and after it."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray
from textile_twin_core.shaft.encoder import encoder_step
from textile_twin_core.shaft.fitting import ChunkFit
from textile_twin_core.shaft.gate import Accepted, SampleGate
from textile_twin_core.shaft.record import Stretch, edges, stretches
from textile_twin_core.shaft.report import SampleReport
from textile_twin_core.shaft.states import ShaftStates
from textile_twin_core.shaft.turns import TURN

CHUNK = 6144
OVERLAP = 512
COARSE = 2.0
"""Steps larger than this many sigmas of the noise are taken as the intervals that they are."""
FEWEST = 24
"""Samples below which nothing but a straight line is fitted."""


class SmoothEstimator:
    """Fits the whole record in overlapping chunks at `finish` (see `chunk` for the model, `fitting` for the course).

    Args:
        harmonics: orders of ripple that are in the model whatever the data say.
        max_harmonics: orders looked at.
        encoder_bits: bits of the encoder per turn; None: found.
        resolution_rad: or its step.
        stamp_jitter_s: standard deviation of the stamps, to begin with; it is fitted.
        response_s: time constant of the drive's answer to a load knock, to begin with; it is fitted.
        wrapping: "auto", "wrapped" or "unwrapped".
        period_rad: what a wrapping angle wraps by.
        gap_s: pause at which the record is cut.
    """

    def __init__(
        self,
        *,
        harmonics: int = 2,
        max_harmonics: int = 8,
        encoder_bits: float | None = None,
        resolution_rad: float | None = None,
        stamp_jitter_s: float | None = None,
        response_s: float = 0.04,
        wrapping: str = "auto",
        period_rad: float = TURN,
        gap_s: float = 1.0,
    ) -> None:
        self._harmonics, self._most = harmonics, max_harmonics
        self._step = period_rad / 2.0**encoder_bits if encoder_bits is not None else resolution_rad
        self._jitter = 20e-6 if stamp_jitter_s is None else stamp_jitter_s
        self._response = response_s
        self._wrapping, self._period, self._gap = wrapping, period_rad, gap_s
        self.reset()

    def reset(self) -> None:
        """Forget everything, the report included."""
        self._report = SampleReport()
        self._gate = SampleGate(self._report)
        self._blocks: list[Accepted] = []

    @property
    def report(self) -> SampleReport:
        """Counts of what came in and what became of it."""
        return self._report

    def step(
        self, stamps: npt.ArrayLike, angles: npt.ArrayLike, velocities: npt.ArrayLike | None = None
    ) -> ShaftStates:
        """Take a block of samples; no state is ready before `finish`. See `ShaftEstimator.step`."""
        block = self._gate.admit(stamps, angles, velocities)
        self._blocks.append(block)
        return ShaftStates.empty(block.stamps)

    def finish(self) -> ShaftStates:
        """The states of all samples from the third on."""
        blocks, self._blocks = self._blocks, []
        count = sum(len(block) for block in blocks)
        if count < 3:
            return ShaftStates.empty(blocks[0].stamps if blocks else None)
        stamps = np.concatenate([block.stamps for block in blocks])
        index = np.concatenate([block.index for block in blocks])
        step = np.concatenate([block.step_s for block in blocks])
        raw = np.concatenate([block.angles for block in blocks])
        step[0] = 0.0
        encoder = self._step if self._step is not None else (encoder_step(raw[:4096], self._period) or 0.0)
        rows, covariance = np.zeros((count, 5)), np.zeros((count, 3, 3))
        for part in stretches(step, raw, self._wrapping, self._period, self._gap, self._report):
            own = slice(part.start, part.start + part.time.size)
            states, spread, settled = self._fit(part, encoder)
            rows[own, :3], rows[own, 3], rows[own, 4] = states, part.origin, settled
            covariance[own] = spread
        self._report.resolution_rad = encoder
        self._report.period_s = float(np.median(step[1:]))
        self._report.state = "running"
        return ShaftStates.from_rows(stamps[2:], index[2:], rows[2:], covariance[2:])

    def _fit(self, part: Stretch, encoder: float) -> tuple[FloatArray, FloatArray, float]:
        count = part.time.size
        if np.count_nonzero(part.good) < FEWEST:
            return (*_line(part, encoder), 0.0)
        states, covariance = np.zeros((count, 3)), np.zeros((count, 3, 3))
        pieces = max(1, math.ceil((count - OVERLAP) / CHUNK))
        size = math.ceil((count - OVERLAP) / pieces) if pieces > 1 else count
        filled = 0
        for piece in range(pieces):
            first = piece * size
            end = count if piece == pieces - 1 else min(first + size + OVERLAP, count)
            try:
                own, spread = self._chunk(part, first, end, encoder)
            except np.linalg.LinAlgError:  # readings that follow no motion at all
                own, spread = _line(part.between(first, end), encoder)
            fade = np.clip((np.arange(first, end) - first + 1.0) / (filled - first + 1.0), 0.0, 1.0)
            if filled <= first:
                fade[:] = 1.0
            states[first:end] += fade[:, None] * (own - states[first:end])
            covariance[first:end] += fade[:, None, None] * (spread - covariance[first:end])
            filled = end
        return states, covariance, 1.0

    def _chunk(self, part: Stretch, first: int, end: int, encoder: float) -> tuple[FloatArray, FloatArray]:
        """States and covariance of the samples from `first` to `end` of a stretch."""
        time, angle = part.time[first:end], part.angle[first:end]
        good = part.good[first:end]
        shift = TURN * round(float(angle[0]) / TURN)
        start = float(time[0])
        when, what, variance, noise = edges(time[good] - start, angle[good] - shift, encoder, self._jitter)
        turns = abs(float(angle[-1] - angle[0])) / TURN
        most = self._most if turns > 2.0 else self._harmonics if turns > 1.0 else 0
        speed = float(np.median(np.abs(np.diff(what)) / np.diff(when))) if what.size > 1 else 0.0
        scale = max(speed, abs(float(angle[-1] - angle[0])) / float(time[-1] - time[0]), 0.5)
        chunk = ChunkFit(
            when, what, variance, np.arange(1, most + 1), min(self._harmonics, most), scale**2, self._response
        )
        chunk.fit()
        spread = max(float(np.median(chunk.variance)) - encoder**2 / 12.0, 0.0)
        coarse = encoder**2 > COARSE**2 * noise
        if np.mean(coarse) > 0.5:
            spread = chunk.sharpen(encoder, noise + (0.02 * encoder) ** 2, coarse) or spread
        self._report.knocks += chunk.knock_times.size
        self._report.stamp_jitter_s = math.sqrt(spread) / scale
        amplitude = np.hypot(chunk.ripple[0::2], chunk.ripple[1::2])
        ripple = dict(zip(chunk.orders.tolist(), amplitude.tolist(), strict=True))
        self._report.ripple = tuple(ripple.get(k, 0.0) for k in range(1, max(ripple, default=0) + 1))
        inside = np.clip(time - start, chunk.knots.breaks[0], chunk.knots.breaks[-1])
        states, covariance = chunk.states(inside, angle - shift)
        states[:, 0] += shift
        return states, covariance


def _line(part: Stretch, encoder: float) -> tuple[FloatArray, FloatArray]:
    """States of a stretch too short for more than a straight line."""
    count = part.time.size
    middle = part.time - part.time.mean()
    power = float(middle @ middle)
    good = part.good if part.good.any() else np.ones(count, dtype=bool)
    speed = float(middle[good] @ (part.angle[good] - part.angle[good].mean())) / power if power > 0 else 0.0
    states = np.zeros((count, 3))
    states[:, 0] = part.angle[good].mean() + speed * (part.time - part.time[good].mean())
    states[:, 1] = speed
    noise = max(encoder**2 / 12.0, 1e-6)
    covariance = np.zeros((count, 3, 3))
    covariance[:, 0, 0] = noise
    covariance[:, 1, 1] = noise / power + (0.1 * speed) ** 2 if power > 0 else 1e4
    covariance[:, 2, 2] = max(speed * speed, 1.0)
    return states, covariance
