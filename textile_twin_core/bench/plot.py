"""The work-precision plot: error against time per sample, our methods beside their peers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from textile_twin_core.bench.run import Row

_OURS, _LIMIT, _PEERS = "#0b6e99", "#c8553d", "#7a8794"
_FLOOR = 1e-16
_CROWDED = 1e-13
"""Below this error many stand side by side: their names lean."""


def plot_work_precision(rows: Sequence[Row], path: Path, scene: str = "torque") -> None:
    """Draw the rows of one scene that have a batch time and an error into a PNG."""
    shown = [r for r in rows if r.outputs == scene and r.ns_per_sample and r.error_over_peak is not None]
    figure = Figure(figsize=(9.0, 5.4), layout="constrained")
    axes = figure.add_subplot()
    for row in shown:
        colour = _OURS if row.peer is None else _LIMIT if row.peer == "C" else _PEERS
        x, y = row.ns_per_sample or 1.0, max(row.error_over_peak or 0.0, _FLOOR)
        axes.plot(x, y, "o" if row.peer is None else "s", color=colour, markersize=8, zorder=3)
        label = row.method if row.peer is None else f"{row.peer}, {row.method}"
        leaning = {"rotation": 60, "xytext": (-2, 6)} if y < _CROWDED else {"xytext": (7, 4)}
        axes.annotate(label, (x, y), textcoords="offset points", fontsize=8, color=colour, **leaning)
    ours = sorted((r.ns_per_sample or 0.0, max(r.error_over_peak or 0.0, _FLOOR)) for r in shown if r.peer is None)
    axes.plot(*zip(*ours, strict=True), color=_OURS, linewidth=1.0, alpha=0.5)
    axes.set(xscale="log", yscale="log", xlabel="time per sample [ns], batch", ylabel="largest error / peak")
    axes.set_title(f"{shown[0].machine}, {scene}: error against time", loc="left", fontweight="bold")
    axes.grid(True, which="major", color="#e3e7ea")
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0.15)
    figure.savefig(path, dpi=130)
