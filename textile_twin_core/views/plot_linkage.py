"""A sketch of the linkage: links, pins, paths of the points, and the backing where there is one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from textile_twin_core.arrays import FloatArray
from textile_twin_core.views import paper
from textile_twin_core.views.scene import MachineScene, PointPositions
from textile_twin_core.views.travels import foremost

if TYPE_CHECKING:
    from textile_twin_core.machine.machine import Machine

_PATH = "#b9c0c9"


def draw_linkage(axes: Axes, scene: MachineScene, machine: Machine) -> None:
    """Draw the linkage at its deepest point; where there is none at theta = 0, or amid a part of the turn."""
    deepest = (angle for measure in machine.measures for angle in foremost(machine, measure.name))
    theta = next(deepest, float(machine.shaft_angles(1)[0]))
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
        if part.length_m > 0.05 * scene.size_m:
            middle = 0.5 * (start + end)
            axes.annotate(
                part.name, middle, (9, 3), textcoords="offset points", fontsize=10.5, color=paper.INK, zorder=6
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
        away = 17.0 * _outward(name, scene, points)
        axes.annotate(
            name,
            place,
            (float(away[0]), float(away[1])),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=12,
            weight="bold",
            color=paper.INK,
            zorder=6,
        )
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.margins(0.1, 0.07)
    axes.set_title(f"Linkage at {np.rad2deg(theta):.1f}°", loc="left", fontsize=13, color=paper.INK, pad=12)


def _draw_cam(
    axes: Axes, outlines: tuple[FloatArray, ...], axis: FloatArray, along: FloatArray, colour: tuple[float, ...]
) -> None:
    """A cam's outlines, turned as its link is, the conjugate cam paler and behind."""
    u = along / np.hypot(*along)
    for k, outline in enumerate(outlines):
        places = axis + outline @ np.array([u, [-u[1], u[0]]])
        axes.fill(*places.T, facecolor=(*colour, 0.35 / (k + 1)), edgecolor=colour, linewidth=2.2, zorder=2.5 - 0.1 * k)


def _outward(name: str, scene: MachineScene, points: dict[str, FloatArray]) -> FloatArray:
    """Direction from a point away from the links that meet there, for its letter."""
    total = np.zeros(2)
    for part in scene.moving:
        if name in (part.start, part.end):
            other = points[part.end if name == part.start else part.start]
            along = points[name] - other
            total += along / max(float(np.hypot(*along)), 1e-12)
    size = float(np.hypot(*total))
    return total / size if size > 0.3 else np.array([0.0, 1.0])
