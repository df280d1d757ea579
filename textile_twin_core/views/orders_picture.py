"""Picture of an order analysis: map over time, map over speed, and order spectrum of each signal."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from scipy.interpolate import CubicSpline

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison import Comparison
from textile_twin_core.comparison.orders import MAX_ORDER, PER_WINDOW, TURN, OrderMap, order_map
from textile_twin_core.driveline import Resonances
from textile_twin_core.views import paper

_RPM = 30.0 / np.pi
_DECADES = 1e3
"""Range of the colours below the largest amplitude: three decades."""
_NAMED = 5


def plot_orders(path: str | os.PathLike[str], maps: Mapping[str, OrderMap], *, title: str) -> Path:
    """Write the order maps of signals as one picture.

    Args:
        path: The .png file to write.
        maps: Order map by signal name with unit.
        title: Name of the analysed recording.

    Returns:
        The path written.

    Raises:
        RecordingError: The file cannot be written there.
    """
    figure = orders_figure(maps)
    figure.suptitle(title, x=0.045, ha="left", fontsize=17, weight="bold", color=paper.INK)
    return paper.save_png(figure, path)


def orders_figure(maps: Mapping[str, OrderMap], resonances: Resonances | None = None) -> Figure:
    """Draw a row of three plots for each signal, 1600 pixels wide.

    With `resonances` of an elastic shaft, the maps over speed also show its natural frequencies as lines and its
    critical speeds as dots, where an order of the machine's own torque meets a natural frequency.
    """
    height = 0.9 + 4.1 * len(maps)
    figure = paper.new_figure(16.0, height)
    grid = figure.add_gridspec(
        len(maps), 3, width_ratios=[1.5, 1.0, 1.0], left=0.045, right=0.985, top=1.0 - 0.95 / height,
        bottom=0.55 / height, wspace=0.2, hspace=0.42,
    )  # fmt: skip
    for row, (name, found) in enumerate(maps.items()):
        top = float(np.nanmax(found.amplitude[1:]))
        scale = LogNorm(max(top / _DECADES, 1e-300), max(top, 1e-299))
        _over_time(figure.add_subplot(grid[row, 0]), name, found, scale)
        over_speed = figure.add_subplot(grid[row, 1])
        _over_speed(figure, over_speed, found, scale)
        if resonances is not None:
            _draw_resonances(over_speed, found, resonances)
        _spectrum(figure.add_subplot(grid[row, 2]), found)
    return figure


def comparison_orders(comparison: Comparison) -> dict[str, OrderMap]:
    """Compute the order maps of shaft speed, measured torque and residual of a comparison.

    Raises:
        RecordingError: The shaft makes too few turns in one direction without a gap.
    """
    origin = int(comparison.predicted_stamps_ns[0])
    time = np.asarray((comparison.predicted_stamps_ns - origin) * 1e-9)
    measured = np.asarray((comparison.stamps_ns - origin) * 1e-9)
    speed = np.asarray(CubicSpline(time, comparison.predicted_theta_rad)(time, 1))
    return {
        "speed [rad/s]": order_map(time, comparison.predicted_theta_rad, speed, max_order=MAX_ORDER),
        "torque [N m]": order_map(measured, comparison.theta_rad, comparison.measured_Nm, max_order=MAX_ORDER),
        "residual [N m]": order_map(measured, comparison.theta_rad, comparison.residual_Nm, max_order=MAX_ORDER),
    }


def _over_time(axes: Axes, name: str, found: OrderMap, scale: LogNorm) -> None:
    _map(axes, _time_edges(found), found.order, found.amplitude, scale)
    paper.dress(axes, f"{name}: order over time")
    axes.grid(False)
    axes.set_xlabel("time from the start of the recording, s", color=paper.MUTED)
    axes.set_ylabel("order of the shaft", color=paper.MUTED)
    speed = axes.twinx()
    speed.plot(found.time_s, found.speed_rad_s * _RPM, color="white", linewidth=2.6)
    speed.plot(found.time_s, found.speed_rad_s * _RPM, color=paper.MEASURED, linewidth=1.2)
    speed.set_ylim(0.0, 1.15 * float(found.speed_rad_s.max()) * _RPM)
    speed.set_ylabel("speed, rpm", color=paper.MEASURED, labelpad=1)
    speed.tick_params(colors=paper.MEASURED, labelsize=9.5)
    speed.spines[["top"]].set_visible(False)


def _over_speed(figure: Figure, axes: Axes, found: OrderMap, scale: LogNorm) -> None:
    edges, columns = found.over_speed()
    shown = _map(axes, edges * _RPM, found.order, columns, scale)
    paper.dress(axes, "Order over speed")
    axes.grid(False)
    axes.set_xlabel("speed, rpm", color=paper.MUTED)
    bar = figure.colorbar(shown, ax=axes, pad=0.02)
    bar.ax.tick_params(colors=paper.MUTED, labelsize=9)


def _draw_resonances(axes: Axes, found: OrderMap, resonances: Resonances) -> None:
    """Draw the order of each mode over the speed, and the critical speeds on it."""
    low, high = (value for value in axes.get_xlim())
    rpm = np.linspace(max(low, 1e-3 * high), high, 200)
    top = float(found.order[-1])
    for number, mode in enumerate(resonances.modes, start=1):
        order = 60.0 * mode.damped_Hz / rpm
        if not (0.0 < order.min() < top):
            break
        axes.plot(rpm, order, color="white", linewidth=2.0, alpha=0.5)
        axes.plot(rpm, order, color=paper.PREDICTED, linewidth=1.0)
        shown = np.flatnonzero(order < top)
        k = int(shown[shown.size // 2])
        axes.annotate(
            f"mode {number}: {mode.damped_Hz:.4g} Hz", (rpm[k], order[k]), (0, 9), textcoords="offset points",
            fontsize=8.5, ha="center", va="bottom", color="white", weight="bold",
            bbox={"facecolor": paper.PREDICTED, "edgecolor": "none", "pad": 1.5},
        )  # fmt: skip
        met = [each for each in resonances.critical if each.mode == number and each.order < top]
        axes.scatter(
            [each.speed_rad_s * _RPM for each in met], [each.order for each in met], s=22.0, color="white",
            edgecolor=paper.PREDICTED, linewidth=1.3, zorder=5,
        )  # fmt: skip
    axes.set_xlim(low, high)


def _spectrum(axes: Axes, found: OrderMap) -> None:
    axes.plot(found.order[1:], found.spectrum[1:], color=paper.INK, linewidth=1.0)
    for peak in found.peaks()[:_NAMED]:
        axes.annotate(
            f"{round(peak.order, 2):g}", (peak.order, peak.amplitude), (0, 5), textcoords="offset points", ha="center",
            fontsize=10, color=paper.RESIDUAL, weight="bold",
        )  # fmt: skip
    axes.set_xlim(0.0, float(found.order[-1]))
    # A change of speed appears below the first orders and would dwarf them.
    axes.set_ylim(0.0, 1.15 * max((peak.amplitude for peak in found.peaks()), default=1.0))
    paper.dress(axes, "Order spectrum, amplitude")
    axes.set_xlabel("order of the shaft", color=paper.MUTED)


def _map(axes: Axes, across: FloatArray, order: FloatArray, amplitude: FloatArray, scale: LogNorm) -> QuadMesh:
    half = 0.5 * float(order[1])
    axes.set_facecolor(paper.GRID)
    rows = np.append(order - half, order[-1] + half)
    shown_values = np.maximum(amplitude, float(scale.vmin or 0.0))
    shown = axes.pcolormesh(across, rows, shown_values, norm=scale, cmap="magma", rasterized=True)
    axes.set_ylim(0.0, float(order[-1]))
    return shown


def _time_edges(found: OrderMap) -> FloatArray:
    """Return the edges (w + 1,) between the windows [s]."""
    time = found.time_s
    half = found.turns * TURN / (2 * PER_WINDOW) / found.speed_rad_s[[0, -1]]
    return np.concatenate([[time[0] - half[0]], 0.5 * (time[1:] + time[:-1]), [time[-1] + half[1]]])
