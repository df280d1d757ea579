"""Canvas for a plot over the shaft angle. The viewer plots over time only, and in its 2D views y points down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray

TWO_PI = 2.0 * np.pi

#: Width and height of the canvases, with the aspect ratio of the views that they fill.
TORQUE_SIZE = (720.0, 430.0)
RESIDUAL_SIZE = (720.0, 560.0)


@dataclass(frozen=True, slots=True)
class AngleCanvas:
    """Map of (shaft angle, value) onto a canvas of `width` x `height` units, origin at the top left.

    Attributes:
        low, high: Values at the lower and the upper edge of the canvas.
        width, height: Size of the canvas; the viewer preserves its aspect ratio.
    """

    low: float
    high: float
    width: float
    height: float

    def place(self, theta_rad: FloatArray, value: FloatArray) -> FloatArray:
        """Return the canvas points (n, 2) of angles (n,) [rad] and values (n,); angles are wrapped to one turn."""
        return np.column_stack([self.x(theta_rad), self.y(value)])

    def x(self, theta_rad: FloatArray) -> FloatArray:
        """Return the canvas x of angles [rad]."""
        return np.asarray(np.mod(theta_rad, TWO_PI) * (self.width / TWO_PI))

    def y(self, value: FloatArray) -> FloatArray:
        """Return the canvas y of values; larger values stand higher."""
        return np.asarray((self.high - value) * (self.height / (self.high - self.low)))


def round_ticks(low: float, high: float, about: int) -> list[float]:
    """Return tick values in steps of 1, 2 or 5 times a power of ten within low .. high, `about` this many."""
    rough = (high - low) / max(about, 1)
    power = 10.0 ** np.floor(np.log10(rough))
    step = float(next(k * power for k in (1.0, 2.0, 5.0, 10.0) if k * power >= rough * (1.0 - 1e-9)))
    first = np.ceil(low / step - 1e-9)
    return [float(k * step) for k in np.arange(first, np.floor(high / step + 1e-9) + 1.0)]


def canvas_for(values: Sequence[FloatArray], width: float, height: float) -> AngleCanvas:
    """Build a canvas that holds all finite values and zero, with a margin above and below."""
    finite = np.concatenate([*(v[np.asarray(np.isfinite(v))] for v in values), np.zeros(1)])
    low, high = float(finite.min()), float(finite.max())
    room = 0.08 * max(high - low, 1e-3)
    return AngleCanvas(low - room, high + room, width, height)


def split_turns(theta_rad: FloatArray, points: FloatArray) -> list[FloatArray]:
    """Split a line of canvas points (n, 2) where the angle passes a full turn or a point is not finite."""
    return [points[first:end] for first, end in zip(*line_ends(theta_rad, points, len(points)), strict=True)]


def line_ends(theta_rad: FloatArray, points: FloatArray, length: int) -> tuple[IntArray, IntArray]:
    """Find the lines of at most `length` steps among canvas points (n, 2), as indices [first, end), each (k,).

    Lines are cut after each `length` steps, where the next one begins at the same point, and split as by `split_turns`.
    """
    turn = np.floor(theta_rad / TWO_PI)
    bad: BoolArray = np.asarray(np.isnan(points).any(axis=1))
    breaks = np.flatnonzero((np.diff(turn) != 0.0) | bad[1:] | bad[:-1]) + 1
    cuts = np.setdiff1d(np.arange(length, len(points) - 1, length), breaks)
    places, ends = np.concatenate([breaks, cuts]), np.concatenate([breaks, cuts + 1])
    order = np.argsort(places)
    first, end = np.append(0, places[order]), np.append(ends[order], len(points))
    line = end - first > 1
    return first[line], end[line]
