"""Comparison on one page: machine, torque or another quantity over time and angle, residual."""

from __future__ import annotations

import os
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.comparison import Comparison
from textile_twin_core.comparison.quantity import QuantityComparison, shown_unit
from textile_twin_core.views import paper
from textile_twin_core.views.phases import inside_backing, marks_of, phase_rows_of
from textile_twin_core.views.plot_linkage import draw_linkage
from textile_twin_core.views.recording_writer import gap_times
from textile_twin_core.views.scene import build_scene

if TYPE_CHECKING:
    from textile_twin_core.machine.machine import Machine

_SHOWN_TURNS = 3.0
_KEPT_TURNS = 20


def plot_comparison(path: str | os.PathLike[str], comparison: Comparison, machine: Machine, *, title: str = "") -> Path:
    """Write the comparison as one picture of 1600 x 1000 pixels.

    Args:
        path: The .png file to write.
        comparison: Result of `compare_torque`.
        machine: Machine whose linkage is sketched.
        title: Name of the recording; the machine's name by default.

    Returns:
        The path written.

    Raises:
        RecordingError: The file cannot be written there.
    """
    scene = build_scene(machine)
    figure = paper.new_figure(16.0, 10.0)
    grid = figure.add_gridspec(
        2, 3, width_ratios=[0.72, 1.6, 1.35], height_ratios=[1.0, 1.0], left=0.025, right=0.978, top=0.885, bottom=0.07,
        wspace=0.17, hspace=0.27,
    )  # fmt: skip
    _headline(figure, comparison, title or machine.name)
    draw_linkage(figure.add_subplot(grid[:, 0]), scene, machine)
    inside = inside_backing(phase_rows_of(comparison.events))
    marks = marks_of(comparison.events)
    over_time, over_angle = figure.add_subplot(grid[0, 1]), figure.add_subplot(grid[0, 2])
    residual, by_angle = figure.add_subplot(grid[1, 1], sharex=over_time), figure.add_subplot(grid[1, 2])
    window = _window(comparison)
    _torque_over_time(over_time, comparison, window, inside)
    _torque_over_angle(over_angle, comparison, inside, marks)
    _residual_over_time(residual, comparison, window, inside)
    _residual_by_angle(by_angle, comparison, inside, marks)
    return paper.save_png(figure, path)


def _headline(figure: Figure, comparison: Comparison, title: str) -> None:
    errors = comparison.errors
    figure.text(0.025, 0.955, title, fontsize=19, weight="bold", color=paper.INK)
    facts = [
        f"RMS error {errors.rms_error_Nm:.3f} N m, {errors.rms_over_peak * 100.0:.2f} % of the peak",
        f"correlation {errors.correlation:.5f}",
        f"sensor delay {comparison.delay.value * 1e3:.2f} ms, gain {comparison.fitted_gain:.3f}",
        f"{comparison.revolutions:.0f} turns, {comparison.samples.used} samples used, "
        f"{comparison.samples.rejected} rejected",
    ]
    figure.text(0.025, 0.922, "     ".join(facts), fontsize=12.5, color=paper.MUTED)


def _window(comparison: Comparison) -> tuple[float, float]:
    """Choose a few whole turns in the middle of the comparison [s from the first prediction]."""
    used = np.flatnonzero(comparison.used)
    turn = np.floor(comparison.theta_rad[used] / (2.0 * np.pi))
    middle = turn[turn.size // 2]
    least = max(middle - _SHOWN_TURNS / 2.0, turn.min())
    chosen = used[(turn >= np.floor(least)) & (turn < np.floor(least) + _SHOWN_TURNS)]
    time = (comparison.stamps_ns - comparison.predicted_stamps_ns[0]) * 1e-9
    return float(time[chosen[0]]), float(time[chosen[-1]])


def _torque_over_time(axes: Axes, comparison: Comparison, window: tuple[float, float], inside: BoolArray) -> None:
    time, measured = _measured(comparison)
    shown = (time >= window[0]) & (time <= window[1])
    predicted_time = (
        comparison.predicted_stamps_ns - comparison.predicted_stamps_ns[0]
    ) * 1e-9 + comparison.delay.value
    expected = comparison.predicted_reading_Nm
    sigma = comparison.predicted_sigma_Nm
    gaps = gap_times(predicted_time)  # no line is drawn across them
    at = np.searchsorted(predicted_time, gaps)
    predicted_time = np.insert(predicted_time, at, gaps)
    expected, sigma = (np.insert(values, at, np.nan) for values in (expected, sigma))
    in_window = (predicted_time >= window[0]) & (predicted_time <= window[1])
    _shade_times(axes, time[shown], comparison.theta_rad[shown], inside)
    axes.plot(time[shown], measured[shown], color=paper.MEASURED, linewidth=1.5, label="measured")
    axes.plot(predicted_time[in_window], expected[in_window], color=paper.PREDICTED, linewidth=1.5, label="predicted")
    sigma = sigma[in_window]
    if np.isfinite(sigma).any():
        spread = np.nan_to_num(sigma) * abs(comparison.sensor_gain)
        axes.fill_between(
            predicted_time[in_window],
            expected[in_window] - spread,
            expected[in_window] + spread,
            color=paper.PREDICTED,
            alpha=0.25,
            linewidth=0,
        )
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False, fontsize=11, borderaxespad=0.1)
    _dress(axes, "Torque on the main shaft", "N m")
    axes.set_xlim(*window)


