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

from matplotlib.figure import Figure

from textile_twin_core.comparison import Comparison, agrees_with_file, summary_rows, verdict_lines
from textile_twin_core.comparison.orders import OrderMap
from textile_twin_core.driveline import Resonances, elastic_shaft, find_resonances
from textile_twin_core.errors import RecordingError
from textile_twin_core.machine import Machine
from textile_twin_core.views.force_law_picture import force_law_figure
from textile_twin_core.views.orders_picture import comparison_orders, orders_figure
from textile_twin_core.views.plot import plot_comparison
from textile_twin_core.views.report_figure import errors_figure

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
    fit = comparison.fit
    delay = f"{fit.delay_s * 1e3:.3f} ± {fit.delay_sigma_s * 1e3:.3f} ms" if fit.identifiable else "not identifiable"
    line = (f"{fit.gain:.4f}", f"{fit.offset_Nm:+.4f} N m") if fit.sought else ("not identifiable", "not identifiable")
    sensor = [
        ("", "configured", "estimated from the recording"),
        ("delay", f"{comparison.sensor_delay_s * 1e3:.3f} ms", delay),
        ("gain", f"{comparison.sensor_gain:.4f}", line[0]),
        ("offset", f"{comparison.sensor_offset_Nm:.4f} N m", line[1]),
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
