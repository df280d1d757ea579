"""Plot of the torque error of the shaft estimators against latency and cost."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from tests.benchmarks.plots import style
from tests.benchmarks.plots.labels import Annotation, place_labels
from tests.benchmarks.shaft_signal import KNOCKS, MANY_ORDERS, RATE_HZ, STEADY
from tests.benchmarks.shaft_table import DRAWN_BITS, NO_ALPHA, ShaftRow

_COLOURS = {STEADY: style.OURS, KNOCKS: style.LIMIT, MANY_ORDERS: style.OTHERS}
_MARKERS = {16: "o", 14: "v", 12: "s", 10: "D", 8: "^"}
_SHORTEST_S = 1.0 / RATE_HZ


def plot_shaft(rows: Sequence[ShaftRow], path: Path) -> None:
    """Draw the rows of the speed with the most resolutions into a PNG: error against latency, error against cost."""
    speeds = {row.rpm: {r.bits for r in rows if r.rpm == row.rpm} for row in rows}
    rpm = max(speeds, key=lambda speed: len(speeds[speed]))
    shown = [row for row in rows if row.rpm == rpm and row.bits in DRAWN_BITS]
    figure = style.new_figure(12.0, 5.6)
    by_latency, by_cost = figure.subplots(1, 2, sharey=True)
    style.dress(
        by_latency, "latency [s]: causal, one sample; smooth, half the record", "RMS error of the torque / peak"
    )
    style.dress(by_cost, "processor time [us per sample]", "")
    labels: list[Annotation] = []
    nameless: list[tuple[float, float]] = []
    for load, bits in sorted({(row.load, row.bits) for row in shown}):
        group = [row for row in shown if (row.load, row.bits) == (load, bits) and row.us_per_sample]
        kind = {"color": _COLOURS[load], "marker": _MARKERS[bits], "markersize": 6.0, "markeredgecolor": "white"}
        errors = [row.torque_rms_over_peak for row in group]
        latencies = sorted(zip([max(row.latency_s or 0.0, _SHORTEST_S) for row in group], errors, strict=True))
        _draw(by_latency, latencies, kind, linewidth=1.2)
        costs = [(row.us_per_sample or 1.0, error) for row, error in zip(group, errors, strict=True)]
        _draw(by_cost, costs, kind, linewidth=0.0)
        if bits == max(DRAWN_BITS):
            labels += [Annotation(*at, row.estimator, _COLOURS[load]) for row, at in zip(group, costs, strict=True)]
        else:
            nameless += costs
    _reference(by_latency, by_cost, [row for row in shown if row.estimator == NO_ALPHA and row.load == STEADY])
    by_cost.margins(x=0.25)
    by_cost.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    by_cost.xaxis.set_major_formatter("{x:g}")
    by_cost.xaxis.set_minor_formatter(NullFormatter())
    by_latency.set_title(
        f"{shown[0].machine}, {rpm:g} rpm: torque from an encoder's angles", loc="left", fontweight="bold",
        color=style.INK,
    )  # fmt: skip
    by_cost.set_title(f"names: {max(DRAWN_BITS)} bit", loc="right", fontsize=8, color=style.MUTED)
    handles = [Line2D([], [], color=colour, linewidth=2.2) for colour in _COLOURS.values()]
    handles += [Line2D([], [], color=style.MUTED, marker=_MARKERS[b], linewidth=0.0) for b in DRAWN_BITS]
    names = [*_COLOURS, *(f"{bits} bit" for bits in DRAWN_BITS)]
    figure.legend(handles, names, loc="outside lower center", ncols=len(names), frameon=False, fontsize=8)
    by_cost.autoscale_view()
    by_cost.set_autoscale_on(False)
    place_labels(by_cost, labels, nameless=nameless)
    style.save(figure, path)


def _draw(axes: Axes, points: Sequence[tuple[float, float]], kind: dict[str, object], linewidth: float) -> None:
    axes.plot(*zip(*points, strict=True), linewidth=linewidth, **kind)  # type: ignore[arg-type]


def _reference(left: Axes, right: Axes, rows: Sequence[ShaftRow]) -> None:
    """Draw the error with known angle and speed but without acceleration."""
    for axes in (left, right):
        axes.axhline(rows[0].torque_rms_over_peak, color=style.MUTED, linewidth=1.0, linestyle=(0, (4, 3)))
    left.annotate(
        NO_ALPHA, (1.0, rows[0].torque_rms_over_peak), xycoords=("axes fraction", "data"), xytext=(-2, 3),
        textcoords="offset points", ha="right", fontsize=8, color=style.MUTED,
    )  # fmt: skip
