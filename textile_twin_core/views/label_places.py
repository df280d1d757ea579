"""Places for the labels of a drawing, clear of lines, pins and other labels."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes

from textile_twin_core.arrays import FloatArray

_LETTER, _LINE = 0.62, 1.25
"""Width of a letter and height of a line, over the font size."""
_STEP = 4.0
_ALONG = (0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8)
_ON_LABEL = 1000.0


class LabelPlaces:
    """Placement of labels one after the other; each placed label blocks its place for later ones.

    Args:
        axes: Axes with everything drawn but the labels.
        lines: Ends (2, 2) of each line, in data units.
        radius: Half the width of a line [points].
    """

    def __init__(self, axes: Axes, lines: Iterable[FloatArray], radius: float) -> None:
        axes.figure.draw_without_rendering()  # type: ignore[union-attr]  # sets the scale
        self._axes, self._scale, self._radius = axes, 72.0 / axes.figure.dpi, radius
        self._occupied = np.concatenate([self._along(line) for line in lines] or [np.empty((0, 2))])
        self._boxes: list[tuple[FloatArray, FloatArray]] = []

    def beside_line(self, text: str, size: float, line: FloatArray) -> FloatArray:
        """Return the middle of a label beside a line (2, 2), in points from the middle of the line."""
        start, end = self._points(line)
        along = (end - start) / max(float(np.hypot(*(end - start))), 1e-9)
        across = np.array([-along[1], along[0]])
        half = _half(text, size)
        away = self._radius + 3.0 + float(np.abs(across) @ half)
        candidates = [start + share * (end - start) + side * away * across for share in _ALONG for side in (-1.0, 1.0)]
        return np.asarray(self._choose(candidates, half) - 0.5 * (start + end))

    def around_point(self, text: str, size: float, place: FloatArray, outward: FloatArray, away: float) -> FloatArray:
        """Return the middle of a label near a point (2,), in points from it; outward where that place is free."""
        (middle,) = self._points(place[None])
        begin = np.arctan2(outward[1], outward[0])
        turns = sorted(np.linspace(-np.pi, np.pi, 16, endpoint=False), key=abs)
        candidates = [middle + away * np.array([np.cos(begin + turn), np.sin(begin + turn)]) for turn in turns]
        return np.asarray(self._choose(candidates, _half(text, size)) - middle)

    def _choose(self, candidates: Sequence[FloatArray], half: FloatArray) -> FloatArray:
        costs = [self._cost(middle, half) + 0.01 * number for number, middle in enumerate(candidates)]
        best = candidates[int(np.argmin(costs))]
        self._boxes.append((best, half))
        return best

    def _cost(self, middle: FloatArray, half: FloatArray) -> float:
        on_lines = int((np.abs(self._occupied - middle) < half + self._radius).all(axis=1).sum())
        on_labels = sum(bool((np.abs(other - middle) < half + its).all()) for other, its in self._boxes)
        return on_lines + _ON_LABEL * on_labels

    def _points(self, places: FloatArray) -> FloatArray:
        return np.asarray(self._axes.transData.transform(places) * self._scale)

    def _along(self, line: FloatArray) -> FloatArray:
        start, end = self._points(line)
        count = 2 + int(np.hypot(*(end - start)) / _STEP)
        return np.asarray(start + np.linspace(0.0, 1.0, count)[:, None] * (end - start))


def _half(text: str, size: float) -> FloatArray:
    return np.array([0.5 * _LETTER * size * len(text), 0.5 * _LINE * size])