def _torque_over_angle(axes: Axes, comparison: Comparison, inside: BoolArray, marks: list[tuple[str, float]]) -> None:
    used = np.flatnonzero(comparison.used)
    turn = np.floor(comparison.theta_rad[used] / (2.0 * np.pi))
    middle = turn[turn.size // 2]
    near = np.abs(turn - middle) < _KEPT_TURNS / 2
    chosen, turns = used[near], np.unique(turn[near]).size
    degrees = np.rad2deg(np.mod(comparison.theta_rad[chosen], 2.0 * np.pi))
    _shade_angles(axes, inside)
    axes.plot(
        degrees, comparison.measured_Nm[chosen], ".", color=paper.MEASURED, markersize=2.2, alpha=0.55, rasterized=True
    )
    order = np.argsort(degrees)
    x, y = degrees[order], comparison.expected_Nm[chosen][order]
    for part in _pieces(x, marks):
        axes.plot(x[part], y[part], color=paper.PREDICTED, linewidth=1.8)
    _mark(axes, marks)
    _dress(axes, f"Torque over shaft angle, {f'{turns} turns' if turns > 1 else 'one turn'}", "N m")
    paper.show_one_turn(axes)


def _residual_over_time(axes: Axes, comparison: Comparison, window: tuple[float, float], inside: BoolArray) -> None:
    time, _ = _measured(comparison)
    shown = (time >= window[0]) & (time <= window[1])
    _shade_times(axes, time[shown], comparison.theta_rad[shown], inside)
    axes.axhline(0.0, color=paper.MUTED, linewidth=0.9)
    axes.plot(time[shown], comparison.residual_Nm[shown], color=paper.RESIDUAL, linewidth=1.3)
    _dress(axes, "Residual = measured - predicted", "N m")
    axes.set_xlabel("time from the start of the recording, s", color=paper.MUTED)


def _residual_by_angle(axes: Axes, comparison: Comparison, inside: BoolArray, marks: list[tuple[str, float]]) -> None:
    bins = comparison.by_angle
    degrees = np.rad2deg(bins.centre_rad)
    _shade_angles(axes, inside)
    axes.axhline(0.0, color=paper.MUTED, linewidth=0.9)
    for low, high, alpha, label in (
        (bins.min_Nm, bins.max_Nm, 0.16, "extremes"),
        (bins.mean_Nm - bins.std_Nm, bins.mean_Nm + bins.std_Nm, 0.38, "sigma"),
    ):
        axes.fill_between(degrees, low, high, step="mid", color=paper.RESIDUAL, alpha=alpha, linewidth=0, label=label)
    axes.plot(degrees, bins.mean_Nm, color=paper.INK, linewidth=1.5, drawstyle="steps-mid", label="mean")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, frameon=False, fontsize=9.5, borderaxespad=0.1,
                columnspacing=1.0, handlelength=1.4)  # fmt: skip
    _mark(axes, marks)
    _dress(axes, "Residual by angle", "N m")
    paper.show_one_turn(axes)
    axes.set_xlabel("shaft angle", color=paper.MUTED)


def _measured(comparison: Comparison) -> tuple[FloatArray, FloatArray]:
    return (comparison.stamps_ns - comparison.predicted_stamps_ns[0]) * 1e-9, comparison.measured_Nm


