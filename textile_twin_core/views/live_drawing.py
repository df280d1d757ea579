"""What a live view draws of each block of samples, and what it remembers of the blocks before."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from textile_twin_core.arrays import FloatArray
from textile_twin_core.machine.sizes import LARGEST
from textile_twin_core.views import backdrop
from textile_twin_core.views.angle_canvas import RESIDUAL_SIZE, TORQUE_SIZE, AngleCanvas, canvas_for
from textile_twin_core.views.buffer import Block
from textile_twin_core.views.latest import Extremes, Latest, Residuals
from textile_twin_core.views.layout import Layout
from textile_twin_core.views.motion_drawing import HISTORY_S, MotionDrawing
from textile_twin_core.views.scene import build_scene
from textile_twin_core.views.scribe import Scribe
from textile_twin_core.views.whole_width import WholeWidth

if TYPE_CHECKING:
    from textile_twin_core.comparison import AngleBins
    from textile_twin_core.machine.machine import Machine

_ANGLE_BINS = 120
_SUMMARY_S = 1.0
_LEAST_NM = 1.0
"""Scales reach so far either way at first."""
_TOO_WIDE = 3.0
"""A scale that reaches further, and is this many times as wide as what it holds, is drawn anew."""


class LiveDrawing:
    """Draws one machine into a stream, block by block; for one thread.

    Begins with what the shaft's angle alone tells; with the first measured torque the layout changes to one that holds
    it beside the predicted.

    Args:
        machine, stream: what is drawn, and where to.
        limit_Nm: limit of the residual to draw, None for none.
        frames_hz: the most pictures of the linkage in a second.
        title: for the summary.
        window_s: seconds before and after the cursor in the plots over time. turn_s: of the last turn, drawn bold.
        unwrapped: the angles count the turns, across gaps too; else they may be wrapped.
        twist_rad: the largest twist of an elastic shaft that is to be seen (see `WholeWidth`).
        memory_s: scales and statistics are of the last so many seconds, to twice that; inf: of all.
    """

    def __init__(
        self,
        machine: Machine,
        stream: rr.RecordingStream,
        limit_Nm: float | None,
        frames_hz: float,
        *,
        title: str,
        window_s: tuple[float, float] = (2.0, 0.05),
        turn_s: float = 0.4,
        unwrapped: bool = False,
        memory_s: float = np.inf,
        twist_rad: float | None = None,
    ) -> None:
        self._machine, self._stream, self._limit, self._title = machine, stream, limit_Nm, title
        self._window_s, self._turn_s = window_s, turn_s
        self._measured_too = False
        self._warned_turn = -np.inf
        self._last_torque = np.empty(0)
        self._measured: Block = (np.empty(0), np.empty(0), np.empty(0))
        self._memory_s = memory_s
        self._residuals = Latest(lambda: Residuals(_ANGLE_BINS), memory_s)
        self._torques = Latest(Extremes, memory_s)
        self._next_summary_s, self._not_drawn = -np.inf, 0
        torque, residual = (AngleCanvas(-_LEAST_NM, _LEAST_NM, *size) for size in (TORQUE_SIZE, RESIDUAL_SIZE))
        scene = build_scene(machine)
        self._scribe = Scribe(stream, scene, torque, residual)
        self._width = None if machine.shaft is None else WholeWidth(machine, scene, twist_rad)
        self._motion = MotionDrawing(machine, self._scribe, frames_hz, unwrapped, self._width)

    @property
    def layout(self) -> Layout:
        """How a viewer arranges what is drawn."""
        return Layout(
            machine=self._machine.name,
            scene=self._scribe.scene,
            travel=self._motion.canvas,
            travels=self._motion.travels.names,
            lanes=len(self._motion.lanes),
            torque=self._scribe.torque_canvas if self._machine.tells_torque else None,
            residual=self._scribe.residual_canvas if self._measured_too else None,
            window_s=self._window_s,
            turn_s=self._turn_s,
            kept_s=HISTORY_S,
            kept=f"last {HISTORY_S:g} s",
            residual_title="Residual = measured - predicted [N m]",
            width=self._width,
        )

    def prepare(self) -> None:
        """Draw what does not move."""
        self._motion.prepare(self._stream)
        backdrop.style_series(self._stream)
        backdrop.style_angle_curves(self._stream)
        self._draw_canvas("angle", self._scribe.torque_canvas)
        self._draw_canvas("by_angle", self._scribe.residual_canvas)

    def motion(self, time: FloatArray, theta: FloatArray) -> None:
        """Draw the shaft's angle alone."""
        self._motion.draw(time, theta)
        self._summarise(float(time[-1]))

    def stations(self, time: FloatArray, stations_rad: FloatArray) -> None:
        """Draw all linkages from the angles of an elastic shaft's stations (n, stations)."""
        self._motion.stations(time, stations_rad)

    def predicted(self, time: FloatArray, theta: FloatArray, torque: FloatArray, sigma: FloatArray) -> None:
        """Draw the shaft's angle and the torque predicted of it."""
        sensor = self._machine.sensors.torque
        shown = np.asarray(sensor.gain * torque + sensor.offset_Nm)
        self._fit_canvas(shown)
        times, angles, frames = self._motion.draw(time, theta)
        scribe = self._scribe
        scribe.predicted(time + sensor.delay_s, shown, abs(sensor.gain) * sigma)
        joined = np.concatenate([self._last_torque, shown])[-times.size :]
        scribe.over_angle("predicted", times[-joined.size :], angles[-joined.size :], joined)
        self._last_torque = shown[-1:]
        if frames.size:
            scribe.point("angle/now", scribe.torque_canvas, time[frames], angles[-time.size :][frames], shown[frames])
        self._summarise(float(time[-1]))

    def break_lines(self, time: FloatArray) -> None:
        """Let the lines over time end at times (n,): what comes later stands apart."""
        nothing = np.full_like(time, np.nan)
        for name in self._motion.travels.names:
            self._scribe.scalars(f"travel/{name}", time, nothing)
        if self._machine.tells_torque:
            self._scribe.predicted(time + self._machine.sensors.torque.delay_s, nothing, nothing)

    def measured(self, time: FloatArray, torque: FloatArray) -> None:
        """Draw measured torque."""
        torque = _believable(torque)
        if not self._measured_too and self._machine.tells_torque:
            self._measured_too = True
            self._stream.send_blueprint(self.layout.blueprint())
        self._fit_canvas(torque)
        self._scribe.measured(time, torque)
        block = (time, self._theta(time), torque)
        joined = [np.concatenate([old, new]) for old, new in zip(self._measured, block, strict=True)]
        for which in ("measured", "last"):
            self._scribe.over_angle(which, joined[0], joined[1], joined[2])
        self._measured = tuple(column[-1:] for column in block)

    def residual(self, time: FloatArray, residual: FloatArray, *, not_drawn: int) -> None:
        """Draw residuals and, once a second, their statistics; `not_drawn` samples had to be dropped so far."""
        residual = _believable(residual)
        self._scribe.residual(time, residual, self._limit)
        theta = self._theta(time)
        good = np.isfinite(theta) & np.isfinite(residual)
        for gathered in self._residuals.both:
            gathered.add(theta[good], residual[good])
        if self._limit is not None:
            over = np.flatnonzero(good & (np.abs(residual) > self._limit))
            # Once a turn: a deviation that lasts would fill the list of events.
            if over.size and self._motion.turns >= self._warned_turn + 1.0:
                self._warned_turn = self._motion.turns
                k = over[np.argmax(np.abs(residual[over]))]
                angle = np.rad2deg(np.mod(theta[k], 2.0 * np.pi))
                self._scribe.say(float(time[k]), "WARN", f"residual {residual[k]:+.2f} N m at {angle:.0f}°")
        self._not_drawn = not_drawn

    def _summarise(self, time_s: float) -> None:
        """Once a second: speed and turns, and of the residuals their statistics."""
        self._residuals.turn(time_s)
        self._torques.turn(time_s)
        if time_s < self._next_summary_s:
            return
        self._next_summary_s = time_s + _SUMMARY_S
        lines = [
            f"### {self._title}",
            "",
            f"| time | {time_s:.1f} s |",
            "|---|---|",
            f"| shaft speed | {self._motion.speed_rpm:.1f} rpm |",
            f"| turns | {self._motion.turns:.1f} |",
        ]
        residuals = self._residuals.shown
        if residuals.count:
            self._draw_bins(residuals.bins(), time_s)
            lines += [
                f"| residuals, last {self._memory_s:g} to {2.0 * self._memory_s:g} s | {residuals.count} |",
                f"| their RMS | {residuals.rms_Nm:.4f} N m |",
                f"| their largest | {residuals.worst_Nm:.3f} N m |",
                f"| sensor delay, configured | {self._machine.sensors.torque.delay_s * 1e3:g} ms |",
                f"| samples not drawn | {self._not_drawn} |",
            ]
        self._scribe.summary("\n".join(lines), time_s)

    def _draw_bins(self, bins: AngleBins, time_s: float) -> None:
        present = self._scribe.residual_canvas
        canvas = _fitting(present, np.array([bins.min_Nm, bins.max_Nm]))
        if canvas is not present:
            self._scribe = self._scribe.scaled(residual=canvas)
            self._draw_canvas("by_angle", canvas)
        self._scribe.residual_by_angle(bins, time_s)

    def _draw_canvas(self, origin: str, canvas: AngleCanvas) -> None:
        backdrop.draw_canvas(self._stream, origin, canvas, self._motion.marks, self._motion.inside)

    def _fit_canvas(self, torque: FloatArray) -> None:
        """Fit the torque's scale to what came lately and comes now."""
        for gathered in self._torques.both:
            gathered.add(torque)
        present, lately = self._scribe.torque_canvas, self._torques.shown
        canvas = _fitting(present, np.array([lately.low, lately.high]))
        if canvas is not present:
            self._scribe = self._scribe.scaled(torque=canvas)
            self._draw_canvas("angle", canvas)

    def _theta(self, time: FloatArray) -> FloatArray:
        """Shaft angle of which a measured sample speaks: at its stamp less the sensor's delay."""
        return self._motion.angle_at(time - self._machine.sensors.torque.delay_s)


def _believable(torque: FloatArray) -> FloatArray:
    """Torques (n,), NaN for what is none: one such number would spoil scales and sums for long."""
    return np.where(np.abs(torque) <= LARGEST, torque, np.nan)


def _fitting(canvas: AngleCanvas, values: FloatArray) -> AngleCanvas:
    """The canvas while values (n,) pass no edge of it and fill it; else another, with some room to grow."""
    needed = canvas_for([values], canvas.width, canvas.height)
    holds = canvas.low <= needed.low and needed.high <= canvas.high
    if holds and canvas.high - canvas.low <= max(2.0 * _LEAST_NM, _TOO_WIDE * (needed.high - needed.low)):
        return canvas
    return canvas_for([np.array([needed.low, needed.high])], canvas.width, canvas.height)
