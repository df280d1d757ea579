"""Figures of the four papers, redrawn from the machines."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from matplotlib.figure import Figure

from textile_twin_core.views.figures import elliptic_gear_beatup, handloom_beatup, needle_transfer, tufting

FIGURES: Mapping[str, Callable[[], Figure]] = {
    "tufting_figure_7": tufting.figure_7,
    "tufting_figure_8": tufting.figure_8,
    "tufting_figure_9": tufting.figure_9,
    "handloom_beatup_figure_6": handloom_beatup.figure_6,
    "handloom_beatup_figure_7": handloom_beatup.figure_7,
    "needle_transfer_figure_6": needle_transfer.figure_6,
    "needle_transfer_figure_7": needle_transfer.figure_7,
    "needle_transfer_figure_8": needle_transfer.figure_8,
    "needle_transfer_figure_9": needle_transfer.figure_9,
    "elliptic_gear_beatup_figure_4": elliptic_gear_beatup.figure_4,
}
"""What draws each figure, by the name of its file."""
