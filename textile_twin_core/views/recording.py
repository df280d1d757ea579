"""Comparison as a recording of the rerun viewer, with the layout inside."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison import Comparison, summary_rows, verdict_lines
from textile_twin_core.files.atomic import staged
from textile_twin_core.views import static_scene
from textile_twin_core.views.angle_canvas import RESIDUAL_SIZE, TORQUE_SIZE, AngleCanvas, canvas_for
from textile_twin_core.views.drawable import drawable
from textile_twin_core.views.force_law_plot import ForceLawPlot
from textile_twin_core.views.layout import Layout
from textile_twin_core.views.measure_curves import marks_for, phase_rows_for
from textile_twin_core.views.phases import Direction, inside_backing, state_changes
from textile_twin_core.views.recording_writer import Frames, RecordingWriter, blocks, gap_times, turn_s
from textile_twin_core.views.rrd_file import written
from textile_twin_core.views.scene import PointPositions, build_scene
from textile_twin_core.views.whole_width import WholeWidth, largest_twist

if TYPE_CHECKING:
    from textile_twin_core.machine.machine import Machine

APPLICATION = "textile-twin"
_FRAME_RATE_HZ = 125.0  # of the moving linkage: 18 pictures a turn at 400 rpm
_WIDTH_BLOCK = 4096
_TURNS = 10
_LIMIT = 2.0  # over the median, in the first turns, of the largest residual of a turn
_FIRST_TURNS = 20
_NAMED = 40  # turns over the limit that the list of events names


def write_comparison_recording(
    path: str | os.PathLike[str],
    comparison: Comparison,
    machine: Machine,
    *,
    title: str,
    stations: tuple[IntArray, FloatArray] | None = None,
) -> Path:
    """Write a comparison as a recording for `rerun`: moving machine, torques, residual, summary.

    The file appears once it is complete.

    Args:
        path: The .rrd file to write.
        comparison: Result of `compare_torque`.
        machine: Machine whose linkage is shown.
        title: Name of the recording, for the summary.
        stations: For a machine with an elastic shaft, stamps (k,) [ns] and angles (k, stations) [rad] of its stations.

    Returns:
        The path written.

    Raises:
        OutputError: The file cannot be written there.
        RecordingError: Writing fails before the end of the file.
    """
    with staged(Path(path)) as partial:
        _write(partial, comparison, machine, title, stations)
    return Path(path)


def _write(
    path: Path,
    comparison: Comparison,
    machine: Machine,
    title: str,
    stations: tuple[IntArray, FloatArray] | None,
) -> None:
    origin = int(comparison.predicted_stamps_ns[0])
    limit = limit_of(comparison)
    predicted_s = _seconds(comparison.predicted_stamps_ns, origin)
    measured_s = _seconds(comparison.stamps_ns, origin)
    theta = comparison.predicted_theta_rad
    scene = build_scene(machine)
    width = None if stations is None else WholeWidth(machine, scene, largest_twist(machine, stations[1]))
    phase_rows, marks = phase_rows_for(machine), marks_for(machine)
    inside = inside_backing(phase_rows)
    torque_canvas, residual_canvas = _canvases(comparison)
    period = turn_s(predicted_s, theta)
    law = ForceLawPlot.of(machine, comparison.curves)
    layout = Layout(
        machine=drawable(machine.name),
        scene=scene,
        travel=None,
        measures=(),
        phase_rows=len(phase_rows),
        torque=torque_canvas,
        residual=residual_canvas,
        window_s=(2.4 * period, 0.4 * period),
        turn_s=period,
        history_s=_TURNS * period,
        history=f"last {_TURNS} turns",
        residual_title=f"Residual = measured - predicted [N m], limit {limit:.2f}",
        width=width,
        force_law=None if law is None else (law.title, law.canvas),
    )

    stream = rr.RecordingStream(APPLICATION, recording_id=f"{drawable(machine.name)}-{origin}")
    with written(stream, path, layout.blueprint()):
        writer = RecordingWriter(stream, scene, torque_canvas, residual_canvas)
        stream.send_recording_name(drawable(title))
        static_scene.draw_machine(stream, scene, names=width is None)
        if width is not None:
            width.prepare(stream)
        static_scene.style_series(stream)
        static_scene.style_angle_curves(stream)
        static_scene.style_phases(stream, phase_rows)
        static_scene.draw_canvas(stream, "angle", torque_canvas, marks, inside)
        static_scene.draw_canvas(stream, "by_angle", residual_canvas, marks, inside)
        if law is not None:
            law.draw(stream)
        writer.summary(summary_markdown(comparison, title, limit))

        step = max(1, int(predicted_s.size / max(predicted_s[-1] * _FRAME_RATE_HZ, 1.0)))
        frames = np.arange(0, predicted_s.size, step)
        positions = PointPositions(machine)
        if width is not None and stations is not None:
            times = _seconds(stations[0], origin)
            shown_at = Frames(_FRAME_RATE_HZ).of(times)
            for part in blocks(shown_at.size, _WIDTH_BLOCK):
                writer.whole_width(times[shown_at[part]], width, stations[1][shown_at[part]])
        for part in blocks(frames.size if width is None else 0):
            writer.motion(predicted_s[frames[part]], positions(theta[frames[part]]))
        if law is not None:
            law.follow(stream, predicted_s[frames], theta[frames])
        # Apply the sensor model, so that both curves and the residual refer to the same instant.
        shown = comparison.predicted_reading_Nm
        sigma = abs(comparison.sensor_gain) * comparison.predicted_sigma_Nm
        writer.predicted(predicted_s + comparison.delay.value, shown, sigma)
        gaps = gap_times(predicted_s) + comparison.delay.value
        writer.predicted(gaps, np.full_like(gaps, np.nan), np.full_like(gaps, np.nan))
        writer.over_angle("predicted", predicted_s, theta, shown)
        writer.point("angle/now", torque_canvas, predicted_s[frames], theta[frames], shown[frames])
        writer.measured(measured_s, comparison.measured_Nm)
        writer.residual(measured_s, comparison.residual_Nm, limit)
        for which in ("measured", "last"):
            writer.over_angle(which, measured_s, comparison.theta_rad, comparison.measured_Nm)
        backward = Direction().take(theta)
        writer.phases([state_changes(row, predicted_s, theta, backward) for row in phase_rows])
        writer.residual_by_angle(comparison.by_angle)
        _say(writer, comparison, origin, limit)


def limit_of(comparison: Comparison) -> float:
    """Return the residual [N m] that no turn exceeds while the machine behaves as in its first turns.

    The limit is a multiple of the typical maximum per turn. A multiple of the RMS error would be exceeded in every
    other turn of a sound machine, since a turn has hundreds of samples.
    """
    worst = np.abs(comparison.by_revolution.worst_Nm)
    worst = worst[np.isfinite(worst)]
    if not worst.size:
        return _LIMIT * 3.0 * comparison.errors.rms_error_Nm
    return _LIMIT * max(float(np.median(worst[:_FIRST_TURNS])), comparison.errors.rms_error_Nm)


def summary_markdown(comparison: Comparison, title: str, limit_Nm: float) -> str:
    """Format the summary of the run as markdown: recording, numbers, verdict and notes."""
    rows = summary_rows(comparison)
    head, *others = [(name, value) for name, value in rows if name != "note"]
    lines = [f"### {title}", "", f"| {head[0]} | {head[1]} |", "|---|---|"]
    lines += [f"| {name} | {value} |" for name, value in others]
    lines += [f"| limit shown | {limit_Nm:.3f} N m |"]
    lines += ["", *(f"**{line}**  " for line in verdict_lines(comparison))]
    lines += ["", *(f"*{value}*" for name, value in rows if name == "note")]
    return "\n".join(lines)


def _say(writer: RecordingWriter, comparison: Comparison, origin: int, limit: float) -> None:
    """List the events: start of the comparison, verdict, and each turn that exceeds the limit."""
    start = float(_seconds(comparison.stamps_ns[comparison.used][0], origin))
    writer.say(start, "INFO", "comparison starts: the shaft estimate has converged")
    for cause in comparison.verdict:
        writer.say(start, "WARN", cause.text)
    turns = comparison.by_revolution
    over = np.flatnonzero(np.abs(turns.worst_Nm) > limit)
    worst = over[np.argsort(-np.abs(turns.worst_Nm[over]), kind="stable")]
    if worst.size > _NAMED:
        writer.say(start, "INFO", f"{worst.size} turns pass the limit; the {_NAMED} worst are listed")
    for k in np.sort(worst[:_NAMED]):
        angle = np.rad2deg(turns.worst_rad[k])
        text = f"turn {turns.number[k]}: residual {turns.worst_Nm[k]:+.2f} N m at {angle:.0f}°"
        writer.say(float(_seconds(turns.worst_ns[k], origin)), "WARN", text)


def _canvases(comparison: Comparison) -> tuple[AngleCanvas, AngleCanvas]:
    used = comparison.used
    torque = canvas_for([comparison.measured_Nm[used], comparison.expected_Nm[used]], *TORQUE_SIZE)
    bins = comparison.by_angle
    residual = canvas_for([bins.min_Nm, bins.max_Nm], *RESIDUAL_SIZE)
    return torque, residual


def _seconds(stamps_ns: IntArray, origin: int) -> FloatArray:
    return np.asarray((stamps_ns - origin) * 1e-9, dtype=np.float64)
