"""Offline shaft estimation: the whole record at once, each state seeing the samples before and after it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray
from textile_twin_core.shaft.encoder import encoder_step
from textile_twin_core.shaft.fitting import ChunkFit
from textile_twin_core.shaft.gate import Accepted, SampleGate
from textile_twin_core.shaft.record import Stretch, edges, stretches
from textile_twin_core.shaft.report import SampleReport
from textile_twin_core.shaft.settings import SmoothSettings
from textile_twin_core.shaft.states import ShaftStates
from textile_twin_core.shaft.turns import TURN

CHUNK = 6144
OVERLAP = 512
SAMPLES_PER_WAVE = 4.0
"""Samples that a wave of ripple must have to be looked for."""
COARSE = 2.0
"""Steps larger than this many sigmas of the noise are taken as the intervals that they are."""
FIRST_JITTER_S = 20e-6
FEWEST = 24
"""Samples below which nothing but a straight line is fitted."""


class SmoothEstimator:
    """Fits the whole record in overlapping chunks at `finish` (see `chunk` for the model, `fitting` for the course).

    Args:
        settings: fields of `SmoothSettings`.

    Raises:
        SceneError: a setting of the wrong kind or value.
        TypeError: a setting that does not exist.
    """

    def __init__(self, **settings: Any) -> None:
        self._settings = SmoothSettings(**settings)
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
        settings = self._settings
        encoder = settings.step_rad
        if encoder is None:
            encoder = encoder_step(raw[:4096], settings.period_rad) or 0.0
        rows, covariance = np.zeros((count, 5)), np.zeros((count, 3, 3))
        for part in stretches(step, raw, settings.wrapping, settings.period_rad, settings.gap_s, self._report):
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
        settings = self._settings
        jitter = FIRST_JITTER_S if settings.stamp_jitter_s is None else settings.stamp_jitter_s
        when, what, variance, noise = edges(time[good] - start, angle[good] - shift, encoder, jitter)
        turns = abs(float(angle[-1] - angle[0])) / TURN
        most = settings.max_harmonics if turns > 2.0 else settings.harmonics if turns > 1.0 else 0
        speed = float(np.median(np.abs(np.diff(what)) / np.diff(when))) if what.size > 1 else 0.0
        scale = max(speed, abs(float(angle[-1] - angle[0])) / float(time[-1] - time[0]), 0.5)
        chunk = ChunkFit(
            when, what, variance, np.arange(1, most + 1), min(settings.harmonics, most), scale**2, settings.response_s
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
