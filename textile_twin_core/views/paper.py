"""Common style of the pictures: the viewer's hues darkened for a white page, light axes, and the writer of PNG
files.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from textile_twin_core.errors import RecordingError

MEASURED, PREDICTED, RESIDUAL, BACKING = "#e07b00", "#0072b2", "#c2377a", "#2a9d63"
INK, MUTED, GRID = "#22272e", "#6b7480", "#e4e7eb"


def new_figure(width: float, height: float) -> Figure:
    """Create a white figure; width and height in hundreds of pixels."""
    figure = Figure(figsize=(width, height), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def dress(axes: Axes, title: str) -> None:
    """Set a title at the left and a light grid behind the data; remove the frame above and right."""
    axes.set_title(title, loc="left", fontsize=13, color=INK, pad=8)
    axes.grid(color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(colors=MUTED, labelsize=10.5)
    axes.spines[["top", "right"]].set_visible(False)


def show_one_turn(axes: Axes) -> None:
    """Label the x axis with the degrees of one turn."""
    ticks = np.arange(0.0, 361.0, 45.0)
    axes.set_xlim(0.0, 360.0)
    axes.set_xticks(ticks, [f"{tick:.0f}°" for tick in ticks])


def save_png(figure: Figure, path: str | os.PathLike[str]) -> Path:
    """Write the figure as PNG and return its path.

    Raises:
        RecordingError: The file cannot be written there.
    """
    target = Path(path)
    try:
        figure.savefig(target, format="png")
    except OSError as error:
        raise RecordingError(f"cannot write {target}: {error.strerror or error}") from error
    return target
