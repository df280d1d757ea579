"""Picture of a force law: force over the measure, in and out, with the bands that hold it in 95 of 100 recordings."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.figure import Figure

from textile_twin_core.inference.force_law import LearnedCurve
from textile_twin_core.views import paper

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
