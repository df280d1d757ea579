"""What the page hands out: curves as CSV, linkage and curves as PNG or SVG, the linkage as DXF."""

from __future__ import annotations

import csv
import io
import math

import numpy as np
from ezdxf.filemanagement import new as new_drawing
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from textile_twin_core.explore.shown import Analysis

_INK, _FAINT, _COLOURS = "#22272e", "#c8ced6", ("#0072b2", "#e07b00", "#2a9d63", "#c2377a", "#6b7480", "#8a63d2")
_MILLI = 1e3


def as_csv(analysis: Analysis) -> str:
    """Every curve over the shaft angle, in the units of the page."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    columns = {f"{c.title}: {name} [{c.unit}]": v for c in analysis.charts for name, v in c.curves.items()}
    columns |= {
        f"{name} {axis} [mm]": _MILLI * p[k] for name, p in analysis.points.items() for k, axis in enumerate("xy")
    }
    writer.writerow(["shaft angle [deg]", *columns])
    for angle, *row in zip(np.degrees(analysis.theta_rad), *columns.values(), strict=True):
        writer.writerow([f"{angle:.6g}", *(f"{value:.9g}" for value in row)])
    return out.getvalue()


def as_picture(analysis: Analysis, title: str, angle_rad: float, kind: str) -> bytes:
    """The linkage at a shaft angle and all curves, as a `png` or `svg` of one page."""
    rows = len(analysis.charts)
    figure = Figure(figsize=(11.0, max(4.5, 1.7 * rows)), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(rows, 2, width_ratios=[1.0, 1.2])
    linkage = figure.add_subplot(grid[:, 0])
    k = _sample(analysis, angle_rad)
    for name, (x, y) in analysis.points.items():
        if name not in analysis.fixed:
            linkage.plot(_MILLI * x, _MILLI * y, color=_FAINT, lw=0.9)
    for bar in analysis.bars:
        (ax, ay), (bx, by) = analysis.points[bar.start], analysis.points[bar.end]
        linkage.plot([_MILLI * ax[k], _MILLI * bx[k]], [_MILLI * ay[k], _MILLI * by[k]], color=_INK, lw=2.2)
    for name, (x, y) in analysis.points.items():
        face = _INK if name in analysis.fixed else "white"
        linkage.plot(_MILLI * x[k], _MILLI * y[k], "o", color=_INK, mfc=face, ms=5)
        linkage.annotate(name, (_MILLI * x[k], _MILLI * y[k]), (4, 4), textcoords="offset points", fontsize=8)
    linkage.set_aspect("equal")
    linkage.set_title(f"{title}, shaft at {math.degrees(angle_rad):.1f} deg", fontsize=10)
    linkage.set_xlabel("mm")
    for row, chart in enumerate(analysis.charts):
        axes = figure.add_subplot(grid[row, 1])
        for (name, values), colour in zip(chart.curves.items(), _COLOURS * 3, strict=False):
            axes.plot(np.degrees(analysis.theta_rad), values, color=colour, lw=1.2, label=name)
        axes.set_title(f"{chart.title} [{chart.unit}]", fontsize=9, loc="left")
        axes.legend(fontsize=7, frameon=False, ncols=6, loc="lower right", bbox_to_anchor=(1.0, 1.0))
        axes.grid(color="#e4e7eb")
        axes.set_xlim(0.0, 360.0)
        axes.set_xticks(range(0, 361, 60))
        axes.tick_params(labelsize=7)
    out = io.BytesIO()
    figure.savefig(out, format=kind, dpi=110)
    return out.getvalue()


def as_dxf(analysis: Analysis, angle_rad: float) -> str:
    """The linkage at a shaft angle in millimetres: links, joints, and the paths of the moving points, by layer."""
    drawing = new_drawing("R2010", units=4)
    space, k = drawing.modelspace(), _sample(analysis, angle_rad)
    for layer in ("LINKS", "JOINTS", "PATHS"):
        drawing.layers.add(layer)
    places = {name: (float(_MILLI * x[k]), float(_MILLI * y[k])) for name, (x, y) in analysis.points.items()}
    size = max(math.dist(a, b) for a in places.values() for b in places.values())
    for bar in analysis.bars:
        space.add_line(places[bar.start], places[bar.end], dxfattribs={"layer": "LINKS"})
    for name, place in places.items():
        space.add_circle(place, 0.01 * size, dxfattribs={"layer": "JOINTS"})
        space.add_text(name, height=0.02 * size, dxfattribs={"layer": "JOINTS"}).set_placement(place)
        if name not in analysis.fixed:
            x, y = analysis.points[name]
            path = np.column_stack([_MILLI * x, _MILLI * y]).tolist()
            space.add_lwpolyline(path, close=True, dxfattribs={"layer": "PATHS"})
    out = io.StringIO()
    drawing.write(out)
    return out.getvalue()


def _sample(analysis: Analysis, angle_rad: float) -> int:
    step = float(analysis.theta_rad[1] - analysis.theta_rad[0])
    return round(angle_rad / step) % analysis.theta_rad.size
