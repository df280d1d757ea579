"""A whole record of angle samples made ready for fitting: unwrapped, cut at gaps and jumps, weighed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.shaft.gate import SPAN_OF_WRAPPED
from textile_twin_core.shaft.report import SampleReport
from textile_twin_core.shaft.turns import TURN, split_turns

NEIGHBOURS = 10
LEAP_RAD = 0.05
FASTEST_CHANGE_HZ = 60.0


@dataclass(frozen=True)
class Stretch:
    """Samples without gap or jump.

    Attributes:
        time: (n,) [s] since the first sample of the record.
        angle: (n,) [rad] without wraps, from `origin` turns on.
        good: (n,) False for outliers.
        origin: whole turns before the local angle.
        start: place of the first sample in the record.
    """

    time: FloatArray
    angle: FloatArray
    good: BoolArray
    origin: int
    start: int

    def between(self, first: int, end: int) -> Stretch:
        """The samples from `first` to `end`."""
        own = slice(first, end)
        return Stretch(self.time[own], self.angle[own], self.good[own], self.origin, self.start + first)


def stretches(
    step: FloatArray, raw: FloatArray, wrapping: str, period: float, gap_s: float, report: SampleReport
) -> list[Stretch]:
    """Cut a record into stretches of continuous motion.

    Args:
        step: (n,) time since the sample before [s]; 0 first.
        raw: (n,) accepted readings [rad].
        wrapping: "auto", "wrapped" or "unwrapped".
        period: what a wrapping angle wraps by [rad].
        gap_s: shortest gap.
        report: counts of gaps, jumps, outliers are added here.
    """
    time = np.cumsum(step)
    turns, phase = split_turns(raw)
    base = int(turns[0])
    local = phase + (turns - base) * TURN
    wrapped = wrapping == "wrapped" or (wrapping == "auto" and float(np.ptp(raw)) <= SPAN_OF_WRAPPED * period)
    typical = float(np.median(step[1:]))
    gaps = step > max(gap_s, 10.0 * typical)
    gaps[0] = True
    move = np.diff(local, prepend=local[0])
    if wrapped:
        move = _unwrapped(move, step, period)
    speed = _middle(np.where(step > 0, move / np.where(step > 0, step, 1.0), np.nan))
    reach = LEAP_RAD + 0.5 * np.abs(speed) * step + 0.5 * FASTEST_CHANGE_HZ * np.nanmax(np.abs(speed)) * step**2
    leaps = (np.abs(move - speed * step) > reach) & ~gaps
    good = np.ones(raw.size, dtype=bool)
    lasting = leaps.copy()
    for i in np.flatnonzero(leaps).tolist():
        if not lasting[i]:
            continue
        for back in range(i + 1, min(i + 4, raw.size)):
            if leaps[back] and abs(
                float(np.sum(move[i : back + 1] - speed[i : back + 1] * step[i : back + 1]))
            ) < float(reach[i : back + 1].sum()):
                lasting[i : back + 1] = False
                good[i:back] = False
                report.outliers += back - i
                break
    report.gaps += int(np.count_nonzero(gaps)) - 1
    report.jumps += int(np.count_nonzero(lasting))
    cuts = np.flatnonzero(gaps | lasting)
    angle = local[0] + np.cumsum(move)
    parts = []
    for first, end in zip(cuts.tolist(), [*cuts[1:].tolist(), raw.size], strict=True):
        shift = round(float(angle[first]) / TURN)
        own = angle[first:end] - shift * TURN
        parts.append(Stretch(time[first:end], own, good[first:end], base + shift, first))
    return parts


def _unwrapped(move: FloatArray, step: FloatArray, period: float) -> FloatArray:
    """Moves between samples, each by the whole number of periods that the speed around it tells."""
    near = move - period * np.rint(move / period)
    for _ in range(2):
        expected = np.nan_to_num(_middle(np.where(step > 0, near / np.where(step > 0, step, 1.0), np.nan))) * step
        near = move - period * np.rint((move - expected) / period)
    return near


def _middle(values: FloatArray) -> FloatArray:
    """Running median over the neighbours on both sides; NaN are left out."""
    width = 2 * NEIGHBOURS + 1
    if values.size <= width:
        return np.full(values.size, np.nanmedian(values) if np.isfinite(values).any() else 0.0)
    padded = np.concatenate([values[NEIGHBOURS:0:-1], values, values[-2 : -NEIGHBOURS - 2 : -1]])
    windows = np.lib.stride_tricks.sliding_window_view(padded, width)
    middle = np.empty(values.size)
    for first in range(0, values.size, 65536):  # in pieces, for memory
        piece = windows[first : first + 65536]
        middle[first : first + 65536] = np.partition(np.nan_to_num(piece), NEIGHBOURS, axis=1)[:, NEIGHBOURS]
    return middle


def edges(
    time: FloatArray, angle: FloatArray, step: float, jitter: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Readings as (time, angle, variance, noise) data; the noise is the variance without the rounding to steps.

    While the shaft turns by several encoder steps per sample a reading is as good as its step over root 12. Where it
    turns by less, what is known well is when the count changed: the edge between two counts lies between two samples.
    """
    place = np.arange(time.size)
    tick = np.diff(time, prepend=time[0])
    typical = max(float(np.median(tick)), 1e-9)
    reach = max(5, int(0.05 / typical))
    after, before = np.minimum(place + reach, time.size - 1), np.maximum(place - reach, 0)
    speed = np.abs(angle[after] - angle[before]) / np.maximum(time[after] - time[before], 1e-9)
    noise = (speed * jitter) ** 2
    variance = step**2 / 12.0 + noise
    slow = speed * tick < 0.5 * step
    if not slow.any():
        return time, angle, np.maximum(variance, 1e-14), noise
    change = np.diff(angle, prepend=angle[0])
    edge = slow & (np.abs(np.abs(change) - step) < 0.5 * step)
    when, what = time.copy(), angle.copy()
    when[edge] -= tick[edge] / 2.0
    what[edge] -= change[edge] / 2.0
    variance[edge] = (speed[edge] * tick[edge]) ** 2 / 12.0 + noise[edge] + (0.02 * step) ** 2
    # Between the edges many readings of one count know no more than one does: keep few of them.
    kept = ~slow | edge | (place % (2 * reach) == 0)
    noise[slow] = variance[slow]
    return when[kept], what[kept], np.maximum(variance[kept], 1e-14), noise[kept]