def _pieces(degrees: FloatArray, marks: list[tuple[str, float]]) -> list[slice]:
    """Split a sorted angle at the marks, so that no line crosses a discontinuity."""
    cuts = np.searchsorted(degrees, np.rad2deg([angle for _, angle in marks]))
    edges = [0, *sorted(int(cut) for cut in cuts), degrees.size]
    return [slice(a, b) for a, b in pairwise(edges) if b > a]


def _shade_angles(axes: Axes, inside: BoolArray) -> None:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        axes.axvspan(
            start * 360.0 / inside.size, end * 360.0 / inside.size, color=paper.BACKING, alpha=0.09, linewidth=0
        )


def _shade_times(axes: Axes, time: FloatArray, theta: FloatArray, inside: BoolArray) -> None:
    place = (np.mod(np.nan_to_num(theta), 2.0 * np.pi) * (inside.size / (2.0 * np.pi))).astype(np.int64)
    within = inside[np.clip(place, 0, inside.size - 1)]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], within, [False]]).astype(np.int8)))
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        axes.axvspan(float(time[start]), float(time[end - 1]), color=paper.BACKING, alpha=0.09, linewidth=0)


def _mark(axes: Axes, marks: list[tuple[str, float]]) -> None:
    for name, angle in marks:
        axes.axvline(np.rad2deg(angle), color=paper.BACKING, linewidth=1.1, linestyle=(0, (4, 3)))
        axes.annotate(
            f"{name} {np.rad2deg(angle):.1f}°", (np.rad2deg(angle), 0.985), xycoords=("data", "axes fraction"),
            xytext=(5, 0), textcoords="offset points", va="top", color=paper.BACKING, fontsize=10.5,
        )  # fmt: skip


def _dress(axes: Axes, title: str, unit: str) -> None:
    paper.dress(axes, f"{title}, {unit}")
    axes.spines[["left", "bottom"]].set_color("#c3c9d1")


_MOST_POINTS = 20_000


def plot_quantity(path: str | os.PathLike[str], found: QuantityComparison, title: str) -> Path:
    """Write the picture, 1400 x 900 pixels, as PNG, and return its path.

    Raises:
        RecordingError: The file cannot be written there.
    """
    unit, factor = shown_unit(found.name)
    few = np.linspace(0, found.time_s.size - 1, min(found.time_s.size, _MOST_POINTS)).astype(np.int64)
    angle = np.rad2deg(np.mod(found.theta_rad[few], 2.0 * np.pi))
    order = np.argsort(angle)
    residual = found.measured[few] - found.expected[few]
    figure = paper.new_figure(14.0, 9.0)
    said = (
        f"scale {found.scale.value:.4f}, delay {found.delay_s.value * 1e3:.2f} ms,"
        f" zero {np.degrees(found.zero_rad.value):+.2f} deg; residual {found.rms * factor:.3g} {unit} RMS;"
        f" range over a turn {found.measured_range * factor:.4g} {unit}, of the machine"
        f" {found.machine_range * factor:.4g} {unit}"
    )
    figure.text(0.055, 0.955, f"{title}: {found.name}", fontsize=17, weight="bold", color=paper.INK)
    figure.text(0.055, 0.922, said, fontsize=12, color=paper.MUTED)
    grid = figure.add_gridspec(
        2, 1, height_ratios=[2.2, 1.0], left=0.055, right=0.98, top=0.87, bottom=0.07, hspace=0.2
    )
    above, below = figure.add_subplot(grid[0]), figure.add_subplot(grid[1])
    above.plot(angle, found.measured[few] * factor, ".", color=paper.MEASURED, markersize=2.0, label="measured")
    above.plot(
        angle[order], found.expected[few][order] * factor, color=paper.PREDICTED, linewidth=1.3, label="machine, fitted"
    )
    above.legend(loc="upper center", frameon=False, fontsize=11)
    below.plot(angle, residual * factor, ".", color=paper.MEASURED, markersize=2.0)
    for axes, name in ((above, found.name), (below, "residual")):
        axes.set_title(f"{name}, {unit}" if unit else name, loc="left", fontsize=12, color=paper.INK)
        paper.show_one_turn(axes)
        axes.grid(color=paper.GRID, linewidth=0.8)
        axes.tick_params(colors=paper.MUTED)
        axes.spines[["top", "right"]].set_visible(False)
    return paper.save_png(figure, path)
