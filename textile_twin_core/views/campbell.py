"""Campbell diagram of an elastic shaft on paper: natural frequencies and orders over the speed, and the mode shapes."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from textile_twin_core.driveline import Resonances
from textile_twin_core.views import paper

_RPM = 30.0 / np.pi
_MOST_MODES = 4
_NAMED = 8
_LABEL_SHARE = 0.03
"""Least distance between the numbers of two orders, over the size of the diagram."""
_COLOURS = ("#1f6f8b", "#c1440e", "#5b7f3a", "#7a4b94")


def plot_campbell(path: str | os.PathLike[str], found: Resonances, *, title: str) -> Path:
    """Write the Campbell diagram and the shapes of the lowest modes as one picture.

    Args:
        path: The .png file to write.
        found: Modes and critical speeds, from `find_resonances`.
        title: What the diagram is of.

    Returns:
        The path written.

    Raises:
        RecordingError: The file cannot be written there.
    """
    return paper.save_png(campbell_figure(found, title), path)


def campbell_figure(found: Resonances, title: str) -> Figure:
    """Draw the diagram on the left and the mode shapes on the right."""
    figure = paper.new_figure(16.0, 9.0)
    grid = figure.add_gridspec(1, 2, width_ratios=[1.7, 1.0], left=0.06, right=0.975, top=0.86, bottom=0.09, wspace=0.2)
    figure.suptitle(title, x=0.06, ha="left", fontsize=17, weight="bold", color=paper.INK)
    shown = sorted({each.mode for each in found.critical})[:_MOST_MODES] or list(range(1, _MOST_MODES + 1))
    shown = [number for number in shown if number <= len(found.modes)]
    _draw_diagram(figure.add_subplot(grid[0, 0]), found, shown)
    lowest = list(range(1, min(_MOST_MODES, len(found.modes)) + 1))
    _draw_shapes(figure.add_subplot(grid[0, 1]), found, sorted({*lowest[:-1], *shown})[:_MOST_MODES])
    return figure


def _draw_diagram(axes: Axes, found: Resonances, shown: list[int]) -> None:
    slow, fast = (speed * _RPM for speed in found.speeds_rad_s)
    top = 1.15 * max((found.modes[number - 1].highest_Hz for number in shown), default=1.0)
    critical = [each for each in found.critical if each.mode in shown]
    largest = max((each.share for each in critical), default=1.0)
    last = (math.inf, -math.inf)
    for order in sorted({each.order for each in critical}):
        strength = max(each.share for each in critical if each.order == order) / largest
        ends = [0.0, fast], [0.0, order * fast / 60.0]
        axes.plot(*ends, lw=0.6 + 0.6 * strength, color=paper.INK, alpha=0.15 + 0.35 * strength)
        end = min(fast, top * 60.0 / order)
        place = (end, order * end / 60.0)
        if last[0] - place[0] > _LABEL_SHARE * (fast - slow) or place[1] - last[1] > _LABEL_SHARE * top:
            last = place
            axes.annotate(f"{order}", place, (3, 2), textcoords="offset points", fontsize=8, annotation_clip=False)
    for number, colour in zip(shown, _COLOURS, strict=False):
        mode = found.modes[number - 1]
        axes.axhspan(mode.lowest_Hz, mode.highest_Hz, color=colour, alpha=0.13, lw=0)
        axes.axhline(mode.damped_Hz, color=colour, lw=1.8)
        axes.annotate(
            f"mode {number}: {mode.damped_Hz:.4g} Hz (undamped {mode.undamped_Hz:.4g})", (slow, mode.highest_Hz),
            xytext=(4, 3), textcoords="offset points", color=colour, fontsize=10, weight="bold",
        )  # fmt: skip
        own = [each for each in critical if each.mode == number]
        axes.scatter(
            [each.speed_rad_s * _RPM for each in own], [each.frequency_Hz for each in own],
            s=[12.0 + 160.0 * each.share / largest for each in own], color=colour, zorder=5, edgecolor="white", lw=0.8,
        )  # fmt: skip
    for each in sorted(critical, key=lambda each: -each.share)[:_NAMED]:
        axes.annotate(
            f"{each.speed_rad_s * _RPM:.0f}", (each.speed_rad_s * _RPM, each.frequency_Hz), xytext=(0, -15),
            textcoords="offset points", fontsize=9, ha="center", color=paper.INK, zorder=6,
        )  # fmt: skip
    axes.set(xlim=(slow, fast), ylim=(0.0, top), xlabel="speed of the main shaft [rpm]", ylabel="frequency [Hz]")
    axes.set_title(
        "Natural frequencies, their range over the turn (bands), and the orders that matter\n"
        "(lines, numbered); a dot's size is the share of the torque",
        loc="left", fontsize=10, color=paper.INK, pad=16,
    )  # fmt: skip


def _draw_shapes(axes: Axes, found: Resonances, shown: list[int]) -> None:
    places = np.arange(len(found.stations))
    axes.axhline(0.0, color=paper.INK, lw=0.7, alpha=0.5)
    for number, colour in zip(shown, _COLOURS, strict=False):
        mode = found.modes[number - 1]
        axes.plot(places, mode.shape, color=colour, marker="o", ms=4, lw=1.6, label=f"mode {number}")
    step = max(1, -(-len(places) // 18))
    axes.set_xticks(places[::step], found.stations[::step], fontsize=8)
    axes.set(ylim=(-1.1, 1.1), xlabel="station", ylabel="angle, largest 1")
    axes.set_title("Mode shapes", loc="left", fontsize=10, color=paper.INK)
    axes.legend(frameon=False, fontsize=9, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=_MOST_MODES)
