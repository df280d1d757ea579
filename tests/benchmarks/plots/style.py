"""Common style of the benchmark's pictures: colours, axes, and writing of files."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

OURS, LIMIT, COMPILED, ENGINES, OTHERS = "#0072b2", "#d55e00", "#8a4fa8", "#55606d", "#2a8f63"
INK, MUTED, GRID = "#22272e", "#6b7480", "#e4e7eb"
_DPI = 130


def new_figure(width: float, height: float) -> Figure:
    """Create a white figure of this size in inches with automatic layout."""
    figure = Figure(figsize=(width, height), dpi=_DPI, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def dress(axes: Axes, x: str, y: str) -> None:
    """Set logarithmic axes with their names, a light grid and no frame above and right."""
    axes.set(xscale="log", yscale="log", xlabel=x, ylabel=y)
    axes.grid(True, which="major", color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(which="both", colors=MUTED, labelcolor=INK)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(MUTED)


def save(figure: Figure, path: Path) -> None:
    """Write the figure as PNG, for any suffix of the path."""
    figure.savefig(path, dpi=_DPI, format="png")
