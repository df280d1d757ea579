"""Files of the page: designs as machine files and to share, curves as CSV, pictures, the linkage as DXF."""

from __future__ import annotations

import cmath
import csv
import io
import json
import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from ezdxf.filemanagement import new as new_drawing
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse

from textile_twin_core.errors import MachineError, SceneError
from textile_twin_core.explore.design import Design, check_number
from textile_twin_core.explore.shown import Analysis
from textile_twin_core.files.machine_file import load_machine_file, machine_document
from textile_twin_core.machine import AnyMachine

_FORMAT = "textile-twin design 1"
_LARGEST = 2_000_000


def machine_text(design: Design) -> str:
    """Format the design as a machine file (YAML).

    Raises:
        MachineError: The values give no valid machine.
    """
    document: dict[str, Any] = _document(design.machine())
    text: str = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=110)
    return text


def design_text(design: Design, task: dict[str, Any] | None = None) -> str:
    """Format the design as a file to share (JSON): machine, values, speed, dwell, and task of the search."""
    shared = {
        "format": _FORMAT,
        "machine": _document(design.family.base),
        "values": dict(design.values),
        "rpm": design.speed_rad_s * 30.0 / math.pi,
        "dwell_within_m": design.dwell_within_m,
        "task": task or {},
    }
    return json.dumps(shared, indent=1) + "\n"


def read_design(text: str, name: str = "the file") -> tuple[Design, dict[str, Any]]:
    """Read a design and the task of its search from either kind of file.

    Raises:
        MachineError: The machine in the file is not valid.
        SceneError: The file is not valid.
    """
    if len(text) > _LARGEST:
        raise SceneError(f"{name}: a machine file has at most 2 MB")
    braced = text.lstrip().startswith("{")  # a short machine file may start like this, too
    if not (braced and (name.endswith(".json") or '"format"' in text)):
        return Design.of(_machine(text, name)), {}
    try:
        shared = json.loads(text)
    except json.JSONDecodeError as error:
        raise SceneError(f"{name}: is not valid JSON: {error}") from None
    if not isinstance(shared, dict) or shared.get("format") != _FORMAT:
        raise SceneError(f"{name}: is not a shared design of textile-twin")
    design = Design.of(_machine(yaml.safe_dump(shared.get("machine")), name))
    values, task = shared.get("values") or {}, shared.get("task") or {}
    if not isinstance(values, dict) or not isinstance(task, dict):
        raise SceneError(f"{name}: values and task must be objects")
    rpm, within = shared.get("rpm"), shared.get("dwell_within_m")
    check_number(rpm, f"{name}: rpm")
    return design.changed(values).at_speed(float(rpm) * math.pi / 30.0).dwelling_within(within), task  # type: ignore[arg-type]


def _document(machine: AnyMachine) -> dict[str, Any]:
    return machine_document(machine)


def _machine(text: str, name: str) -> AnyMachine:
    with tempfile.TemporaryDirectory(prefix="textile-twin-") as folder:
        path = Path(folder) / (Path(name).stem + ".yaml")
        try:
            path.write_text(text, encoding="utf-8")
        except (OSError, ValueError):
            raise SceneError(f"{name[:60]!r}: cannot be stored as a file; use another name, and plain text") from None
        try:
            return load_machine_file(path)
        except MachineError as error:
            raise MachineError(str(error).replace(str(path), name)) from None


_INK, _FAINT = "#22272e", "#c8ced6"
_COLOURS = ("#0072b2", "#e07b00", "#2a9d63", "#c2377a", "#6b7480", "#8a63d2", "#22272e", "#a8821a", "#56b4e9")
_MILLI = 1e3
_SHORT = 2
"""Longest point name that is written beside its point; for longer ones the bar is named instead."""


