"""Drawing of a live view, block by block, with the state that lives between blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.expected_reading import LONGEST_NS
from textile_twin_core.machine import TorqueFilter
from textile_twin_core.machine.sizes import LARGEST
from textile_twin_core.views import static_scene
from textile_twin_core.views.angle_canvas import RESIDUAL_SIZE, TORQUE_SIZE, AngleCanvas, canvas_for
from textile_twin_core.views.buffer import Block, Extremes, Latest, Residuals
from textile_twin_core.views.drawable import drawable
from textile_twin_core.views.layout import Layout
from textile_twin_core.views.motion_drawing import HISTORY_S, MotionDrawing
from textile_twin_core.views.recording_writer import RecordingWriter
from textile_twin_core.views.scene import build_scene
from textile_twin_core.views.whole_width import WholeWidth

if TYPE_CHECKING:
    from textile_twin_core.comparison import AngleBins
    from textile_twin_core.machine.machine import Machine

_ANGLE_BINS = 120
_SUMMARY_S = 1.0
_LEAST_NM = 1.0
"""Initial half-width of the scales [N m]."""
_TOO_WIDE = 3.0
"""A scale that is this many times wider than its values is redrawn."""


class LiveDrawing:
    """Drawing of one machine into a stream, block by block, from one thread.

    The first layout shows the motion and the predicted torque. The first measured torque switches to a layout with the
    measured torque beside the predicted one.

    Args:
        machine: Machine to draw.
        stream: Stream to draw into.
        limit_Nm: Limit of the residual to draw [N m]; None draws no limit.
        frames_hz: Largest rate of pictures of the linkage [Hz].
        title: Title of the summary.
        window_s: Time shown before and after the cursor in the plots over time [s].
        turn_s: Duration of the last turn, which is drawn bold [s].
        unwrapped: True if angles are unwrapped, across gaps too; otherwise they may be wrapped.
        memory_s: Span of scales and statistics, up to twice this [s]; inf covers everything.
        twist_rad: Largest twist of an elastic shaft to show (see `WholeWidth`) [rad].
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
        self._filter, self._filtered_s = TorqueFilter.of(machine.sensors.torque).session(), -np.inf
        self._measured: Block = (np.empty(0), np.empty(0), np.empty(0))
        self._memory_s = memory_s
        self._residuals = Latest(lambda: Residuals(_ANGLE_BINS), memory_s)
        self._torques = Latest(Extremes, memory_s)
        self._next_summary_s, self._not_drawn = -np.inf, 0
        torque, residual = (AngleCanvas(-_LEAST_NM, _LEAST_NM, *size) for size in (TORQUE_SIZE, RESIDUAL_SIZE))
        scene = build_scene(machine)
        self._writer = RecordingWriter(stream, scene, torque, residual)
        self._width = None if machine.shaft is None else WholeWidth(machine, scene, twist_rad)
        self._motion = MotionDrawing(machine, self._writer, frames_hz, unwrapped, self._width)

    @property
    def layout(self) -> Layout:
        """Layout of the views in their present state."""
        return Layout(
            machine=drawable(self._machine.name),
            scene=self._writer.scene,
            travel=self._motion.canvas,
            measures=self._motion.curves.names,
            phase_rows=len(self._motion.phase_rows),
            torque=self._writer.torque_canvas if self._machine.has_complete_torque else None,
            residual=self._writer.residual_canvas if self._measured_too else None,
            window_s=self._window_s,
            turn_s=self._turn_s,
            history_s=HISTORY_S,
            history=f"last {HISTORY_S:g} s",
            residual_title="Residual = measured - predicted [N m]",
            width=self._width,
        )

    def prepare(self) -> None:
        """Draw the static parts."""
        self._motion.prepare(self._stream)
        static_scene.style_series(self._stream)
        static_scene.style_angle_curves(self._stream)
        self._draw_canvas("angle", self._writer.torque_canvas)
        self._draw_canvas("by_angle", self._writer.residual_canvas)

    def motion(self, time: FloatArray, theta: FloatArray) -> None:
        """Draw the shaft angle of a machine without a torque prediction."""
        self._motion.draw(time, theta)
        self._summarise(float(time[-1]))

    def stations(self, time: FloatArray, stations_rad: FloatArray) -> None:
        """Draw all linkages from the angles of the stations of an elastic shaft (n, stations) [rad]."""
        self._motion.stations(time, stations_rad)

    def predicted(self, time: FloatArray, theta: FloatArray, torque: FloatArray, sigma: FloatArray) -> None:
        """Draw the shaft angle and the predicted torque."""
        sensor = self._machine.sensors.torque
        shown = np.asarray(sensor.reading(self._filtered(time, torque)))
        self._fit_canvas(shown)
        times, angles, frames = self._motion.draw(time, theta)
        writer = self._writer
        writer.predicted(time + sensor.delay_s, shown, abs(sensor.gain) * sigma)
        joined = np.concatenate([self._last_torque, shown])[-times.size :]
        writer.over_angle("predicted", times[-joined.size :], angles[-joined.size :], joined)
        self._last_torque = shown[-1:]
        if frames.size:
            writer.point("angle/now", writer.torque_canvas, time[frames], angles[-time.size :][frames], shown[frames])
        self._summarise(float(time[-1]))

    def _filtered(self, time: FloatArray, torque: FloatArray) -> FloatArray:
        """Return the predicted torque behind the filter of the sensor; it starts again behind a gap."""
        if self._filter.is_identity:
            return torque
        steps = np.diff(time, prepend=self._filtered_s)
        self._filtered_s = float(time[-1])
        return np.array(
            [
                self._filter.step(step, value) if 0.0 < step <= 1e-9 * LONGEST_NS else self._filter.restart(value)
                for step, value in zip(steps.tolist(), torque.tolist(), strict=True)
            ]
        )

    def break_lines(self, time: FloatArray) -> None:
        """Break the lines over time at times (n,) [s]."""
        nothing = np.full_like(time, np.nan)
        for name in self._motion.curves.names:
            self._writer.scalars(f"travel/{name}", time, nothing)
        if self._machine.has_complete_torque:
            self._writer.predicted(time + self._machine.sensors.torque.delay_s, nothing, nothing)

    def measured(self, time: FloatArray, torque: FloatArray) -> None:
        """Draw measured torque."""
        torque = _plausible(torque)
        if not self._measured_too and self._machine.has_complete_torque:
            self._measured_too = True
            self._stream.send_blueprint(self.layout.blueprint())
        self._fit_canvas(torque)
        self._writer.measured(time, torque)
        block = (time, self._theta(time), torque)
        joined = [np.concatenate([old, new]) for old, new in zip(self._measured, block, strict=True)]
        for which in ("measured", "last"):
            self._writer.over_angle(which, joined[0], joined[1], joined[2])
        self._measured = tuple(column[-1:] for column in block)

    def residual(self, time: FloatArray, residual: FloatArray, *, not_drawn: int) -> None:
        """Draw residuals and, once a second, their statistics; `not_drawn` counts the samples dropped so far."""
        residual = _plausible(residual)
        self._writer.residual(time, residual, self._limit)
        theta = self._theta(time)
        good = np.isfinite(theta) & np.isfinite(residual)
        for gathered in self._residuals.both:
            gathered.add(theta[good], residual[good])
        if self._limit is not None:
            over = np.flatnonzero(good & (np.abs(residual) > self._limit))
            # Warn once a turn, so that a lasting deviation does not fill the list of events.
            if over.size and self._motion.turns >= self._warned_turn + 1.0:
                self._warned_turn = self._motion.turns
                k = over[np.argmax(np.abs(residual[over]))]
                angle = np.rad2deg(np.mod(theta[k], 2.0 * np.pi))
                self._writer.say(float(time[k]), "WARN", f"residual {residual[k]:+.2f} N m at {angle:.0f}°")
        self._not_drawn = not_drawn

    def _summarise(self, time_s: float) -> None:
        """Write speed, turns and residual statistics, once a second."""
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
        self._writer.summary("\n".join(lines), time_s)

    def _draw_bins(self, bins: AngleBins, time_s: float) -> None:
        present = self._writer.residual_canvas
        canvas = _fitting(present, np.array([bins.min_Nm, bins.max_Nm]))
        if canvas is not present:
            self._writer = self._writer.scaled(residual=canvas)
            self._draw_canvas("by_angle", canvas)
        self._writer.residual_by_angle(bins, time_s)

    def _draw_canvas(self, origin: str, canvas: AngleCanvas) -> None:
        static_scene.draw_canvas(self._stream, origin, canvas, self._motion.marks, self._motion.inside)

    def _fit_canvas(self, torque: FloatArray) -> None:
        """Fit the torque scale to the recent values and the new ones."""
        for gathered in self._torques.both:
            gathered.add(torque)
        present, lately = self._writer.torque_canvas, self._torques.shown
        canvas = _fitting(present, np.array([lately.low, lately.high]))
        if canvas is not present:
            self._writer = self._writer.scaled(torque=canvas)
            self._draw_canvas("angle", canvas)

    def _theta(self, time: FloatArray) -> FloatArray:
        """Return the shaft angle at the stamp of a measured sample less the sensor delay."""
        return self._motion.angle_at(time - self._machine.sensors.torque.delay_s)


def _plausible(torque: FloatArray) -> FloatArray:
    """Replace torques (n,) that are not finite or beyond LARGEST by NaN; they would spoil scales and sums."""
    return np.where(np.abs(torque) <= LARGEST, torque, np.nan)


def _fitting(canvas: AngleCanvas, values: FloatArray) -> AngleCanvas:
    """Return the canvas if values (n,) fit and fill it; otherwise a new one with a margin."""
    needed = canvas_for([values], canvas.width, canvas.height)
    holds = canvas.low <= needed.low and needed.high <= canvas.high
    if holds and canvas.high - canvas.low <= max(2.0 * _LEAST_NM, _TOO_WIDE * (needed.high - needed.low)):
        return canvas
    return canvas_for([np.array([needed.low, needed.high])], canvas.width, canvas.height)
