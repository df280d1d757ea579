"""The figures of the four papers, drawn anew from the machines."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from matplotlib.figure import Figure

from textile_twin_core.views.figures import tufting

FIGURES: Mapping[str, Callable[[], Figure]] = {
    "tufting_figure_7": tufting.figure_7,
    "tufting_figure_8": tufting.figure_8,
    "tufting_figure_9": tufting.figure_9,
}
"""What draws each figure, by the name of its file."""
