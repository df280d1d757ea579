"""Common style of the redrawn figures: white paper, light grids, a palette for colour-blind readers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from textile_twin_core.arrays import FloatArray

BLUE, ORANGE, GREEN, PINK, SKY, BROWN = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#8C5A00"
INK, FAINT, PRINTED = "#1d2733", "#7b8794", "#444444"
BAND = "#f6f0e4"

_STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "text.color": INK,
    "axes.edgecolor": "#9aa5b1",
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6eaee",
    "grid.linewidth": 0.7,
    "xtick.color": "#52606d",
    "ytick.color": "#52606d",
    "lines.linewidth": 1.6,
    "lines.solid_joinstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "legend.handlelength": 1.2,
    "figure.dpi": 150.0,
    "savefig.dpi": 150.0,
    "mathtext.default": "regular",
}


def figure(
    rows: int, columns: int, size: tuple[float, float], title: str, note: str, sharey: bool = False
) -> tuple[Figure, list[Axes]]:
    """Create a figure of rows x columns panels with a title and a note below; panels are in reading order."""
    with rc_context(_STYLE):
        made = Figure(figsize=size, layout="constrained", facecolor="white")
        made.suptitle(title, x=0.008, ha="left", fontsize=11.5, fontweight="bold")
        made.supxlabel(note, x=0.008, ha="left", fontsize=8.0, color=FAINT)
        grid = made.subplots(rows, columns, sharex=True, sharey=sharey, squeeze=False)
    panels: list[Axes] = list(grid.flat)
    return made, panels


def panel(axes: Axes, letter: str, what: str, unit: str) -> None:
    """Set the title of a panel: its letter as printed, its quantity and unit."""
    axes.set_title(f"{letter})  {what} [{unit}]" if letter else f"{what} [{unit}]", loc="left", fontsize=9.5)


def curves(axes: Axes, x: FloatArray, named: Sequence[tuple[str, FloatArray, str]]) -> None:
    """Draw curves with label and colour, and a legend when there are several."""
    for label, values, colour in named:
        axes.plot(x, values, color=colour, label=label)
    if len(named) > 1:
        legend(axes, len(named))


def legend(axes: Axes, columns: int) -> None:
    """Add a legend above the panel, right of its title."""
    with rc_context(_STYLE):
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.985), ncols=columns, columnspacing=1.0, borderaxespad=0.1)


def shaft_axis(axes: Axes, label: str, turns: int = 1) -> None:
    """Label the x axis with the shaft angle in degrees over whole turns."""
    axes.set_xlim(0.0, 360.0 * turns)
    axes.set_xticks(np.arange(0, 360 * turns + 1, 60 if turns == 1 else 120))
    if label:
        axes.set_xlabel(label)


def marked(axes: Axes, x: float, y: float, text: str, offset: tuple[float, float], side: str = "left") -> None:
    """Mark a printed value with a hollow ring and its text."""
    axes.plot([x], [y], "o", ms=6.0, mfc="white", mec=PRINTED, mew=1.2, zorder=5, clip_on=False)
    axes.annotate(text, (x, y), offset, textcoords="offset points", ha=side, va="center", fontsize=8.0, color=PRINTED)
