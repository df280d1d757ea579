"""Drawing of the motion, block by block: linkage, measures, phases and shaft speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.views import static_scene
from textile_twin_core.views.measure_curves import MeasureCurves, marks_for, phase_rows_for
from textile_twin_core.views.phases import Direction, inside_backing, state_changes
from textile_twin_core.views.recording_writer import Frames, RecordingWriter
from textile_twin_core.views.scene import PointPositions
from textile_twin_core.views.whole_width import WholeWidth

if TYPE_CHECKING:
    from textile_twin_core.machine.machine import Machine

HISTORY_S = 4.0
"""Time that shaft angles are stored to look up the angle of a measured torque [s]."""
_AHEAD_S = 0.2  # measured torque may be this far ahead of its prediction
_RPM = 30.0 / np.pi


class MotionDrawing:
    """Drawing of the motion of one machine, from one thread.

    Args:
        machine: Machine to draw.
        writer: Recording writer.
        frames_hz: Largest rate of pictures of the linkage [Hz].
        unwrapped: True if angles are unwrapped, across gaps too.
        width: All linkages of a machine with an elastic shaft, drawn by `stations`.
    """

    def __init__(
        self,
        machine: Machine,
        writer: RecordingWriter,
        frames_hz: float,
        unwrapped: bool,
        width: WholeWidth | None = None,
    ) -> None:
        self._width, self._width_frames = width, Frames(frames_hz)
        self._writer, self._frames, self._unwrapped = writer, Frames(frames_hz), unwrapped
        self.phase_rows, self.marks = phase_rows_for(machine), marks_for(machine)
        self.inside = inside_backing(self.phase_rows)
        self.curves = MeasureCurves(machine)
        self.canvas = self.curves.canvas()
        self._positions = PointPositions(machine)
        self._time, self._theta = np.empty(0), np.empty(0)
        self._phases: dict[str, str] = {}
        self._direction, self._backward = Direction(), np.empty(0, dtype=np.bool_)
        self._first_rad = np.nan

    def prepare(self, stream: rr.RecordingStream) -> None:
        """Draw the static parts."""
        static_scene.draw_machine(stream, self._writer.scene, names=self._width is None)
        if self._width is not None:
            self._width.prepare(stream)
        static_scene.style_phases(stream, self.phase_rows)
        static_scene.style_measures(stream, self.curves.names)
        if self.canvas is not None:
            static_scene.draw_canvas(stream, "travel_angle", self.canvas, self.marks, self.inside)
            for name, curve in self.curves.over_turn.items():
                static_scene.draw_curve(stream, f"travel_angle/{name}", self.canvas, self.curves.angles, curve)

    def draw(self, time: FloatArray, theta: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Draw a block of times (n,) [s] and shaft angles (n,) [rad], wrapped or not.

        Returns:
            Times and unwrapped angles, preceded by the last sample of the previous block so that lines join, and the
                indices
            of the samples at which the linkage was drawn.
        """
        before = self._theta[-1:]
        theta = np.concatenate([before, theta])
        theta = theta if self._unwrapped else np.unwrap(theta)
        times = np.concatenate([self._time[-1:], time])
        if np.isnan(self._first_rad):
            self._first_rad = float(theta[0])
        block = theta[before.size :]
        frames = self._frames.of(time)
        if frames.size:
            if self._width is None:
                self._writer.motion(time[frames], self._positions(block[frames]))
            if self.canvas is not None:
                for name, place in self.curves(block[frames]).items():
                    self._writer.point(f"travel_angle/now_{name}", self.canvas, time[frames], block[frames], place)
        for name, place in self.curves(block).items():
            self._writer.scalars(f"travel/{name}", time, place)
        step = np.diff(times)
        turned = np.flatnonzero(step > 0.0)
        self._writer.scalars("speed/shaft", times[1:][turned], np.diff(theta)[turned] / step[turned] * _RPM)
        self._draw_phases(times, theta)
        oldest = np.searchsorted(self._time, time[-1] - HISTORY_S)
        self._time = np.concatenate([self._time[oldest:], time])
        self._theta = np.concatenate([self._theta[oldest:], block])
        return times, theta, frames

    def stations(self, time: FloatArray, stations_rad: FloatArray) -> None:
        """Draw all linkages from the angles of the stations of an elastic shaft (n, stations) [rad]."""
        frames = self._width_frames.of(time)
        if frames.size and self._width is not None:
            self._writer.whole_width(time[frames], self._width, stations_rad[frames])

    @property
    def turns(self) -> float:
        """Turns of the shaft since the first sample."""
        return float(self._theta[-1] - self._first_rad) / (2.0 * np.pi) if self._theta.size else 0.0

    @property
    def speed_rad_s(self) -> float:
        """Mean speed over the latest samples [rad/s]."""
        time, theta = self._time, self._theta
        if time.size < 2:
            return 0.0
        first = max(int(np.searchsorted(time, time[-1] - _AHEAD_S)) - 1, 0)
        return float((theta[-1] - theta[first]) / (time[-1] - time[first])) if time[-1] > time[first] else 0.0

    @property
    def speed_rpm(self) -> float:
        """Mean speed over the latest samples [rpm]."""
        return self.speed_rad_s * _RPM

    def angle_at(self, time: FloatArray) -> FloatArray:
        """Interpolate the shaft angle at times (n,) [s]; NaN beyond the stored angles."""
        if self._time.size == 0:
            return np.full(time.size, np.nan)
        angle = np.asarray(np.interp(time, self._time, self._theta, left=np.nan, right=np.nan))
        # A measured torque may arrive before its prediction: extrapolate the angle at the present speed.
        ahead = time - self._time[-1]
        soon = (ahead > 0.0) & (ahead <= _AHEAD_S)
        angle[soon] = self._theta[-1] + self.speed_rad_s * ahead[soon]
        return angle

    def _draw_phases(self, time: FloatArray, theta: FloatArray) -> None:
        before = self._backward[-1:]
        self._backward = np.concatenate([before, self._direction.take(theta[before.size :])])
        for row in self.phase_rows:
            changes = state_changes(row, time, theta, self._backward)
            known = bool(changes.states) and self._phases.get(row.name) == changes.states[0]
            self._writer.phases([changes.after(1) if known else changes])
            if changes.states:
                self._phases[row.name] = changes.states[-1]
