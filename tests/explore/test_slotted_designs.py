"""Design page on machines with slotted levers and gears: picture, sliders, random draws, search, drawings."""

from __future__ import annotations

import math

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.errors import MachineError
from textile_twin_core.explore.analysis import analyse
from textile_twin_core.explore.design import Design
from textile_twin_core.explore.exports import as_dxf, as_picture
from textile_twin_core.machine import Machine
from textile_twin_core.synthesis import Batch, family_of
from textile_twin_core.synthesis.tolerance import monte_carlo, sensitivities

NAMES = ("whitworth_shaper", "geared_five_bar")


def design(name: str) -> Design:
    return Design.of(ttc.load_machine(f"examples/{name}.yaml"))


@pytest.mark.parametrize("name", NAMES)
def test_a_design_is_drawn_and_exported(name: str) -> None:
    analysis = analyse(design(name))
    assert {chart.title for chart in analysis.charts} >= {"Displacement", "Torque on the shaft", "Reactions"}
    assert all(np.isfinite(curve).all() for chart in analysis.charts for curve in chart.curves.values())
    assert as_picture(analysis, name, 1.0, "png").startswith(b"\x89PNG")
    circles = as_dxf(analysis, 1.0).count("\nCIRCLE\n")
    gears = {gear for bar in analysis.bars for gear in bar.gears}
    assert circles == len(analysis.points) + len(gears)
    if name == "geared_five_bar":
        assert analysis.fixed == ("O", "G")  # not where the gears touch
        assert {centre: round(radius, 12) for centre, radius in gears} == {"O": 0.08, "G": 0.04}
    else:
        assert not gears
        assert analysis.guides == ((0.0, 0.235, 1.0, 0.0),)  # the slot moves, so it is not a guide on the ground
        assert not analysis.clashes  # block and crank's pin are in the lever's slot


@pytest.mark.parametrize(("name", "measure"), [(NAMES[0], "tool"), (NAMES[1], "thread_guide")])
def test_random_draws_within_tolerances_stay_near_the_design(name: str, measure: str) -> None:
    machine = ttc.load_machine(f"examples/{name}.yaml")
    assert isinstance(machine, Machine)
    family = family_of(machine)
    batch = Batch(family)
    number = f"{measure}_stroke_m"
    tolerances = {p.name: 1e-4 for p in family.parameters if p.name.endswith(("length_m", "offset_m"))}
    drawn = monte_carlo(family, {}, batch, [number], tolerances, samples=500)
    slopes = sensitivities(family, {}, batch, [number], tuple(tolerances))[number]
    spread = 1e-4 / 3.0 * math.sqrt(sum(slope**2 for slope in slopes.values()))
    assert drawn.scrap_rate == 0.0
    assert drawn.spreads[number].sigma == pytest.approx(spread, rel=0.1)


@pytest.mark.parametrize("name", NAMES)
def test_every_slider_of_the_page_moves_the_machine(name: str) -> None:
    """Change each parameter slightly; the result is a valid machine or an error message."""
    family = family_of(ttc.load_machine(f"examples/{name}.yaml"))
    closed = 0
    for p in family.parameters:
        assert p.value is not None
        try:
            machine = family.machine({p.name: p.value + 1e-3 * (p.high - p.low)})
        except MachineError as error:
            assert "shaft angle" in str(error), p.name
            continue
        assert isinstance(machine, Machine)
        closed += math.isfinite(machine.closeness[0].margin)
    assert closed > 0.9 * len(family.parameters)
