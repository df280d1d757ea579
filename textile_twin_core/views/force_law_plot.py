"""Force over a measure in the viewer: curve and band of each way, and the point at which the machine is."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import rerun as rr

from textile_twin_core.arrays import FloatArray
from textile_twin_core.dynamics.loads import ForceCurve
from textile_twin_core.dynamics.loads.force_curve import POSITION
from textile_twin_core.inference.learned_curve import LearnedCurve
from textile_twin_core.twin import compile_machine
from textile_twin_core.views import palette
from textile_twin_core.views.angle_canvas import RESIDUAL_SIZE, AngleCanvas, canvas_for, round_ticks
from textile_twin_core.views.recording_writer import at_times

if TYPE_CHECKING:
    from textile_twin_core.machine.machine import Machine

ORIGIN: Final = "force_law"
_NORMAL95: Final = 1.959964
_WIDEST: Final = 0.5
"""Largest half width of a band over the largest force that is drawn in full."""
_PLACES: Final = 240
_BEFORE: Final = 0.08
"""Share of the canvas before the first knot, where there is no force."""
_MM: Final = 1e3


class ForceLawPlot:
    """Plot of the first force law that a recording shows, or else of the first force curve of the machine file.

    Args:
        machine: with the measure. curves: learned laws by name, which have bands.

    Attributes:
        canvas: scale of the plot. title: of its view.
    """

    def __init__(self, machine: Machine, name: str, curve: LearnedCurve | ForceCurve) -> None:
        places = np.linspace(curve.knots[0], curve.knots[-1], _PLACES)
        if isinstance(curve, ForceCurve):
            inner = np.minimum(places, np.nextafter(places[-1], 0.0))  # the last knot is a step
            self._forces = [curve.values(inner), curve.values(inner, growing=False)]
            halves = [np.zeros(_PLACES)] * 2
        else:
            self._forces = [np.interp(places, curve.knots, each) for each in (curve.in_N, curve.out_N)]
            sigmas = (curve.in_sigma_N, curve.out_sigma_N)
            halves = [_NORMAL95 * np.interp(places, curve.knots, each) for each in sigmas]
        most = _WIDEST * max(float(np.max(np.abs(force))) for force in self._forces)
        self._halves = [np.minimum(half, most) for half in halves]
        self._places = places
        bands = [edge for f, h in zip(self._forces, self._halves, strict=True) for edge in (f - h, f + h)]
        self.canvas: AngleCanvas = canvas_for(bands, *RESIDUAL_SIZE)
        band = "" if isinstance(curve, ForceCurve) else ", 95 % bands"
        self.title = f"Force of {name}{band} [N over mm]"
        self._twin = compile_machine(machine, [curve.measure], method="exact")
        self._measure = curve.measure

    @classmethod
    def of(cls, machine: Machine, curves: Mapping[str, LearnedCurve]) -> ForceLawPlot | None:
        """Return the plot; None without a law and without a force curve over a measure."""
        for name, learned in curves.items():
            return cls(machine, name, learned)
        for load in machine.loads:
            if isinstance(load, ForceCurve) and load.measure.endswith(POSITION):
                return cls(machine, load.name, load)
        return None

    def draw(self, stream: rr.RecordingStream) -> None:
        """Draw grid, scale, bands and curves."""
        width, height, y = self.canvas.width, self.canvas.height, self.canvas.y
        deep = _MM * (self._places[-1] - self._places[0])
        levels = round_ticks(self.canvas.low, self.canvas.high, 6)
        depths = round_ticks(0.0, float(deep), 6)
        across = self._x(self._places[0] + np.array(depths) / _MM)
        grid = [[(0.0, v), (width, v)] for v in y(np.array(levels))] + [[(x, 0.0), (x, height)] for x in across]
        colours = [palette.FRAME if level == 0.0 else palette.GRID for level in levels] + [palette.GRID] * len(depths)
        self._lines(stream, "grid", grid, -0.5, colours, -20.0)
        scale = [(x, 1.055 * height) for x in across] + [(-0.055 * width, v) for v in y(np.array(levels))]
        words = [f"{depth + 0.0:g}" for depth in depths] + [f"{level + 0.0:g}" for level in levels]
        texts = rr.Points2D(scale, radii=[0.0], labels=words, colors=[palette.TEXT])
        stream.log(f"{ORIGIN}/scale", texts, static=True)
        x = self._x(self._places)
        for way, force, half, colour in zip(
            ("in", "out"), self._forces, self._halves, (palette.PREDICTED, palette.MEASURED), strict=True
        ):
            if half.any():  # a 2D view has no filled shapes
                comb = [[(a, b), (a, c)] for a, b, c in zip(x, y(force - half), y(force + half), strict=True)]
                self._lines(stream, f"band_{way}", comb, 0.5 * width / _PLACES, [palette.dim(colour, 0.3)], -10.0)
            self._lines(stream, way, [np.column_stack([x, y(force)])], -1.1, [colour], 1.0)
            at = min(int(np.argmax(np.abs(force))), _PLACES * 3 // 4) if way == "in" else _PLACES // 2
            name = rr.Points2D([(x[at], y(force)[at])], radii=[0.0], labels=[f"way {way}"], colors=[colour])
            stream.log(f"{ORIGIN}/name_{way}", name, static=True)
        now = rr.Points2D.from_fields(colors=[palette.NOW], radii=[-5.0], draw_order=50.0)
        stream.log(f"{ORIGIN}/now", now, static=True)

    def follow(self, stream: rr.RecordingStream, time_s: FloatArray, theta_rad: FloatArray) -> None:
        """Write the point at which the machine is at times (n,) and shaft angles (n,); before the first knot at 0."""
        if time_s.size < 2:
            return
        none = np.zeros_like(theta_rad)
        place = np.broadcast_to(self._twin.evaluate(theta_rad, none, none)[self._measure], theta_rad.shape)
        growing, acting = np.gradient(place) > 0.0, place >= self._places[0]
        into, out = (np.interp(place, self._places, force) for force in self._forces)
        force = np.where(acting, np.where(growing, into, out), 0.0)
        points = np.column_stack([np.clip(self._x(place), 0.0, self.canvas.width), self.canvas.y(force)])
        columns = rr.Points2D.columns(positions=points.astype(np.float32))
        stream.send_columns(f"{ORIGIN}/now", at_times(time_s), columns)

    def _x(self, place: FloatArray) -> FloatArray:
        """Return the canvas x of values of the measure."""
        share = (place - self._places[0]) / max(self._places[-1] - self._places[0], math.ulp(1.0))
        return np.asarray(self.canvas.width * (_BEFORE + (1.0 - _BEFORE) * share))

    @staticmethod
    def _lines(
        stream: rr.RecordingStream, name: str, lines: Sequence[Any], radius: float, colours: list[palette.Colour],
        order: float,
    ) -> None:  # fmt: skip
        strips = rr.LineStrips2D(lines, radii=[radius], colors=colours, draw_order=order)
        stream.log(f"{ORIGIN}/{name}", strips, static=True)
