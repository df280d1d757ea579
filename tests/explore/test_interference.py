"""Angles at which links cross, against a motion whose crossings are known in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.explore.interference import clashes
from textile_twin_core.synthesis.turn import shaft_angles


@pytest.mark.parametrize("phase", [0.3, 1.234, 2.0 * math.pi - 0.01])
def test_a_range_of_crossing_links_ends_where_they_meet(phase: float) -> None:
    """An upright link moves to and fro as cos(theta - phase) past a level one from 0.5 to 3, which it crosses beyond
    0.5: at 60 degrees on either side of the phase.
    """
    theta, machine = shaft_angles(), ttc.machines.tufting()
    apart = {
        name: (np.full_like(theta, 50.0 * k), np.full_like(theta, 7.0 * k * k)) for k, name in enumerate("OABCDEF")
    }
    first, second = ((link.start, link.end) for link in machine.links if link.name in ("l2", "l5"))
    level, upright = np.zeros_like(theta), np.cos(theta - phase)
    points = {
        **apart,
        first[0]: (level + 0.5, level), first[1]: (level + 3.0, level),
        second[0]: (upright, level - 1.0), second[1]: (upright, level + 1.0),
    }  # fmt: skip
    found = {(each.first, each.second): each for each in clashes(machine, points, theta)}
    each = found["l2", "l5"]
    for angle, true in ((each.begin_rad, phase - math.pi / 3.0), (each.end_rad, phase + math.pi / 3.0)):
        assert abs(math.remainder(angle - true, 2.0 * math.pi)) < math.radians(0.01)
