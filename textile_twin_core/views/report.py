"""Report: one HTML file with verdict, numbers, plots, configuration and provenance."""

from __future__ import annotations

import base64
import io
import math
import os
import tempfile
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from html import escape
from importlib.metadata import version
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from textile_twin_core.comparison import Comparison, agrees_with_file, summary_rows, verdict_lines
from textile_twin_core.comparison.orders import OrderMap
from textile_twin_core.driveline import Resonances, elastic_shaft, find_resonances
from textile_twin_core.errors import RecordingError
from textile_twin_core.inference.learned_curve import LearnedCurve
from textile_twin_core.machine import Machine
from textile_twin_core.views import paper
from textile_twin_core.views.orders_picture import comparison_orders, orders_figure
from textile_twin_core.views.plot import plot_comparison

_MOST_POINTS = 20_000


def errors_figure(comparison: Comparison) -> Figure:
    """Draw the figure, 1600 x 800 pixels."""
    figure = paper.new_figure(16.0, 8.0)
    grid = figure.add_gridspec(2, 2, left=0.05, right=0.98, top=0.94, bottom=0.08, hspace=0.36, wspace=0.16)
    _over_time(figure.add_subplot(grid[0, 0]), comparison)
    _per_turn(figure.add_subplot(grid[0, 1]), comparison)
    _by_order(figure.add_subplot(grid[1, 0]), comparison)
    _by_speed(figure.add_subplot(grid[1, 1]), comparison)
    return figure


