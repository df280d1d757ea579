"""Work-precision plot: error against time per sample, for our methods, the limit in C and the peers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from tests.benchmarks.plots import style
from tests.benchmarks.plots.labels import Annotation, place_labels
from textile_twin_core.bench.ratios import COMPILED, RIGID_BODIES
from textile_twin_core.bench.run import Row

FLOOR = 1e-16
"""Lower bound of drawn errors: about half a unit in the last place of a double."""
_ROOM = 1e-17
_GROUPS = {
    "textile-twin": (style.OURS, "o", 10.0),
    "the same closed form in C": (style.LIMIT, "D", 5.5),
    "the same closed form, compiled by a library": (style.COMPILED, "s", 5.5),
    "rigid-body engine": (style.ENGINES, "^", 7.0),
    "other library": (style.OTHERS, "v", 7.0),
}


def plot_work_precision(rows: Sequence[Row], path: Path) -> None:
    """Draw the rows of the torque with a batch time and an error into a PNG; a line joins the Pareto front of
    our methods.
    """
    shown = [row for row in rows if row.outputs == "torque" and row.ns_per_sample and row.error_over_peak is not None]
    figure = style.new_figure(10.0, 6.0)
    axes = figure.add_subplot()
    style.dress(axes, "time per sample in a batch [ns]", "largest error / peak")
    at = {row: (row.ns_per_sample or 1.0, max(row.error_over_peak or 0.0, FLOOR)) for row in shown}
    for row, (x, y) in at.items():
        colour, marker, size = _GROUPS[_group(row)]
        axes.plot(
            x, y, marker, color=colour, markersize=size, markeredgecolor="white", markeredgewidth=0.8,
            zorder=4 if row.peer is None else 5,
        )  # fmt: skip
    ours = front([at[row] for row in shown if row.peer is None])
    axes.plot(*zip(*ours, strict=True), color=style.OURS, linewidth=2.2, alpha=0.55, zorder=3)
    _limits(axes, list(at.values()))
    exact = next((x for row, (x, _) in at.items() if row.peer is None and row.method == "exact"), None)
    if exact is not None:
        _compare_above(axes, exact)
    axes.set_title(f"{shown[0].machine}, torque: error against time", loc="left", fontweight="bold", color=style.INK)
    present = [name for name in _GROUPS if any(_group(row) == name for row in shown)]
    handles = [
        Line2D([], [], color=colour, marker=marker, markersize=size, linewidth=2.2 if name == "textile-twin" else 0.0)
        for name, (colour, marker, size) in _GROUPS.items()
        if name in present
    ]
    figure.legend(handles, present, loc="outside lower center", ncols=len(present), frameon=False, fontsize=8)
    labels = [Annotation(x, y, row.name, _GROUPS[_group(row)][0], row.peer is None) for row, (x, y) in at.items()]
    place_labels(axes, labels, (ours, [(limit, FLOOR) for limit in axes.get_xlim()]))
    style.save(figure, path)


def front(places: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the Pareto-optimal pairs (time, error), by falling error."""
    kept = [a for a in places if not any(b[0] <= a[0] and b[1] <= a[1] and b != a for b in places)]
    return sorted(kept, key=lambda place: -place[1])


def _group(row: Row) -> str:
    ours, limit, compiled, engine, other = _GROUPS
    if row.peer is None:
        return ours
    if row.peer == "C":
        return limit
    return compiled if row.peer in COMPILED else engine if row.peer in RIGID_BODIES else other


def _compare_above(axes: Axes, exact: float) -> None:
    """Add a second scale: time as a multiple of our exact method's."""
    top = axes.secondary_xaxis("top", functions=(lambda x: np.asarray(x) / exact, lambda x: np.asarray(x) * exact))
    top.set_xlabel("times the time of our exact method", color=style.MUTED, fontsize=8)
    top.xaxis.set_major_formatter("{x:g}")
    top.tick_params(which="both", colors=style.MUTED, labelsize=8)
    top.spines["top"].set_visible(False)


def _limits(axes: Axes, points: Sequence[tuple[float, float]]) -> None:
    """Set the limits with space for names around the points, and a floor."""
    times, errors = zip(*points, strict=True)
    axes.set_xlim(min(times) / 4.0, max(times) * 5.0)
    axes.set_ylim(_ROOM, max(max(errors) * 30.0, 1e-12))
    axes.axhspan(_ROOM, FLOOR, color="#f3f5f7", zorder=0)
    axes.axhline(FLOOR, color=style.MUTED, linewidth=1.0, linestyle=(0, (4, 3)), zorder=1)
    axes.text(
        0.995, FLOOR / 1.3, "rounding of a double, 1e-16", transform=axes.get_yaxis_transform(), ha="right", va="top",
        fontsize=8, color=style.MUTED,
    )  # fmt: skip
    axes.set_yticks([tick for tick in (10.0**k for k in range(-16, 3, 2)) if tick < axes.get_ylim()[1]])
