"""Draws what a shaft's angle alone tells, block by block: the linkage, its measures, phases, the shaft's speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.views import backdrop
from textile_twin_core.views.frames import Frames
from textile_twin_core.views.phases import Direction, inside_backing, state_changes
from textile_twin_core.views.scene import PointPositions
from textile_twin_core.views.scribe import Scribe
from textile_twin_core.views.travels import Travels, lanes_for, marks_for
from textile_twin_core.views.whole_width import WholeWidth

if TYPE_CHECKING:
    from textile_twin_core.machine.machine import Machine

HISTORY_S = 4.0
"""The shaft's angle is kept so long, to find it for a measured torque."""
_AHEAD_S = 0.2  # measured torque may be this far ahead of its prediction
_RPM = 30.0 / np.pi


class MotionDrawing:
    """Draws one machine's motion; for one thread.

    `frames_hz`: the most pictures of the linkage in a second. `unwrapped`: angles count the turns, across gaps too.
    `width`: all linkages of a machine with an elastic shaft, drawn from `stations`.
    """

    def __init__(
        self, machine: Machine, scribe: Scribe, frames_hz: float, unwrapped: bool, width: WholeWidth | None = None
    ) -> None:
        self._width, self._width_frames = width, Frames(frames_hz)
        self._scribe, self._frames, self._unwrapped = scribe, Frames(frames_hz), unwrapped
        self.lanes, self.marks = lanes_for(machine), marks_for(machine)
        self.inside = inside_backing(self.lanes)
        self.travels = Travels(machine)
        self.canvas = self.travels.canvas()
        self._positions = PointPositions(machine)
        self._time, self._theta = np.empty(0), np.empty(0)
        self._phases: dict[str, str] = {}
        self._direction, self._backward = Direction(), np.empty(0, dtype=np.bool_)
        self._first_rad = np.nan

    def prepare(self, stream: rr.RecordingStream) -> None:
        """Draw what does not move."""
        backdrop.draw_machine(stream, self._scribe.scene, names=self._width is None)
        if self._width is not None:
            self._width.prepare(stream)
        backdrop.style_lanes(stream, self.lanes)
        backdrop.style_travels(stream, self.travels.names)
        if self.canvas is not None:
            backdrop.draw_canvas(stream, "travel_angle", self.canvas, self.marks, self.inside)
            for name, curve in self.travels.over_turn.items():
                backdrop.draw_curve(stream, f"travel_angle/{name}", self.canvas, self.travels.angles, curve)

    def draw(self, time: FloatArray, theta: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Draw a block: times (n,), shaft angles (n,), wrapped or not.

        Returns times and unwrapped angles, begun with the last sample of the block before, so that lines go on without
        a seam, and the places in the block at which the linkage was drawn.
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
                self._scribe.motion(time[frames], self._positions(block[frames]))
            if self.canvas is not None:
                for name, place in self.travels(block[frames]).items():
                    self._scribe.point(f"travel_angle/now_{name}", self.canvas, time[frames], block[frames], place)
        for name, place in self.travels(block).items():
            self._scribe.scalars(f"travel/{name}", time, place)
        step = np.diff(times)
        turned = np.flatnonzero(step > 0.0)
        self._scribe.scalars("speed/shaft", times[1:][turned], np.diff(theta)[turned] / step[turned] * _RPM)
        self._draw_phases(times, theta)
        kept = np.searchsorted(self._time, time[-1] - HISTORY_S)
        self._time = np.concatenate([self._time[kept:], time])
        self._theta = np.concatenate([self._theta[kept:], block])
        return times, theta, frames

    def stations(self, time: FloatArray, stations_rad: FloatArray) -> None:
        """Draw all linkages from the angles of an elastic shaft's stations (n, stations)."""
        frames = self._width_frames.of(time)
        if frames.size and self._width is not None:
            self._scribe.whole_width(time[frames], self._width, stations_rad[frames])

    @property
    def turns(self) -> float:
        """Turns of the shaft since the first sample."""
        return float(self._theta[-1] - self._first_rad) / (2.0 * np.pi) if self._theta.size else 0.0

    @property
    def speed_rad_s(self) -> float:
        """Mean speed over the latest samples."""
        time, theta = self._time, self._theta
        if time.size < 2:
            return 0.0
        first = max(int(np.searchsorted(time, time[-1] - _AHEAD_S)) - 1, 0)
        return float((theta[-1] - theta[first]) / (time[-1] - time[first])) if time[-1] > time[first] else 0.0

    @property
    def speed_rpm(self) -> float:
        """The same in turns a minute."""
        return self.speed_rad_s * _RPM

    def angle_at(self, time: FloatArray) -> FloatArray:
        """Shaft angle at times (n,), nan where none is known nearby."""
        if self._time.size == 0:
            return np.full(time.size, np.nan)
        angle = np.asarray(np.interp(time, self._time, self._theta, left=np.nan, right=np.nan))
        # Measured torque may come a little before its prediction: the shaft turns on as it does.
        ahead = time - self._time[-1]
        soon = (ahead > 0.0) & (ahead <= _AHEAD_S)
        angle[soon] = self._theta[-1] + self.speed_rad_s * ahead[soon]
        return angle

    def _draw_phases(self, time: FloatArray, theta: FloatArray) -> None:
        before = self._backward[-1:]
        self._backward = np.concatenate([before, self._direction.take(theta[before.size :])])
        for lane in self.lanes:
            changes = state_changes(lane, time, theta, self._backward)
            known = bool(changes.states) and self._phases.get(lane.name) == changes.states[0]
            self._scribe.phases([changes.after(1) if known else changes])
            if changes.states:
                self._phases[lane.name] = changes.states[-1]
