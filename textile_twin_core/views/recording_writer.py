"""Recording writer: motion, torques and phases of a machine as columns, for files and for live views."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison import AngleBins
from textile_twin_core.comparison.alignment import GAP_PERIODS
from textile_twin_core.views import palette
from textile_twin_core.views.angle_canvas import AngleCanvas, line_ends, split_turns
from textile_twin_core.views.drawable import drawable
from textile_twin_core.views.layout import TIMELINE
from textile_twin_core.views.phases import StateChanges
from textile_twin_core.views.scene import MachineScene, poses
from textile_twin_core.views.whole_width import LINKS, WholeWidth

_SEGMENT = 8  # samples of a line in the plot over the shaft angle
_MOST_SEGMENTS = 20_000
"""Largest number of line segments of one torque over the angle; an hour at 500 Hz and 160 rpm gives half turns."""
_BLOCK = 65_536
"""Samples per call of the viewer's writer; whole hours at once would fill the memory."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordingWriter:
    """Writer of one recording of one machine.

    Times are seconds from the start of the recording; values that are not finite are drawn as gaps.
    """

    stream: rr.RecordingStream
    scene: MachineScene
    torque_canvas: AngleCanvas
    residual_canvas: AngleCanvas

    def scaled(self, *, torque: AngleCanvas | None = None, residual: AngleCanvas | None = None) -> RecordingWriter:
        """Return a writer of the same recording with other scales for the plots over the shaft angle."""
        return RecordingWriter(self.stream, self.scene, torque or self.torque_canvas, residual or self.residual_canvas)

    def motion(self, time_s: FloatArray, points: dict[str, FloatArray], under: str = LINKS) -> None:
        """Write the pose of a linkage at times (n,) from the positions (n, 2) of its points."""
        times = at_times(time_s)
        for part in self.scene.moving:
            place, angle = poses(part, points)
            zero = np.zeros_like(angle)
            turn = np.column_stack([zero, zero, np.sin(0.5 * angle), np.cos(0.5 * angle)])
            columns = rr.Transform3D.columns(translation=place.astype(np.float32), quaternion=turn.astype(np.float32))
            self.stream.send_columns(f"{under}/{part.name}", times, columns)

    def whole_width(self, time_s: FloatArray, width: WholeWidth, stations_rad: FloatArray) -> None:
        """Write every linkage and the shaft at times (n,) from the angles of the stations (n, stations) [rad]."""
        drawn = width.angles(stations_rad)
        for place in width.row:
            under = f"world/base/row/{place.number}/links" if place.number else LINKS
            self.motion(time_s, width.points(place.number, drawn), under)
        columns = rr.LineStrips3D.columns(strips=list(width.line(drawn).astype(np.float32)))
        self.stream.send_columns("world/base/shaft/line", at_times(time_s), columns)

    def predicted(self, time_s: FloatArray, torque_Nm: FloatArray, sigma_Nm: FloatArray) -> None:
        """Write predicted torque over time, with its standard deviation (NaN where unknown)."""
        for part in blocks(time_s.size):
            variance = np.where(np.isfinite(sigma_Nm[part]), sigma_Nm[part], 0.0) ** 2
            columns = rr.Measurements.columns(values=torque_Nm[part], variances=variance)
            self.stream.send_columns("torque/predicted", at_times(time_s[part]), columns)

    def measured(self, time_s: FloatArray, torque_Nm: FloatArray) -> None:
        """Write measured torque over time."""
        self.scalars("torque/measured", time_s, torque_Nm)

    def residual(self, time_s: FloatArray, residual_Nm: FloatArray, limit_Nm: float | None) -> None:
        """Write the residual over time, and its limit where there is one."""
        self.scalars("residual/residual", time_s, residual_Nm)
        if limit_Nm is not None and time_s.size:
            ends = time_s[[0, -1]]
            self.scalars("residual/limit_upper", ends, np.full(2, limit_Nm))
            self.scalars("residual/limit_lower", ends, np.full(2, -limit_Nm))
            over = np.abs(residual_Nm) > limit_Nm
            self.scalars("residual/over_limit", time_s[over], residual_Nm[over])

    def over_angle(self, which: str, time_s: FloatArray, theta_rad: FloatArray, torque_Nm: FloatArray) -> None:
        """Write a torque over the shaft angle as short lines, which the viewer shows for some turns."""
        length = max(_SEGMENT, time_s.size // _MOST_SEGMENTS)
        for block in blocks(time_s.size - 1, max(1, _BLOCK // length) * length):
            part = slice(block.start, min(block.stop + 1, time_s.size))
            points = self.torque_canvas.place(theta_rad[part], torque_Nm[part])
            first, end = line_ends(theta_rad[part], points, length)
            if first.size:
                drawn = points.astype(np.float32)
                strips = [drawn[a:b] for a, b in zip(first, end, strict=True)]
                ends = time_s[part][np.minimum((first // length + 1) * length, len(points) - 1)]
                self.stream.send_columns(f"angle/{which}", at_times(ends), rr.LineStrips2D.columns(strips=strips))

    def point(
        self, entity: str, canvas: AngleCanvas, time_s: FloatArray, theta_rad: FloatArray, value: FloatArray
    ) -> None:
        """Write the present point of a plot over the shaft angle."""
        points = canvas.place(theta_rad, value).astype(np.float32)
        self.stream.send_columns(entity, at_times(time_s), rr.Points2D.columns(positions=points))

    def phases(self, changes: Sequence[StateChanges]) -> None:
        """Write the changes of phase, row by row."""
        for change in changes:
            if change.time_s.size:
                columns = rr.StateChange.columns(state=list(change.states))
                self.stream.send_columns(f"phase/{change.row}", at_times(change.time_s), columns)

    def say(self, time_s: float, level: str, text: str) -> None:
        """Write a line into the list of events."""
        say(self.stream, time_s, level, text)

    def summary(self, markdown: str, time_s: float | None = None) -> None:
        """Write the summary of the run; `time_s` as in `residual_by_angle`."""
        self._log_at(time_s, "summary", rr.TextDocument(drawable(markdown), media_type="text/markdown"))

    def residual_by_angle(self, bins: AngleBins, time_s: float | None = None) -> None:
        """Write mean, spread (one standard deviation) and extremes of the residual over the shaft angle.

        Args:
            bins: Statistics by bin of the shaft angle.
            time_s: Time of the statistics in a live view, whose server drops old data; None: static for the recording.
        """
        canvas = self.residual_canvas
        good = bins.count > 0
        x = canvas.x(bins.centre_rad[good])
        step = canvas.width / bins.centre_rad.size

        def columns(low: FloatArray, high: FloatArray) -> list[FloatArray]:
            return [np.array([(a, b), (a, c)]) for a, b, c in zip(x, canvas.y(low), canvas.y(high), strict=True)]

        mean, std = bins.mean_Nm[good], bins.std_Nm[good]
        self._log_at(
            time_s,
            "by_angle/extremes",
            rr.LineStrips2D(
                columns(bins.min_Nm[good], bins.max_Nm[good]),
                radii=[0.42 * step],
                colors=[palette.dim(palette.RESIDUAL, 0.2)],
                draw_order=0.0,
            ),
        )
        self._log_at(
            time_s,
            "by_angle/spread",
            rr.LineStrips2D(
                columns(mean - std, mean + std),
                radii=[0.42 * step],
                colors=[palette.dim(palette.RESIDUAL, 0.5)],
                draw_order=1.0,
            ),
        )
        self._log_at(
            time_s,
            "by_angle/mean",
            rr.LineStrips2D(
                split_turns(bins.centre_rad, canvas.place(bins.centre_rad, bins.mean_Nm)),
                radii=[-1.4],
                colors=[palette.NOW],
                draw_order=2.0,
            ),
        )

    def _log_at(self, time_s: float | None, entity: str, drawn: rr.AsComponents) -> None:
        if time_s is not None:
            self.stream.set_time(TIMELINE, duration=float(time_s))
        self.stream.log(entity, drawn, static=time_s is None)

    def scalars(self, entity: str, time_s: FloatArray, values: FloatArray) -> None:
        """Write a series of numbers over time."""
        scalars(self.stream, entity, time_s, values)


def gap_times(time_s: FloatArray) -> FloatArray:
    """Return start and end of each gap between samples (n,) at increasing times [s]; lines over time break there.

    Both ends are needed because the viewer looks only as far as the next sample beside the displayed time.
    """
    step = np.diff(time_s)
    if not step.size:
        return np.empty(0)
    usual = float(np.median(step))
    gap = step > GAP_PERIODS * usual
    return np.column_stack([time_s[:-1][gap] + 0.5 * usual, time_s[1:][gap] - 0.5 * usual]).ravel()


def turn_s(time_s: FloatArray, theta_rad: FloatArray) -> float:
    """Return the duration of one turn at the median speed [s]; 1 s for a shaft at standstill."""
    speed = float(np.median(np.abs(np.diff(theta_rad)) / np.maximum(np.diff(time_s), 1e-9))) if time_s.size > 1 else 0.0
    return 2.0 * np.pi / speed if speed > 1e-3 else 1.0


def blocks(count: int, size: int = _BLOCK) -> Iterator[slice]:
    """Iterate over `count` samples in blocks of at most `size`."""
    return (slice(first, min(first + size, count)) for first in range(0, count, size))


def scalars(stream: rr.RecordingStream, entity: str, time_s: FloatArray, values: FloatArray) -> None:
    """Write numbers (n,) over time [s]."""
    for part in blocks(time_s.size):
        stream.send_columns(entity, at_times(time_s[part]), rr.Scalars.columns(scalars=values[part]))


def say(stream: rr.RecordingStream, time_s: float, level: str, text: str) -> None:
    """Write a line into the list of events; level: INFO, WARN or ERROR."""
    stream.set_time(TIMELINE, duration=float(time_s))
    stream.log("events", rr.TextLog(f"{time_s:7.2f} s  {drawable(text)}", level=level))


def at_times(time_s: FloatArray) -> list[rr.TimeColumn]:
    """Convert times (n,) [s] to the viewer's column of times."""
    return [rr.TimeColumn(TIMELINE, duration=np.round(time_s * 1e9).astype("timedelta64[ns]"))]


class Frames:
    """Selector of samples at a limited rate [Hz]."""

    def __init__(self, rate_hz: float) -> None:
        self._period_s, self._next_s = 1.0 / rate_hz, -math.inf

    def of(self, time_s: FloatArray) -> IntArray:
        """Return the indices of the samples to draw in the next block of increasing times (n,) [s]."""
        chosen = []
        for k, now in enumerate(time_s.tolist()):
            if now >= self._next_s:
                chosen.append(k)
                self._next_s = now + self._period_s
        return np.array(chosen, dtype=np.int64)
