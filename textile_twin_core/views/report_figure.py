"""Figure of the residual of a comparison: over the recording, per turn, by order, by speed."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from textile_twin_core.comparison import Comparison
from textile_twin_core.views import paper

_MOST_POINTS = 20_000


def errors_figure(comparison: Comparison) -> Figure:
    """Draw the figure, 1600 x 800 pixels."""
    figure = paper.new_figure(16.0, 8.0)
    grid = figure.add_gridspec(2, 2, left=0.05, right=0.98, top=0.94, bottom=0.08, hspace=0.36, wspace=0.16)
    _over_time(figure.add_subplot(grid[0, 0]), comparison)
    _per_turn(figure.add_subplot(grid[0, 1]), comparison)
    _by_order(figure.add_subplot(grid[1, 0]), comparison)
    _by_speed(figure.add_subplot(grid[1, 1]), comparison)
    return figure


def _over_time(axes: Axes, comparison: Comparison) -> None:
    used = np.flatnonzero(comparison.used)
    shown = used[:: max(1, used.size // _MOST_POINTS)]
    time = (comparison.stamps_ns[shown] - comparison.stamps_ns[used[0]]) * 1e-9
    axes.plot(time, comparison.residual_Nm[shown], color=paper.RESIDUAL, linewidth=0.5, rasterized=True)
    _dress(axes, "Residual over the recording, N m", "s")


def _per_turn(axes: Axes, comparison: Comparison) -> None:
    turns = comparison.by_revolution
    axes.plot(
        turns.number - turns.number[0], turns.rms_Nm, ".-", color=paper.INK, linewidth=0.8, markersize=3, label="RMS"
    )
    axes.plot(turns.number - turns.number[0], turns.mean_Nm, color=paper.RESIDUAL, linewidth=1.2, label="mean")
    axes.legend(frameon=False, fontsize=10, loc="upper right")
    _dress(axes, "Residual of each turn, N m", "turn of the shaft")


def _by_order(axes: Axes, comparison: Comparison) -> None:
    orders = comparison.by_order
    axes.bar(orders.order, orders.amplitude_Nm, color=paper.RESIDUAL, width=0.6)
    _dress(axes, "Residual by order of the shaft, amplitude, N m", "order; 0 is the mean")


def _by_speed(axes: Axes, comparison: Comparison) -> None:
    speed = comparison.by_speed
    middle = 0.5 * (speed.low_rad_s + speed.high_rad_s) * 30.0 / np.pi
    width = 0.9 * (speed.high_rad_s - speed.low_rad_s) * 30.0 / np.pi
    axes.bar(middle, np.nan_to_num(speed.rms_Nm), width=np.where(width > 0.0, width, 1.0), color="#9aa4b0", label="RMS")
    axes.plot(middle, speed.mean_Nm, "o", color=paper.RESIDUAL, label="mean")
    axes.legend(frameon=False, fontsize=10, loc="upper right")
    _dress(axes, "Residual by speed, N m", "rpm")


def _dress(axes: Axes, title: str, below: str) -> None:
    paper.dress(axes, title)
    axes.set_xlabel(below, color=paper.MUTED)
