"""Messages of the page: a JSON head followed by curves as 32-bit floats, small enough to follow a slider."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics.loads import ForceCurve
from textile_twin_core.dynamics.loads.force_curve import POSITION
from textile_twin_core.explore.design import Design, force_curves
from textile_twin_core.explore.labels import PRINTED, label, shown_unit
from textile_twin_core.explore.search import LimitTally, SearchProgress, Task
from textile_twin_core.explore.shown import Analysis

_CORNERS = 9
"""Corners of the line of a cubic piece."""


class Arrays:
    """Collection of arrays, to which a message refers by position."""

    def __init__(self) -> None:
        self._arrays: list[FloatArray] = []
        self._size = 0

    def add(self, values: FloatArray) -> list[int]:
        """Add an array; return its position and length in floats."""
        begin = self._size
        self._arrays.append(values)
        self._size += values.size
        return [begin, values.size]

    def packed(self, head: dict[str, Any]) -> bytes:
        """Build the message: length of the head in bytes (4, little-endian), head padded to 4 bytes, floats."""
        text = json.dumps(plain(head), allow_nan=False, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        floats = np.concatenate(self._arrays).astype("<f4") if self._arrays else np.empty(0, "<f4")
        return len(text).to_bytes(4, "little") + text + floats.tobytes()


def plain(value: Any) -> Any:
    """Convert to plain JSON values; NaN and infinities become null."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value


def analysis_head(analysis: Analysis, arrays: Arrays, printed: dict[str, str]) -> dict[str, Any]:
    """Describe an analysis for the page; its arrays go to `arrays`."""
    return {
        "points": {name: [arrays.add(x), arrays.add(y)] for name, (x, y) in analysis.points.items()},
        "fixed": list(analysis.fixed),
        "bars": [[b.name, b.start, b.end, b.half_axes_m, b.gears] for b in analysis.bars],
        "guides": [list(guide) for guide in analysis.guides],
        "charts": [
            {"title": c.title, "unit": c.unit, "curves": {n: arrays.add(v) for n, v in c.curves.items()}}
            for c in analysis.charts
        ],
        "numbers": [_number(name, value, printed.get(name, "")) for name, value in analysis.numbers.items()],
        "marks": [[mark.name, math.degrees(mark.angle_rad)] for mark in analysis.marks],
        "dwells": [[d.name, math.degrees(d.begin_rad), math.degrees(d.end_rad)] for d in analysis.dwells],
        "clashes": [[c.first, c.second, math.degrees(c.begin_rad), math.degrees(c.end_rad)] for c in analysis.clashes],
        "notes": list(analysis.notes),
    }


def _number(name: str, value: float, printed: str) -> dict[str, Any]:
    words = label(name)
    return {"name": name, "text": words.text, "unit": words.unit, "value": value * words.factor, "printed": printed}


def design_head(design: Design) -> dict[str, Any]:
    """Describe a design for the page, with parameters in display units, speed in rpm and dwell in mm.

    The needle transfer has no separate speed; its cycles per minute are a parameter.
    """
    parameters = []
    for p in design.family.parameters:
        unit, factor = shown_unit(p.unit)
        value = design.value(p.name)
        parameters.append(
            {
                "name": p.name,
                "text": p.text,
                "unit": unit,
                "whole": p.whole,
                "value": None if value is None else value * factor,
                "low": p.low * factor,
                "high": p.high * factor,
                "base": None if p.value is None else p.value * factor,
                "searchable": p.name in design.family.searchable,
            }
        )
    return {
        "name": design.family.name,
        "description": design.family.base.description,
        "rpm": design.speed_rad_s * 30.0 / math.pi if design.has_speed else None,
        "dwell_mm": None if design.dwell_within_m is None else 1e3 * design.dwell_within_m,
        "parameters": parameters,
    }


