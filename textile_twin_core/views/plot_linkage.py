"""Sketch of the linkage: links, pins, paths of the points, and the backing where there is one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes

from textile_twin_core.arrays import FloatArray
from textile_twin_core.views import paper
from textile_twin_core.views.scene import MachineScene, PointPositions

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


if TYPE_CHECKING:
    from textile_twin_core.machine.machine import Machine

_PATH = "#b9c0c9"
_ANGLES = 72
_COVERED = 0.01
"""Regularisation of the logarithm of a distance, over the size of the machine."""


def draw_linkage(axes: Axes, scene: MachineScene, machine: Machine, theta_rad: float | None = None) -> None:
    """Draw the linkage at a shaft angle [rad]; by default at the angle where its links cover each other least."""
    theta = clearest_angle(machine, scene) if theta_rad is None else theta_rad
    points = {name: place[0] for name, place in PointPositions(machine)(np.array([theta])).items()}
    for path in scene.paths.values():
        axes.plot(path[:, 0], path[:, 1], color=_PATH, linewidth=1.0, zorder=1)
    if scene.backing is not None:
        (x, y), (dx, dy) = scene.backing.point_m, scene.backing.direction
        u, v = 0.12 * scene.size_m * -dy, 0.12 * scene.size_m * dx
        axes.plot([x - u, x + u], [y - v, y + v], color=paper.BACKING, linewidth=5, zorder=2)
        axes.annotate(
            "backing",
            (x - abs(u), y - abs(v)),
            (-4, 8),
            textcoords="offset points",
            color=paper.BACKING,
            ha="right",
            fontsize=11,
        )
    for part in scene.moving:
        start, end = points[part.start], points[part.end]
        colour = tuple(channel / 255.0 * 0.88 for channel in part.colour)
        wide = 9.0 if part.length_m < 0.6 * scene.size_m else 5.0
        if part.outlines:
            _draw_cam(axes, part.outlines, start, end - start, colour)
        if not part.is_cam:
            axes.plot(
                [start[0], end[0]], [start[1], end[1]], color=colour, linewidth=wide, solid_capstyle="round", zorder=3
            )
    for name, place in points.items():
        fixed = name in scene.fixed_points
        axes.plot(
            *place,
            "s" if fixed else "o",
            color="white",
            markersize=11 if fixed else 7,
            zorder=4 if fixed else 5,
            markeredgecolor=paper.INK,
            markeredgewidth=1.6,
        )
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.margins(0.1, 0.07)
    axes.set_title(f"Linkage at {np.rad2deg(theta):.1f}°", loc="left", fontsize=13, color=paper.INK, pad=8)
    _label(axes, scene, points)


def clearest_angle(machine: Machine, scene: MachineScene) -> float:
    """Find the shaft angle [rad] that maximises the sum of log distances between pins and the links they are not on."""
    theta = machine.shaft_angles(_ANGLES)
    points = PointPositions(machine)(theta)
    clearness = np.zeros(theta.size)
    for part in scene.moving:
        start, along = points[part.start], points[part.end] - points[part.start]
        for name, place in points.items():
            if name not in (part.start, part.end):
                size = np.maximum(np.sum(along**2, axis=1), 1e-300)
                share = np.clip(np.sum((place - start) * along, axis=1) / size, 0.0, 1.0)
                distance = np.hypot(*(place - start - share[:, None] * along).T)
                clearness += np.log(distance / scene.size_m + _COVERED)
    return float(theta[np.nanargmax(clearness)])


def _label(axes: Axes, scene: MachineScene, points: dict[str, FloatArray]) -> None:
    """Write letters at the pins and names beside the links."""
    lines = {part.name: np.array([points[part.start], points[part.end]]) for part in scene.moving}
    places = LabelPlaces(axes, lines.values(), radius=5.0)
    common: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "va": "center"}
    common |= {"color": paper.INK, "zorder": 6}
    for name, place in points.items():
        away = places.around_point(name, 12.0, place, _outward(name, scene, points), 17.0)
        axes.annotate(name, (place[0], place[1]), tuple(away), fontsize=12, weight="bold", **common)
    for part in scene.moving:
        if part.length_m > 0.05 * scene.size_m:
            away = places.beside_line(part.name, 10.5, lines[part.name])
            x, y = lines[part.name].mean(axis=0)
            axes.annotate(part.name, (x, y), tuple(away), fontsize=10.5, **common)


def _draw_cam(
    axes: Axes, outlines: tuple[FloatArray, ...], axis: FloatArray, along: FloatArray, colour: tuple[float, ...]
) -> None:
    """Draw the outlines of a cam, turned with its link; a conjugate cam is paler and behind."""
    u = along / np.hypot(*along)
    for k, outline in enumerate(outlines):
        places = axis + outline @ np.array([u, [-u[1], u[0]]])
        axes.fill(*places.T, facecolor=(*colour, 0.35 / (k + 1)), edgecolor=colour, linewidth=2.2, zorder=2.5 - 0.1 * k)


def _outward(name: str, scene: MachineScene, points: dict[str, FloatArray]) -> FloatArray:
    """Return the direction from a point away from the links that meet there, for its letter."""
    total = np.zeros(2)
    for part in scene.moving:
        if name in (part.start, part.end):
            other = points[part.end if name == part.start else part.start]
            along = points[name] - other
            total += along / max(float(np.hypot(*along)), 1e-12)
    size = float(np.hypot(*total))
    return total / size if size > 0.3 else np.array([0.0, 1.0])
