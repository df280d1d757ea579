"""What a live view draws of each block of samples, and what it remembers of the blocks before."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison import RunningAngleBins
from textile_twin_core.views import backdrop
from textile_twin_core.views.angle_canvas import RESIDUAL_SIZE, TORQUE_SIZE, AngleCanvas, canvas_for
from textile_twin_core.views.buffer import Block
from textile_twin_core.views.layout import Layout
from textile_twin_core.views.phases import inside_backing, lanes_of, marks_of, state_changes
from textile_twin_core.views.scene import PointPositions, build_scene
from textile_twin_core.views.scribe import Scribe

if TYPE_CHECKING:
    from textile_twin_core.machine.machine import Machine

_HISTORY_S = 4.0  # predictions kept to find the shaft angle of a measured torque
_AHEAD_S = 0.2  # measured torque may be this far ahead of its prediction
_ANGLE_BINS = 120
_SUMMARY_S = 1.0


class LiveDrawing:
    """Draws one machine into a stream, block by block; for one thread.

    `limit_Nm` is the limit of the residual to draw, None for none; `frames_hz` the most pictures of the linkage in a
    second.
    """

    def __init__(self, machine: Machine, stream: rr.RecordingStream, limit_Nm: float | None, frames_hz: float) -> None:
        self._machine, self._stream, self._limit = machine, stream, limit_Nm
        self._frame_s = 1.0 / frames_hz
        self._lanes, self._marks = lanes_of(machine.events()), marks_of(machine.events())
        self._positions = PointPositions(machine)
        self._history: Block = (np.empty(0), np.empty(0), np.empty(0))
        self._measured: Block = (np.empty(0), np.empty(0), np.empty(0))
        self._bins = RunningAngleBins(_ANGLE_BINS)
        self._squares, self._count, self._worst = 0.0, 0, 0.0
        self._next_frame_s, self._next_summary_s = -np.inf, -np.inf
        self._phases: dict[str, str] = {}
        torque, residual = AngleCanvas(-1.0, 1.0, *TORQUE_SIZE), AngleCanvas(-1.0, 1.0, *RESIDUAL_SIZE)
        self._scribe = Scribe(stream, build_scene(machine), torque, residual)

    @property
    def layout(self) -> Layout:
        """How a viewer arranges what is drawn."""
        return Layout(
            machine=self._machine.name,
            scene=self._scribe.scene,
            torque=self._scribe.torque_canvas,
            residual=self._scribe.residual_canvas,
            window_s=(2.0, 0.05),
            turn_s=0.4,
            kept_s=_HISTORY_S,
            kept=f"last {_HISTORY_S:g} s",
            residual_title="Residual = measured - predicted [N m]",
        )

    def prepare(self) -> None:
        """Draw what does not move."""
        backdrop.draw_machine(self._stream, self._scribe.scene)
        backdrop.style_series(self._stream)
        backdrop.style_angle_curves(self._stream)
        backdrop.style_lanes(self._stream, self._lanes)
        self._draw_canvas("angle", self._scribe.torque_canvas)
        self._draw_canvas("by_angle", self._scribe.residual_canvas)

    def predicted(self, time: FloatArray, theta: FloatArray, torque: FloatArray, sigma: FloatArray) -> None:
        """Draw predictions, the linkage and the phases of the turn."""
        sensor = self._machine.sensors.torque
        shown = np.asarray(sensor.gain * torque + sensor.offset_Nm)
        self._fit_canvas(shown)
        scribe = self._scribe
        scribe.predicted(time + sensor.delay_s, shown, abs(sensor.gain) * sigma)
        # From the last sample before, so that lines and phases go on without a seam.
        theta = np.unwrap(np.concatenate([self._history[1][-1:], theta]))[-theta.size :]
        block = (time, theta, shown)
        joined = [np.concatenate([old[-1:], new]) for old, new in zip(self._history, block, strict=True)]
        scribe.over_angle("predicted", joined[0], joined[1], joined[2])
        frames = self._frames(time)
        if frames.size:
            scribe.motion(time[frames], self._positions(theta[frames]))
            scribe.now(time[frames], theta[frames], shown[frames])
        for lane in self._lanes:
            changes = state_changes(lane, joined[0], joined[1])
            known = bool(changes.states) and self._phases.get(lane.name) == changes.states[0]
            scribe.phases([changes.after(1) if known else changes])
            if changes.states:
                self._phases[lane.name] = changes.states[-1]
        kept = np.searchsorted(self._history[0], time[-1] - _HISTORY_S)
        self._history = tuple(np.concatenate([old[kept:], new]) for old, new in zip(self._history, block, strict=True))

    def measured(self, time: FloatArray, torque: FloatArray) -> None:
        """Draw measured torque."""
        self._fit_canvas(torque)
        self._scribe.measured(time, torque)
        block = (time, self._theta(time), torque)
        joined = [np.concatenate([old, new]) for old, new in zip(self._measured, block, strict=True)]
        for which in ("measured", "last"):
            self._scribe.over_angle(which, joined[0], joined[1], joined[2])
        self._measured = tuple(column[-1:] for column in block)

    def residual(self, time: FloatArray, residual: FloatArray, *, not_drawn: int) -> None:
        """Draw residuals and, once a second, their statistics; `not_drawn` samples had to be dropped so far."""
        self._scribe.residual(time, residual, self._limit)
        theta = self._theta(time)
        good = np.isfinite(theta) & np.isfinite(residual)
        self._bins.add(theta[good], residual[good])
        self._squares += float(residual[good] @ residual[good])
        self._count += int(np.count_nonzero(good))
        self._worst = max(self._worst, float(np.max(np.abs(residual[good]), initial=0.0)))
        if self._limit is not None:
            over = np.flatnonzero(good & (np.abs(residual) > self._limit))
            if over.size:
                k = over[np.argmax(np.abs(residual[over]))]
                angle = np.rad2deg(np.mod(theta[k], 2.0 * np.pi))
                self._scribe.say(float(time[k]), "WARN", f"residual {residual[k]:+.2f} N m at {angle:.0f}°")
        if time[-1] >= self._next_summary_s and self._count:
            self._next_summary_s = float(time[-1]) + _SUMMARY_S
            self._draw_statistics(float(time[-1]), not_drawn)

    def _draw_statistics(self, time_s: float, not_drawn: int) -> None:
        bins = self._bins.bins()
        canvas = canvas_for([bins.min_Nm, bins.max_Nm], *RESIDUAL_SIZE)
        if canvas.low < self._scribe.residual_canvas.low or canvas.high > self._scribe.residual_canvas.high:
            self._scribe = self._scribe.scaled(residual=canvas)
            self._draw_canvas("by_angle", canvas)
        self._scribe.residual_by_angle(bins, time_s)
        lines = [
            f"### {self._machine.name}, live",
            "",
            f"| time | {time_s:.1f} s |",
            "|---|---|",
            f"| shaft speed | {self._speed_rad_s() * 30.0 / np.pi:.1f} rpm |",
            f"| residuals | {self._count} |",
            f"| RMS residual | {np.sqrt(self._squares / self._count):.4f} N m |",
            f"| largest residual | {self._worst:.3f} N m |",
            f"| sensor delay, configured | {self._machine.sensors.torque.delay_s * 1e3:g} ms |",
            f"| samples not drawn | {not_drawn} |",
        ]
        self._scribe.summary("\n".join(lines), time_s)

    def _draw_canvas(self, origin: str, canvas: AngleCanvas) -> None:
        backdrop.draw_canvas(self._stream, origin, canvas, self._marks, inside_backing(self._lanes))

    def _fit_canvas(self, torque: FloatArray) -> None:
        """Widen the torque's scale when a torque passes it."""
        canvas = self._scribe.torque_canvas
        needed = canvas_for([torque], canvas.width, canvas.height)
        if needed.low < canvas.low or needed.high > canvas.high:
            limits = np.array([min(needed.low, canvas.low), max(needed.high, canvas.high)])
            self._scribe = self._scribe.scaled(torque=canvas_for([limits], canvas.width, canvas.height))
            self._draw_canvas("angle", self._scribe.torque_canvas)

    def _frames(self, time: FloatArray) -> IntArray:
        """The samples at which the linkage is drawn."""
        frames: list[int] = []
        for k, now in enumerate(time):
            if now >= self._next_frame_s:
                frames.append(k)
                self._next_frame_s = float(now) + self._frame_s
        return np.array(frames, dtype=np.int64)

    def _theta(self, time: FloatArray) -> FloatArray:
        """Shaft angle at stamp - delay, nan where no prediction is near."""
        known, theta, _ = self._history
        if known.size == 0:
            return np.full(time.size, np.nan)
        at = time - self._machine.sensors.torque.delay_s
        angle = np.asarray(np.interp(at, known, theta, left=np.nan, right=np.nan))
        # Measured torque may come a little before its prediction: the shaft turns on as it does.
        ahead = at - known[-1]
        soon = (ahead > 0.0) & (ahead <= _AHEAD_S)
        angle[soon] = theta[-1] + self._speed_rad_s() * ahead[soon]
        return angle

    def _speed_rad_s(self) -> float:
        """Mean speed of the latest predictions."""
        time, theta, _ = self._history
        if time.size < 2:
            return 0.0
        first = max(int(np.searchsorted(time, time[-1] - _AHEAD_S)) - 1, 0)
        return float((theta[-1] - theta[first]) / (time[-1] - time[first]))
