"""Solid shapes for the picture of a machine: outlines extruded into flat-shaded triangles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.views.palette import Colour

Points = Sequence[tuple[float, float]] | FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """Triangle mesh: vertices and normals (n, 3) in metres, colours (n, 3), triangles (t, 3)."""

    vertices: FloatArray
    normals: FloatArray
    colours: npt.NDArray[np.uint8]
    triangles: IntArray

    def turned(self, x: Sequence[float], y: Sequence[float], z: Sequence[float]) -> Solid:
        """Return the solid with its axes turned to the orthonormal x, y, z."""
        axes = np.array([x, y, z], dtype=np.float64)
        return Solid(self.vertices @ axes, self.normals @ axes, self.colours, self.triangles)

    def moved(self, by: Sequence[float]) -> Solid:
        """Return the solid shifted by (x, y, z) [m]."""
        return Solid(self.vertices + np.asarray(by, dtype=np.float64), self.normals, self.colours, self.triangles)


def join(solids: Sequence[Solid]) -> Solid:
    """Join several solids into one."""
    starts = np.cumsum([0, *(solid.vertices.shape[0] for solid in solids)])
    return Solid(
        np.concatenate([solid.vertices for solid in solids]),
        np.concatenate([solid.normals for solid in solids]),
        np.concatenate([solid.colours for solid in solids]),
        np.concatenate([solid.triangles + start for solid, start in zip(solids, starts, strict=False)]),
    )


def extrude(
    outline: Points,
    z0: float,
    z1: float,
    colour: Colour,
    end_scale: float = 1.0,
    centre: tuple[float, float] | None = None,
) -> Solid:
    """Extrude a counter-clockwise outline (n, 2) from z0 to z1, scaled by `end_scale` at z1.

    The end faces are fans about `centre`, from which the whole outline must be visible; the default is the mean of the
    outline, which suits every convex one.
    """
    base = np.asarray(outline, dtype=np.float64)
    middle = base.mean(axis=0) if centre is None else np.asarray(centre, dtype=np.float64)
    top = middle + end_scale * (base - middle)
    n = base.shape[0]
    low = np.column_stack([base, np.full(n, z0)])
    high = np.column_stack([top, np.full(n, z1)])
    fan = np.array([(n, k, (k + 1) % n) for k in range(n)], dtype=np.int64)
    vertices = [high, np.array([(*middle, z1)]), low, np.array([(*middle, z0)])]
    normals = [np.tile([0.0, 0.0, side], (n + 1, 1)) for side in (1.0, -1.0)]
    triangles = [fan, fan[:, ::-1] + n + 1]
    count = 2 * (n + 1)
    for k in range(n):
        j = (k + 1) % n
        quad = np.array([low[k], low[j], high[j], high[k]])
        normal = np.cross(quad[1] - quad[0], quad[3] - quad[0])
        size = float(np.linalg.norm(normal))
        vertices.append(quad)
        normals.append(np.tile(normal / size if size > 0.0 else normal, (4, 1)))
        triangles.append(np.array([(0, 1, 2), (0, 2, 3)], dtype=np.int64) + count)
        count += 4
    return Solid(
        np.concatenate(vertices),
        np.concatenate(normals),
        np.tile(np.array(colour, dtype=np.uint8), (count, 1)),
        np.concatenate(triangles),
    )


def circle(radius: float, sides: int = 40) -> FloatArray:
    """Return the outline of a circle about (0, 0)."""
    angle = np.arange(sides) * (2.0 * np.pi / sides)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def stadium(length: float, radius: float, sides: int = 20) -> FloatArray:
    """Return the outline of a bar with round ends, centred on (0, 0) and (length, 0)."""
    half = np.linspace(-0.5 * np.pi, 0.5 * np.pi, sides)
    right = np.column_stack([length + radius * np.cos(half), radius * np.sin(half)])
    left = np.column_stack([-radius * np.cos(half), -radius * np.sin(half)])
    return np.concatenate([right, left])


def rectangle(x0: float, x1: float, y0: float, y1: float) -> FloatArray:
    """Return the outline of a rectangle."""
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