def curve_heads(design: Design, analysis: Analysis, arrays: Arrays) -> list[dict[str, Any]]:
    """Describe the force curves of a design: knots [mm or deg], forces, their lines, and the measure over the turn."""
    declared = {curve.name: curve for curve in force_curves(design.declared or design.family)}
    heads = []
    for curve in design.curves:
        position = analysis.positions_m.get(curve.measure.removesuffix(POSITION))
        unit, factor = shown_unit("rad" if curve.unit == "N m" else "m")
        ways = {"in": curve.in_N} | ({} if curve.out_N is None else {"out": curve.out_N})
        base = declared[curve.name]
        heads.append(
            {
                "name": curve.name,
                "measure": curve.measure.rsplit("_", 1)[0].replace("_", " "),
                "unit": curve.unit,
                "knots_unit": unit,
                "knots": [factor * knot for knot in curve.knots],
                "ways": ways,
                "base": {"in": base.in_N, "out": base.out_N},
                "lines": {way: _line(curve, way == "in", factor) for way in ways},
                "place": None if position is None else arrays.add(factor * position),
                "work_J": None if position is None else _work_J(curve, position, design.speed_rad_s),
            }
        )
    return heads


def _line(curve: ForceCurve, growing: bool, factor: float) -> list[list[float]]:
    """Return the corners [place, force] of a curve."""
    corners = []
    for piece in curve.pieces(growing):
        for place in np.linspace(piece.lower, piece.upper, 2 if len(piece.coefficients) <= 2 else _CORNERS).tolist():
            force = float(np.polynomial.polynomial.polyval(place - piece.lower, piece.coefficients))
            corners.append([factor * place, force])
    return corners


def _work_J(curve: ForceCurve, position: FloatArray, speed_rad_s: float) -> list[float]:
    """Return the work of a turn against a curve, while its measure grows and while it shrinks [J]."""
    low, high = float(position.min()), float(position.max())
    share = (speed_rad_s / curve.at_speed_rad_s) ** curve.speed_power if curve.at_speed_rad_s else 1.0
    return [share * curve.work_J(low, high, growing) for growing in (True, False)]


def printed_of(design: Design) -> dict[str, str]:
    """Return the values printed in the paper, if the design has the parameters and speed of the paper."""
    if design.values or not math.isclose(design.speed_rad_s, design.family.base.nominal_speed_rad_s, rel_tol=1e-3):
        return {}
    kind = getattr(design.family, "kind", "")
    return PRINTED.get(kind, {}) if design.family.base.name == kind else {}


def progress_message(progress: SearchProgress, task: Task, running: bool, took: float = 0.0) -> bytes:
    """Build the message of the progress of a search.

    Args:
        progress: Progress of the search.
        task: Task of the search.
        running: True while the search continues.
        took: Time so far [s].
    """
    shown = list(dict.fromkeys([g.number for g in task.goals] + [k.number for k in task.limits]))
    front = [[one.numbers[name] * label(name).factor for name in shown] for one in progress.front]
    head = {
        "type": "front",
        "running": running,
        "numbers": [{"text": label(name).text, "unit": label(name).unit} for name in shown],
        "front": plain(front),
        "designs": progress.designs,
        "per_second": progress.designs_per_second,
        "share": progress.share,
        "took": took,
        "complete": progress.complete,
        "failing": "" if progress.front else failing_text(progress.tallies),
    }
    return Arrays().packed(head)


def failing_text(tallies: Sequence[LimitTally]) -> str:
    """Name the limits that no design meets, with the nearest value; if each is met by some, the one met by the
    fewest.
    """
    failing = [one for one in tallies if not one.designs]
    if failing:
        return "; ".join(f"none has {_limit_text(one)}{_nearest_text(one)}" for one in failing)
    if not tallies:
        return ""
    fewest = min(tallies, key=lambda one: one.designs)
    return f"{fewest.designs} have {_limit_text(fewest)}, and none of these meets the other limits"


def _limit_text(one: LimitTally) -> str:
    words, limit = label(one.limit.number), one.limit
    sense = "at least" if limit.at_least else "at most"
    return f"{words.text} {sense} {limit.value * words.factor:.4g} {words.unit}".rstrip()


def _nearest_text(one: LimitTally) -> str:
    words = label(one.limit.number)
    if not math.isfinite(one.nearest):
        return ", which has no value for any design"
    return f" (the nearest has {one.nearest * words.factor:.4g})"