def as_csv(analysis: Analysis) -> str:
    """Format every curve over the shaft angle, in the units of the page."""
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
    """Draw the linkage at a shaft angle and all curves on one page, as `png` or `svg`."""
    rows = len(analysis.charts)
    figure = Figure(figsize=(11.0, max(4.5, 1.7 * rows)), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(rows, 2, width_ratios=[1.0, 1.2])
    linkage = figure.add_subplot(grid[:, 0])
    places = _places(analysis, angle_rad)
    for name in _moving(analysis):
        x, y = analysis.points[name]
        linkage.plot(_MILLI * x, _MILLI * y, color=_FAINT, lw=0.9)
    for bar in analysis.bars:
        a, b = places[bar.start], places[bar.end]
        if bar.half_axes_m is None:
            linkage.plot([a.real, b.real], [a.imag, b.imag], color=_INK, lw=2.2)
        else:
            middle, (major, minor), tilt = (a + b) / 2.0, bar.half_axes_m, math.degrees(cmath.phase(b - a))
            size = 2.0 * _MILLI * major, 2.0 * _MILLI * minor
            linkage.add_patch(Ellipse((middle.real, middle.imag), *size, angle=tilt, fill=False, ec=_INK, lw=1.4))
        for centre, radius in bar.gears:
            place = places[centre]
            linkage.add_patch(Circle((place.real, place.imag), _MILLI * radius, fill=False, ec=_INK, lw=1.4))
        if len(bar.start) > _SHORT:
            linkage.annotate(bar.name, (b.real, b.imag), (4, 4), textcoords="offset points", fontsize=8)
    for name, place in places.items():
        face = _INK if name in analysis.fixed else "white"
        linkage.plot(place.real, place.imag, "o", color=_INK, mfc=face, ms=5)
        if len(name) <= _SHORT:
            linkage.annotate(name, (place.real, place.imag), (4, 4), textcoords="offset points", fontsize=8)
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
    """Draw the linkage at a shaft angle in millimetres: links, joints and paths of the moving points, each in a
    layer.
    """
    drawing = new_drawing("R2010", units=4)
    space, places = drawing.modelspace(), _places(analysis, angle_rad)
    for layer in ("LINKS", "JOINTS", "PATHS"):
        drawing.layers.add(layer)
    size = max(abs(a - b) for a in places.values() for b in places.values())
    for bar in analysis.bars:
        a, b = places[bar.start], places[bar.end]
        if bar.half_axes_m is None:
            space.add_line((a.real, a.imag), (b.real, b.imag), dxfattribs={"layer": "LINKS"})
        else:
            middle, (major, minor) = (a + b) / 2.0, bar.half_axes_m
            along = cmath.rect(_MILLI * major, cmath.phase(b - a))  # the foci of a round gear coincide
            ends = (middle.real, middle.imag), (along.real, along.imag)
            space.add_ellipse(*ends, ratio=minor / major, dxfattribs={"layer": "LINKS"})
        for centre, radius in bar.gears:
            place = places[centre]
            space.add_circle((place.real, place.imag), _MILLI * radius, dxfattribs={"layer": "LINKS"})
    for name, place in places.items():
        space.add_circle((place.real, place.imag), 0.01 * size, dxfattribs={"layer": "JOINTS"})
        text = space.add_text(name, height=0.02 * size, dxfattribs={"layer": "JOINTS"})
        text.set_placement((place.real, place.imag))
    for name in _moving(analysis):
        path = (_MILLI * np.column_stack(analysis.points[name])).tolist()
        space.add_lwpolyline(path, close=True, dxfattribs={"layer": "PATHS"})
    out = io.StringIO()
    drawing.write(out)
    return out.getvalue()


def _places(analysis: Analysis, angle_rad: float) -> dict[str, complex]:
    """Return every point at the sample nearest to a shaft angle [mm]."""
    step = float(analysis.theta_rad[1] - analysis.theta_rad[0])
    k = round(angle_rad / step) % analysis.theta_rad.size
    return {name: _MILLI * complex(x[k], y[k]) for name, (x, y) in analysis.points.items()}


def _moving(analysis: Analysis) -> list[str]:
    """Return the points whose paths are drawn: moving points, except the second foci of gears."""
    foci = [bar.end for bar in analysis.bars if bar.half_axes_m is not None]
    return [name for name in analysis.points if name not in analysis.fixed and name not in foci]
