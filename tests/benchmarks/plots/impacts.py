"""Plot of the error of the needle transfer's event times against run time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tests.benchmarks.impact_table import EVENT_DRIVEN, PENALTY, ImpactRow
from tests.benchmarks.plots import style
from tests.benchmarks.plots.labels import Annotation, place_labels

FLOOR_S = 1e-18
"""Lower bound of drawn errors: half a unit in the last place of the event times."""
_OTHER_COLOURS = (style.LIMIT, style.COMPILED, style.OTHERS)


def plot_impacts(rows: Sequence[ImpactRow], path: Path) -> None:
    """Draw the rows into a PNG: one line per method, with its settings at the points."""
    methods = list(dict.fromkeys(row.method for row in rows))
    others = iter(_OTHER_COLOURS)
    figure = style.new_figure(10.0, 6.0)
    axes = figure.add_subplot()
    style.dress(axes, "time for a run [ms]", "larger error of the two event times [s]")
    labels, lines = [], []
    for method in methods:
        group = [row for row in rows if row.method == method]
        colour = style.OURS if method == EVENT_DRIVEN else style.ENGINES if method == PENALTY else next(others)
        ours = method == EVENT_DRIVEN
        points = [(row.ms_per_run, max(row.error_s, FLOOR_S)) for row in group]
        lines.append(points)
        axes.plot(
            *zip(*points, strict=True), color=colour, marker="o" if ours else "s", markersize=9.0 if ours else 6.0,
            linewidth=2.2 if ours else 1.2, markeredgecolor="white", label=f"{method} (ours)" if ours else method,
            zorder=4 if ours else 3,
        )  # fmt: skip
        names = [row.setting.removeprefix("tolerance ").removeprefix("rtol ") for row in group]
        labels += [Annotation(x, y, name, colour, ours) for name, (x, y) in zip(names, points, strict=True)]
    axes.margins(x=0.12, y=0.08)
    axes.autoscale_view()
    axes.set_autoscale_on(False)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_title(
        "needle transfer, forward stroke to the first contact of the collets", loc="left", fontweight="bold",
        color=style.INK,
    )  # fmt: skip
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    place_labels(axes, labels, lines)
    style.save(figure, path)