def _over_time(axes: Axes, comparison: Comparison) -> None:
    used = np.flatnonzero(comparison.used)
    shown = used[:: max(1, used.size // _MOST_POINTS)]
    time = (comparison.stamps_ns[shown] - comparison.stamps_ns[used[0]]) * 1e-9
    axes.plot(time, comparison.residual_Nm[shown], color=paper.RESIDUAL, linewidth=0.5, rasterized=True)
    _dress(axes, "Residual over the recording, N m", "s")


def _per_turn(axes: Axes, comparison: Comparison) -> None:
    turns = comparison.by_revolution
    axes.plot(
        turns.number - turns.number[0], turns.rms_Nm, ".-", color=paper.INK, linewidth=0.8, markersize=3, label="RMS"
    )
    axes.plot(turns.number - turns.number[0], turns.mean_Nm, color=paper.RESIDUAL, linewidth=1.2, label="mean")
    axes.legend(frameon=False, fontsize=10, loc="upper right")
    _dress(axes, "Residual of each turn, N m", "turn of the shaft")


def _by_order(axes: Axes, comparison: Comparison) -> None:
    orders = comparison.by_order
    axes.bar(orders.order, orders.amplitude_Nm, color=paper.RESIDUAL, width=0.6)
    _dress(axes, "Residual by order of the shaft, amplitude, N m", "order; 0 is the mean")


def _by_speed(axes: Axes, comparison: Comparison) -> None:
    speed = comparison.by_speed
    middle = 0.5 * (speed.low_rad_s + speed.high_rad_s) * 30.0 / np.pi
    width = 0.9 * (speed.high_rad_s - speed.low_rad_s) * 30.0 / np.pi
    axes.bar(middle, np.nan_to_num(speed.rms_Nm), width=np.where(width > 0.0, width, 1.0), color="#9aa4b0", label="RMS")
    axes.plot(middle, speed.mean_Nm, "o", color=paper.RESIDUAL, label="mean")
    axes.legend(frameon=False, fontsize=10, loc="upper right")
    _dress(axes, "Residual by speed, N m", "rpm")


def _dress(axes: Axes, title: str, below: str) -> None:
    paper.dress(axes, title)
    axes.set_xlabel(below, color=paper.MUTED)


_NORMAL95: Final = 1.959964
_WIDEST: Final = 1.6
"""Largest half width of a band over the peak that is drawn in full."""


def force_law_figure(curve: LearnedCurve) -> Figure:
    """Draw a force law over the distance from its first knot [mm]."""
    figure = paper.new_figure(11.0, 4.6)
    axes = figure.add_axes((0.075, 0.14, 0.9, 0.74))
    beyond = 1e3 * (curve.knots - curve.knots[0])
    ways = (
        ("in", curve.in_N, curve.in_sigma_N, paper.PREDICTED),
        ("out", curve.out_N, curve.out_sigma_N, paper.MEASURED),
    )
    limit = _WIDEST * curve.peak_N
    for way, force, sigma, colour in ways:
        half = np.minimum(_NORMAL95 * sigma, limit)
        axes.fill_between(beyond, force - half, force + half, color=colour, alpha=0.22, linewidth=0)
        axes.plot(beyond, force, "-o", color=colour, linewidth=1.8, markersize=3.5, label=f"way {way}")
    axes.axhline(0.0, color=paper.MUTED, linewidth=0.8)
    axes.set_xlim(0.0, float(beyond[-1]))
    axes.set_xlabel(f"{curve.measure} beyond {curve.knots[0]:.5g} m  [mm]", color=paper.MUTED)
    axes.set_ylabel("force against the motion  [N]", color=paper.MUTED)
    axes.legend(frameon=False, fontsize=11, loc="best")
    at = f", at {curve.at_speed_rad_s * 30.0 / np.pi:.0f} rpm" if curve.speed_power else ""
    paper.dress(axes, f"Force over {curve.measure}, with 95 % bands{at}")
    return figure


_NAMED_SPEEDS = 6
_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #22272e; max-width: 1100px; margin: 2em auto; padding: 0 1em; }
h1 { font-size: 1.6em; margin-bottom: 0; } h2 { font-size: 1.15em; margin: 1.6em 0 .4em; }
p.about { color: #6b7480; margin-top: .2em; }
table { border-collapse: collapse; } td, th { text-align: left; padding: .2em 1.4em .2em 0; vertical-align: top; }
tr { border-bottom: 1px solid #e4e7eb; } td.n { font-variant-numeric: tabular-nums; }
.verdict { border-left: 5px solid #c2377a; padding: .5em 1em; background: #faf3f6; }
.verdict.good { border-color: #2a9d63; background: #f2f9f5; }
.verdict li { margin: .2em 0; } .verdict li:first-child { font-weight: 600; }
img { max-width: 100%; } pre { background: #f6f8fa; padding: .8em; overflow-x: auto; font-size: 13px; }
@media print {
  body { margin: 0; max-width: none; } pre { white-space: pre-wrap; }
  h2, img, .verdict { break-inside: avoid; }
}
"""


def write_report(
    path: str | os.PathLike[str],
    comparison: Comparison,
    machine: Machine,
    *,
    title: str,
    declaration: str,
    provenance: Mapping[str, str],
) -> Path:
    """Write a comparison as one self-contained HTML file.

    Args:
        path: The .html file to write.
        comparison: Comparison with its verdict (see `assess`).
        machine: Machine of the comparison.
        title: Name of the recording.
        declaration: Text of the machine file.
        provenance: Further facts about the origin of the numbers, by name.

    Returns:
        The path written.

    Raises:
        RecordingError: The file cannot be written there.
    """
    lines = verdict_lines(comparison)
    known, sigma = math.isfinite(comparison.delay.sigma), comparison.delay.sigma
    delay = f"{comparison.delay.value * 1e3:.3f} ± {sigma * 1e3:.3f} ms" if known else "not identifiable"
    sensor = [
        ("", "configured", "estimated from the recording"),
        ("delay", f"{comparison.sensor_delay_s * 1e3:.3f} ms", delay),
        ("gain", f"{comparison.sensor_gain:.4f}", f"{comparison.fitted_gain:.4f}"),
        ("offset", f"{comparison.sensor_offset_Nm:.4f} N m", f"{comparison.fitted_offset_Nm:+.4f} N m"),
    ]
    events = [(event.name.replace("_", " "), f"{math.degrees(event.angle_rad):.2f}°") for event in comparison.events]
    made = {
        "made by": f"textile-twin {version('textile-twin-core')}",
        "made at": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
    }
    parts = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="about">{escape(f"{machine.name}: {machine.description}".rstrip(": "))}</p>',
        f'<div class="verdict{" good" if agrees_with_file(comparison) else ""}"><ul>',
        *(f"<li>{escape(line)}</li>" for line in lines),
        "</ul></div>",
        "<h2>Torque, measured and predicted</h2>",
        _picture(comparison, machine, title),
        *_force_laws(comparison),
        "<h2>Numbers</h2>",
        _table(summary_rows(comparison)),
        "<h2>Where the errors lie</h2>",
        _image(_png(errors_figure(comparison))),
        *_orders(comparison, machine),
        "<h2>Torque sensor</h2>",
        _table(sensor),
        *(["<h2>Events of the turn</h2>", _table(events)] if events else []),
        "<h2>Machine</h2>",
        f"<pre>{escape(declaration)}</pre>",
        "<h2>Where this comes from</h2>",
        _table([*provenance.items(), *made.items()]),
    ]
    page = (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{_STYLE}</style></head><body>\n" + "\n".join(parts) + "\n</body></html>\n"
    )
    target = Path(path)
    try:
        target.write_text(page, encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"cannot write {target}: {error.strerror or error}") from error
    return target


def _table(rows: Sequence[Sequence[str]]) -> str:
    body = "".join(
        "<tr>" + "".join(f'<td class="n">{escape(str(cell))}</td>' for cell in row) + "</tr>" for row in rows
    )
    return f"<table>{body}</table>"


def _force_laws(comparison: Comparison) -> list[str]:
    """Render each force law that the recording shows."""
    found = []
    for name, curve in comparison.curves.items():
        work_in, sigma_in, work_out, sigma_out = curve.work_J()
        work = f"Work of a stroke: {work_in:.3g} ± {sigma_in:.2g} J in, {work_out:.3g} ± {sigma_out:.2g} J out."
        found += [f"<h2>Force of {escape(name)}</h2>", f"<p>{work}</p>", _image(_png(force_law_figure(curve)))]
    return found


def _picture(comparison: Comparison, machine: Machine, title: str) -> str:
    with tempfile.TemporaryDirectory(prefix="textile-twin-") as folder:
        return _image(plot_comparison(Path(folder) / "plot.png", comparison, machine, title=title).read_bytes())


def _orders(comparison: Comparison, machine: Machine) -> list[str]:
    """Render the order analysis of speed, torque and residual; empty when the recording has too few turns.

    For a machine with an elastic shaft the maps also show its critical speeds.
    """
    try:
        maps = comparison_orders(comparison)
    except RecordingError:
        return []
    resonances = _resonances(maps["torque [N m]"], machine)
    said = [] if resonances is None else [f"<p>{escape(_critical_words(resonances))}</p>"]
    return ["<h2>Orders of the shaft</h2>", *said, _image(_png(orders_figure(maps, resonances)))]


def _resonances(found: OrderMap, machine: Machine) -> Resonances | None:
    """Find natural frequencies and critical speeds in the recorded range of speeds; None for a rigid shaft."""
    if machine.shaft is None or machine.missing_for_torque:
        return None
    edges, _ = found.over_speed()
    return find_resonances(elastic_shaft(machine), (max(float(edges[0]), 1e-3 * float(edges[-1])), float(edges[-1])))


def _critical_words(found: Resonances) -> str:
    """Describe the natural frequencies and the critical speeds."""
    natural = ", ".join(f"{mode.damped_Hz:.4g} Hz" for mode in found.modes[:3])
    worst = sorted(found.critical, key=lambda each: -each.severity)[:_NAMED_SPEEDS]
    met = "; ".join(
        f"{each.speed_rad_s * 30.0 / math.pi:.1f} rpm, order {each.order} meets {each.frequency_Hz:.4g} Hz"
        for each in sorted(worst, key=lambda each: each.speed_rad_s)
    )
    return f"Elastic main shaft: natural frequencies {natural}. Critical speeds in the recorded range: {met or 'none'}."


def _png(figure: Figure) -> bytes:
    out = io.BytesIO()
    figure.savefig(out, format="png")
    return out.getvalue()


def _image(png: bytes) -> str:
    return f'<img alt="plot" src="data:image/png;base64,{base64.b64encode(png).decode()}">'
