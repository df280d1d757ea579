"""Picture of a measured quantity over the shaft angle, the machine's beside it, and the residual."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from textile_twin_core.comparison.quantity import QuantityComparison, shown_unit
from textile_twin_core.views import paper

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
