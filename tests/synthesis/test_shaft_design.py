"""Diameter and stations of an elastic shaft as parameters of a design."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import textile_twin_core as ttc
from textile_twin_core.driveline import elastic_shaft, find_resonances
from textile_twin_core.explore.analysis import analyse
from textile_twin_core.explore.design import Design
from textile_twin_core.explore.labels import label
from textile_twin_core.machine import Machine
from textile_twin_core.synthesis.shaft_design import DIAMETER, STATIONS, shaft_values

FILE = Path(__file__).parents[2] / "examples" / "wide_tufting.yaml"


def test_a_slider_makes_the_machine_that_a_file_with_these_numbers_makes(tmp_path: Path) -> None:
    other = tmp_path / "other.yaml"
    other.write_text(FILE.read_text().replace("0.06", "0.08").replace("stations: 16", "stations: 12"))
    design = Design.of(ttc.load_machine(FILE))
    changed = design.changed({DIAMETER: 0.08, STATIONS: 12.2}).machine()
    written = ttc.load_machine(other)
    assert isinstance(changed, Machine) and isinstance(written, Machine)
    assert shaft_values(changed) == pytest.approx({DIAMETER: 0.08, STATIONS: 12.0})
    assert changed.linkages == written.linkages
    assert changed.shaft is not None and written.shaft is not None
    for one, another in zip(changed.shaft.pieces, written.shaft.pieces, strict=True):
        assert one.stiffness == pytest.approx(another.stiffness, rel=1e-12)
        assert one.damping_Nms_rad == pytest.approx(another.damping_Nms_rad, rel=1e-12)
    assert design.machine() == design.family.base


def test_critical_speeds_are_among_the_numbers_of_a_design() -> None:
    design = Design.of(ttc.load_machine(FILE)).changed({DIAMETER: 0.08})
    numbers = analyse(design).numbers
    machine = design.machine()
    assert isinstance(machine, Machine)
    found = find_resonances(elastic_shaft(machine), (0.2 * design.speed_rad_s, 2.0 * design.speed_rad_s))
    assert numbers["first_natural_frequency_Hz"] == found.modes[0].damped_Hz
    speeds = {name: value for name, value in numbers.items() if name.startswith("critical_speed")}
    assert len(speeds) == 4 and set(speeds.values()) <= {each.speed_rad_s for each in found.critical}
    assert {label(name).unit for name in speeds} == {"rpm"}


def test_other_shafts_have_fewer_sliders() -> None:
    wide = ttc.load_machine(FILE)
    assert isinstance(wide, Machine) and wide.shaft is not None
    assert shaft_values(ttc.machines.tufting()) == {}
    first, *rest = wide.shaft.pieces
    uneven = replace(wide.shaft, pieces=(replace(first, length_m=0.5), *rest))
    assert shaft_values(replace(wide, shaft=uneven)) == {DIAMETER: 0.06}
    stepped = replace(wide.shaft, pieces=(replace(first, diameter_m=0.09), *rest))
    assert shaft_values(replace(wide, shaft=stepped)) == {}
